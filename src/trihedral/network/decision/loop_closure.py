"""Which links agree with each other: loops that close, and the links that keep others from closing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.geometry.se3 import inverse
from trihedral.network.graph.connectivity import Tree, triangles

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Edge:
    """A link as the network sees it: ends are numbers of stations.

    `transform` is ``b_from_a`` between scanner-centred frames, `covariance` 6x6 of ``(omega, v)`` on its left.
    """

    a: int
    b: int
    transform: Float64
    covariance: Float64
    strength: float  # how well the pair bears it out; decides between links that contradict each other
    locked: bool = False  # a person decided on it: never refused
    given: bool = False  # stands for poses that are known; no scan measured it

    @property
    def ends(self) -> tuple[int, int]:
        """Its two stations."""
        return self.a, self.b


@dataclass(frozen=True)
class ClosureOptions:
    """When a loop closes."""

    sigmas: float = 4.0  # of the expected closure
    translation: float = 0.03  # metres; allowed whatever the expectation: scans move while they are taken
    rotation: float = np.radians(0.15)  # the same

    def __post_init__(self) -> None:
        if min(self.sigmas, self.translation, self.rotation) <= 0:
            raise OptionError("limits of closure must be positive")


@dataclass(frozen=True)
class Closure:
    """How far a walk over edges back to its start misses it."""

    stations: tuple[int, ...]
    translation: float  # metres
    rotation: float  # radians
    expected_translation: float  # one sigma, metres
    ok: bool
    expected_rotation: float = 0.0  # one sigma, radians


@dataclass(frozen=True)
class Verdict:
    """Which edges agree with each other.

    Attributes
    ----------
    kept
        Edges whose loops all close.
    refused
        Edges with the loop that each failed in.
    closures
        Loops of the kept edges: every triangle, and one longer loop for each edge that lies in no triangle.
    """

    kept: list[Edge]
    refused: list[tuple[Edge, Closure]]
    closures: list[Closure]


def close(walk: Sequence[int], edges: Sequence[Edge], options: ClosureOptions) -> Closure:
    """Close the loop over the stations of `walk` in turn and back to the first."""
    by_ends = {edge.ends: edge for edge in edges}
    total = np.eye(4)
    covariance = np.zeros((6, 6))
    for here, there in zip(walk, [*walk[1:], walk[0]], strict=True):
        if (here, there) in by_ends:
            step, spread = by_ends[here, there].transform, by_ends[here, there].covariance
        else:
            edge = by_ends[there, here]
            step = inverse(edge.transform)
            spread = _carried(adjoint(step), edge.covariance)
        # Errors so far are seen from the next station: (omega, v) on the left moves by the adjoint.
        covariance = _carried(adjoint(step), covariance) + spread
        total = step @ total
    return _closure(tuple(walk), total, covariance, options)


def consistent(edges: Sequence[Edge], options: ClosureOptions) -> Verdict:
    """Keep the edges that agree with each other.

    Of the triangles that do not close, the edge that spoils most of them against those that it closes is refused, the
    weaker of equals; this repeats until every triangle closes. Longer loops are then closed over the strongest tree:
    of one that does not close, the weakest edge without a triangle to bear it out is refused. Locked edges are never.
    """
    edges = list(edges)
    there = Triangles(edges, options)
    alive = np.ones(len(edges), dtype=bool)
    refused: list[tuple[Edge, Closure]] = []
    while True:
        worst = there.spoiler()
        found = [worst] if worst is not None else _broken_long_loops(edges, alive, there, options)
        if not found:
            break
        for index, closure in found:
            refused.append((edges[index], closure))
            alive[index] = False
            there.without(index)
    kept = [edge for edge, is_kept in zip(edges, alive, strict=True) if is_kept]
    in_triangle = there.taking_part()
    forest = Forest(kept)
    alone = ~in_triangle[alive]
    longer = [forest.closure(int(k), options) for k in np.flatnonzero(alone & ~forest.tree.inside)]
    return Verdict(kept, refused, there.closures() + longer)


class Triangles:
    """Every triangle of some edges and how it closes; edges can be taken away."""

    def __init__(self, edges: Sequence[Edge], options: ClosureOptions) -> None:
        self.edges = edges
        self.options = options
        number = {frozenset(edge.ends): index for index, edge in enumerate(edges)}
        self.stations = triangles([edge.ends for edge in edges])
        self.members = np.array(
            [
                [number[frozenset(pair)] for pair in ((a, b), (b, c), (a, c))]
                for a, b, c in self.stations.tolist()
            ],
            dtype=np.int64,
        ).reshape(-1, 3)
        self.alive = np.ones(len(self.members), dtype=bool)
        self._close()
        self._of: list[list[int]] = [[] for _ in edges]
        for triangle, three in enumerate(self.members.tolist()):
            for index in three:
                self._of[index].append(triangle)
        self.balance = np.zeros(len(edges), dtype=np.int64)  # triangles that fail less those that close
        self.failing = np.zeros(len(edges), dtype=np.int64)
        for k in range(3):
            np.add.at(self.balance, self.members[:, k], np.where(self.ok, -1, 1))
            np.add.at(self.failing, self.members[:, k], ~self.ok)

    def _close(self) -> None:
        total = np.broadcast_to(np.eye(4), (len(self.members), 4, 4))
        covariance = np.zeros((len(self.members), 6, 6))
        if len(self.members):
            forth = np.array([edge.transform for edge in self.edges])
            back = np.array([inverse(edge.transform) for edge in self.edges])
            spread = np.array([edge.covariance for edge in self.edges])
            spread_back = _carried(adjoint(back), spread)
            ends = np.array([edge.ends for edge in self.edges])
            for k in range(3):
                index = self.members[:, k]
                along = ends[index, 0] == self.stations[:, k]
                step = np.where(along[:, None, None], forth[index], back[index])
                covariance = _carried(adjoint(step), covariance)
                covariance = covariance + np.where(along[:, None, None], spread[index], spread_back[index])
                total = step @ total
        self.translation, self.rotation, self.expected, self.expected_rotation, self.ok = _misses(
            total, covariance, self.options
        )

    def spoiler(self) -> tuple[int, Closure] | None:
        """The edge that most triangles fail by, and the worst of these."""
        spoiling = [k for k in np.flatnonzero(self.failing).tolist() if not self.edges[k].locked]
        if not spoiling:
            return None
        index = max(spoiling, key=lambda k: (self.balance[k], -self.edges[k].strength))
        failed = [t for t in self._of[index] if self.alive[t] and not self.ok[t]]
        return index, self._closure(max(failed, key=lambda t: self.translation[t]))

    def without(self, index: int) -> None:
        """Take an edge away."""
        for triangle in self._of[index]:
            if self.alive[triangle]:
                self.alive[triangle] = False
                members = self.members[triangle]
                self.balance[members] -= -1 if self.ok[triangle] else 1
                self.failing[members] -= not self.ok[triangle]

    def beside(self, index: int) -> set[int]:
        """Edges that are in a triangle with an edge."""
        alive = [t for t in self._of[index] if self.alive[t]]
        return set(self.members[alive].ravel().tolist())

    def bearing_out(self) -> NDArray[np.bool_]:
        """For each edge, whether a triangle closes over it."""
        found = np.zeros(len(self.edges), dtype=bool)
        found[self.members[self.alive & self.ok].ravel()] = True
        return found

    def taking_part(self) -> NDArray[np.bool_]:
        """For each edge, whether it lies in a triangle."""
        found = np.zeros(len(self.edges), dtype=bool)
        found[self.members[self.alive].ravel()] = True
        return found

    def closures(self) -> list[Closure]:
        """Of all triangles that are left."""
        return [self._closure(t) for t in np.flatnonzero(self.alive).tolist()]

    def _closure(self, triangle: int) -> Closure:
        a, b, c = self.stations[triangle].tolist()
        return Closure(
            (a, b, c),
            float(self.translation[triangle]),
            float(self.rotation[triangle]),
            float(self.expected[triangle]),
            bool(self.ok[triangle]),
            float(self.expected_rotation[triangle]),
        )


class Forest:
    """The strongest spanning trees of some edges, and the loops that the other edges close over them."""

    def __init__(self, edges: Sequence[Edge]) -> None:
        self.edges = edges
        count = 1 + max((max(edge.ends) for edge in edges), default=-1)
        order = sorted(
            range(len(edges)), key=lambda k: (-edges[k].locked, -edges[k].strength, edges[k].a, edges[k].b)
        )
        self.tree = Tree(count, [edge.ends for edge in edges], order)
        # Errors of each pose as (omega, v) on its left, about its root: they add up along a way.
        self.poses = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
        self.spread = np.zeros((count, 6, 6))
        self._a, self._b = np.array([edge.ends for edge in edges], dtype=np.int64).reshape(-1, 2).T
        self._transforms = np.array([edge.transform for edge in edges]).reshape(-1, 4, 4)
        self._covariances = np.array([edge.covariance for edge in edges]).reshape(-1, 6, 6)
        for depth in range(1, int(self.tree.depth.max(initial=0)) + 1):
            stations = np.flatnonzero(self.tree.depth == depth)
            parents, link = self.tree.parent[stations], self.tree.link[stations]
            above = self.poses[parents]
            forth = (self._a[link] == stations)[:, None, None]
            back = _inverses(self._transforms[link])
            self.poses[stations] = above @ np.where(forth, self._transforms[link], back)
            at = np.where(forth, above, above @ back)
            self.spread[stations] = self.spread[parents] + _carried(adjoint(at), self._covariances[link])

    def misses(self, chosen: NDArray[np.int64]) -> tuple[Float64, Float64]:
        """Of the loop that each chosen edge closes: motion (N, 4, 4) and covariance (N, 6, 6), at its end `b`."""
        a, b = self._a[chosen], self._b[chosen]
        meeting = self.tree.meeting(a, b)
        b_from_root = _inverses(self.poses[b])
        way = self.spread[a] + self.spread[b] - 2 * self.spread[meeting]
        expected = b_from_root @ self.poses[a]
        found, spread = self._transforms[chosen], self._covariances[chosen]
        return found @ _inverses(expected), _carried(adjoint(b_from_root), way) + spread

    def closure(self, index: int, options: ClosureOptions) -> Closure:
        """The loop over the tree and an edge outside it."""
        total, covariance = self.misses(np.array([index]))
        return _closure(tuple(self.walk(index)), total[0], covariance[0], options)

    def walk(self, index: int) -> list[int]:
        """Stations of that loop."""
        return self.tree.walk(self.edges[index].b, self.edges[index].a)


def adjoint(transform: Float64) -> Float64:
    """(..., 6, 6) that takes ``(omega, v)`` on the right of a motion (..., 4, 4) to its left."""
    rotation = transform[..., :3, :3]
    result = np.zeros((*transform.shape[:-2], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = rotation
    result[..., 3:, :3] = skew(transform[..., :3, 3]) @ rotation
    return result


def rotation_angles(motions: Float64) -> Float64:
    """Angle (rad) of each rotation of (N, 4, 4), accurate for small ones too."""
    r = motions[:, :3, :3]
    axis = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=-1)
    cosine = (np.trace(r, axis1=1, axis2=2) - 1) / 2
    angles: Float64 = np.arctan2(np.linalg.norm(axis, axis=-1) / 2, cosine)
    return angles


def skew(vector: Float64) -> Float64:
    """(..., 3, 3) with ``skew(a) @ b == cross(a, b)``."""
    result = np.zeros((*vector.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -vector[..., 2], vector[..., 1]
    result[..., 1, 0], result[..., 1, 2] = vector[..., 2], -vector[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -vector[..., 1], vector[..., 0]
    return result


def _carried(by: Float64, covariance: Float64) -> Float64:
    return by @ covariance @ np.swapaxes(by, -1, -2)


def _inverses(motions: Float64) -> Float64:
    result = np.zeros_like(motions)
    result[..., :3, :3] = np.swapaxes(motions[..., :3, :3], -1, -2)
    result[..., :3, 3] = -(result[..., :3, :3] @ motions[..., :3, 3, None])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def _misses(
    total: Float64, covariance: Float64, options: ClosureOptions
) -> tuple[Float64, Float64, Float64, Float64, NDArray[np.bool_]]:
    """Translation, rotation, what is expected of either, and whether that is a closed loop; of many loops."""
    translation = np.linalg.norm(total[:, :3, 3], axis=-1)
    rotation = rotation_angles(total)
    expected = np.sqrt(np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2))
    expected_rotation = np.sqrt(np.trace(covariance[:, :3, :3], axis1=1, axis2=2))
    ok = (translation <= np.maximum(options.translation, options.sigmas * expected)) & (
        rotation <= np.maximum(options.rotation, options.sigmas * expected_rotation)
    )
    return translation, rotation, expected, expected_rotation, ok


def _closure(
    stations: tuple[int, ...], total: Float64, covariance: Float64, options: ClosureOptions
) -> Closure:
    translation, rotation, expected, expected_rotation, ok = _misses(total[None], covariance[None], options)
    return Closure(
        stations,
        float(translation[0]),
        float(rotation[0]),
        float(expected[0]),
        bool(ok[0]),
        float(expected_rotation[0]),
    )


def _broken_long_loops(
    edges: Sequence[Edge], alive: NDArray[np.bool_], there: Triangles, options: ClosureOptions
) -> list[tuple[int, Closure]]:
    """Edges to refuse, with their loops: one of the tree, or any number outside it, which change no other loop."""
    index: list[int] = np.flatnonzero(alive).tolist()
    forest = Forest([edges[k] for k in index])
    outside = np.flatnonzero(~forest.tree.inside)
    *_, ok = _misses(*forest.misses(outside), options)
    borne_out = there.bearing_out()
    number = {frozenset(edges[k].ends): k for k in index}
    found: list[tuple[int, Closure]] = []
    touched: set[int] = set()
    for broken in outside[~ok].tolist():
        walk = forest.walk(broken)
        members = [number[frozenset(pair)] for pair in zip(walk, [*walk[1:], walk[0]], strict=True)]
        members = [k for k in members if not edges[k].locked]
        if not members:
            continue
        weakest = min(members, key=lambda k: (bool(borne_out[k]), edges[k].strength))
        if touched & set(members):
            break  # one before it may have taken away what bears them out
        if weakest == index[broken]:
            found.append((weakest, forest.closure(broken, options)))
            touched |= there.beside(weakest)
        elif not found:
            return [(weakest, forest.closure(broken, options))]
    return found
