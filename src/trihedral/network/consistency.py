"""Which links agree with each other: loops that close, and the links that keep others from closing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.geometry.motion import inverse, rotation_angle

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


def close(walk: Sequence[int], edges: Mapping[tuple[int, int], Edge], options: ClosureOptions) -> Closure:
    """Close the loop over the stations of `walk` in turn and back to the first."""
    total = np.eye(4)
    covariance = np.zeros((6, 6))
    for here, there in zip(walk, [*walk[1:], walk[0]], strict=True):
        step, spread = _directed(edges, here, there)
        # Errors so far are seen from the next station: (omega, v) on the left moves by the adjoint.
        adjoint = _adjoint(step)
        covariance = adjoint @ covariance @ adjoint.T + spread
        total = step @ total
    translation = float(np.linalg.norm(total[:3, 3]))
    rotation = rotation_angle(total)
    expected = float(np.sqrt(np.trace(covariance[3:, 3:])))
    expected_rotation = float(np.sqrt(np.trace(covariance[:3, :3])))
    ok = translation <= max(options.translation, options.sigmas * expected) and rotation <= max(
        options.rotation, options.sigmas * expected_rotation
    )
    return Closure(tuple(walk), translation, rotation, expected, ok)


def consistent(
    edges: Sequence[Edge], options: ClosureOptions
) -> tuple[list[Edge], list[tuple[Edge, Closure]], list[Closure]]:
    """Keep the edges that agree with each other.

    Of the triangles that do not close, the edge that spoils most of them against those that it closes is refused, the
    weaker of equals; this repeats until every triangle closes. Longer loops are then closed over the strongest tree:
    an edge that does not close is refused if it is the weakest of its loop without a triangle to bear it out.

    Returns
    -------
    kept
        Edges whose loops all close.
    refused
        Edges with the loop that each failed in.
    closures
        Loops of the kept edges: every triangle, and one longer loop for each edge that lies in no triangle.
    """
    kept = {(edge.a, edge.b): edge for edge in edges}
    refused: list[tuple[Edge, Closure]] = []
    while True:
        triangles = [close(walk, kept, options) for walk in _triangles(kept)]
        worst = _spoiler(kept, triangles)
        if worst is None:
            broken = _broken_long_loop(kept, triangles, options)
            if broken is None:
                break
            worst = broken
        edge, closure = worst
        refused.append((edge, closure))
        del kept[edge.a, edge.b]
    in_triangle = {frozenset(pair) for t in triangles for pair in combinations(t.stations, 2)}
    longer = [
        close(walk, kept, options)
        for edge, walk in _tree_loops(kept)
        if frozenset((edge.a, edge.b)) not in in_triangle
    ]
    return list(kept.values()), refused, triangles + longer


def _directed(edges: Mapping[tuple[int, int], Edge], here: int, there: int) -> tuple[Float64, Float64]:
    if (here, there) in edges:
        edge = edges[here, there]
        return edge.transform, edge.covariance
    edge = edges[there, here]
    adjoint = _adjoint(inverse(edge.transform))
    return inverse(edge.transform), adjoint @ edge.covariance @ adjoint.T


def _adjoint(transform: Float64) -> Float64:
    """6x6 that takes ``(omega, v)`` on the right of a motion to its left."""
    rotation, (x, y, z) = transform[:3, :3], transform[:3, 3]
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = rotation
    adjoint[3:, :3] = skew @ rotation
    return adjoint


def _triangles(edges: Mapping[tuple[int, int], Edge]) -> list[tuple[int, int, int]]:
    neighbours: dict[int, set[int]] = {}
    for a, b in edges:
        neighbours.setdefault(a, set()).add(b)
        neighbours.setdefault(b, set()).add(a)
    found = {tuple(sorted((a, b, c))) for a, b in edges for c in neighbours[a] & neighbours[b]}
    return sorted((t[0], t[1], t[2]) for t in found)


def _spoiler(
    edges: Mapping[tuple[int, int], Edge], triangles: Sequence[Closure]
) -> tuple[Edge, Closure] | None:
    """The edge that most triangles fail by, and the worst of these."""
    balance: dict[tuple[int, int], int] = {}
    worst: dict[tuple[int, int], Closure] = {}
    for triangle in triangles:
        for a, b in combinations(triangle.stations, 2):
            key = (a, b) if (a, b) in edges else (b, a)
            balance[key] = balance.get(key, 0) + (-1 if triangle.ok else 1)
            if not triangle.ok and (key not in worst or triangle.translation > worst[key].translation):
                worst[key] = triangle
    if not worst:
        return None
    key = max(worst, key=lambda k: (balance[k], -edges[k].strength))
    return edges[key], worst[key]


def _tree_loops(edges: Mapping[tuple[int, int], Edge]) -> list[tuple[Edge, list[int]]]:
    """For each edge outside the strongest spanning tree, the loop that it closes over the tree."""
    parent: dict[int, int] = {}

    def root(station: int) -> int:
        while parent.get(station, station) != station:
            station = parent[station]
        return station

    tree: dict[int, list[int]] = {}
    rest: list[Edge] = []
    for edge in sorted(edges.values(), key=lambda e: (-e.strength, e.a, e.b)):
        a, b = root(edge.a), root(edge.b)
        if a == b:
            rest.append(edge)
            continue
        parent[a] = b
        parent.setdefault(b, b)
        tree.setdefault(edge.a, []).append(edge.b)
        tree.setdefault(edge.b, []).append(edge.a)
    return [(edge, _path(tree, edge.b, edge.a)) for edge in rest]


def _path(tree: Mapping[int, Sequence[int]], start: int, end: int) -> list[int]:
    before = {start: start}
    queue = [start]
    for here in queue:
        for there in tree[here]:
            if there not in before:
                before[there] = here
                queue.append(there)
    path = [end]
    while path[-1] != start:
        path.append(before[path[-1]])
    return path


def _broken_long_loop(
    edges: Mapping[tuple[int, int], Edge], triangles: Sequence[Closure], options: ClosureOptions
) -> tuple[Edge, Closure] | None:
    borne_out = {frozenset(pair) for t in triangles if t.ok for pair in combinations(t.stations, 2)}
    for _, walk in _tree_loops(edges):
        closure = close(walk, edges, options)
        if closure.ok:
            continue
        pairs = zip(walk, [*walk[1:], walk[0]], strict=True)
        members = [edges[p] if p in edges else edges[p[1], p[0]] for p in pairs]
        weakest = min(members, key=lambda e: (frozenset((e.a, e.b)) in borne_out, e.strength))
        return weakest, closure
    return None
