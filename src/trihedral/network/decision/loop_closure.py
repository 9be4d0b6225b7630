"""Which links agree with each other: loops that close, and the links that keep others from closing."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from trihedral.geometry.arrays import Bool, Float64
from trihedral.geometry.se3 import adjoint, carried, inverse, rotation_angles
from trihedral.network.graph.connectivity import triangles
from trihedral.network.graph.edge import Edge
from trihedral.network.graph.forest import Forest
from trihedral.network.options import ClosureOptions


@dataclass(frozen=True)
class Closure:
    """How far a walk over edges back to its start misses it."""

    stations: tuple[int, ...]
    translation: float  # metres
    rotation: float  # radians
    expected_translation: float  # one sigma, metres
    expected_rotation: float  # one sigma, radians
    ok: bool


@dataclass(frozen=True)
class LoopClosure:
    """Which edges agree with each other."""

    #: Edges whose loops all close.
    kept: list[Edge] = field(default_factory=list)
    #: Edges with the loop that each failed in.
    refused: list[tuple[Edge, Closure]] = field(default_factory=list)
    #: Loops of the kept edges: every triangle, and one longer loop for each edge that lies in no triangle.
    closures: list[Closure] = field(default_factory=list)


def consistent(edges: Sequence[Edge], options: ClosureOptions) -> LoopClosure:
    """Keep the edges that agree with each other.

    Of the triangles that do not close, the edge that spoils most of them against those that it closes is refused, the
    weaker of equals; this repeats until every triangle closes. Longer loops are then closed over the strongest tree:
    of one that does not close, the weakest edge without a triangle to bear it out is refused. Locked edges are never.
    """
    edges = list(edges)
    loops = Triangles(edges, options)
    alive = np.ones(len(edges), dtype=bool)
    refused: list[tuple[Edge, Closure]] = []
    while True:
        worst = loops.spoiler()
        found = [worst] if worst is not None else _broken_long_loops(edges, alive, loops, options)
        if not found:
            break
        for index, closure in found:
            refused.append((edges[index], closure))
            alive[index] = False
            loops.without(index)
    kept = [edge for edge, is_kept in zip(edges, alive, strict=True) if is_kept]
    in_triangle = loops.taking_part()
    forest = Forest(kept)
    alone = ~in_triangle[alive]
    longer = [_over_forest(forest, int(k), options) for k in np.flatnonzero(alone & ~forest.tree.inside)]
    return LoopClosure(kept, refused, loops.closures() + longer)


class Triangles:
    """Every triangle of some edges and how it closes; edges can be taken away."""

    def __init__(self, edges: Sequence[Edge], options: ClosureOptions) -> None:
        self.edges = edges
        self.options = options
        number = {frozenset(edge.ends): index for index, edge in enumerate(edges)}
        self.stations = triangles([edge.ends for edge in edges])
        self.sides = np.array(
            [
                [number[frozenset(pair)] for pair in ((a, b), (b, c), (a, c))]
                for a, b, c in self.stations.tolist()
            ],
            dtype=np.int64,
        ).reshape(-1, 3)
        self.alive = np.ones(len(self.sides), dtype=bool)
        self._close()
        self._of: list[list[int]] = [[] for _ in edges]
        for triangle, three in enumerate(self.sides.tolist()):
            for index in three:
                self._of[index].append(triangle)
        self.failing = np.bincount(self.sides[~self.ok].ravel(), minlength=len(edges))
        # Triangles that fail less those that close.
        self.balance = self.failing - np.bincount(self.sides[self.ok].ravel(), minlength=len(edges))

    def _close(self) -> None:
        total = np.broadcast_to(np.eye(4), (len(self.sides), 4, 4))
        covariance = np.zeros((len(self.sides), 6, 6))
        if len(self.sides):
            forth = np.array([edge.transform for edge in self.edges])
            back = np.array([inverse(edge.transform) for edge in self.edges])
            spread = np.array([edge.covariance for edge in self.edges])
            spread_back = carried(adjoint(back), spread)
            ends = np.array([edge.ends for edge in self.edges])
            for k in range(3):
                index = self.sides[:, k]
                along = ends[index, 0] == self.stations[:, k]
                step = np.where(along[:, None, None], forth[index], back[index])
                covariance = carried(adjoint(step), covariance)
                covariance = covariance + np.where(along[:, None, None], spread[index], spread_back[index])
                total = step @ total
        self.errors = _errors(total, covariance, self.options)
        self.ok = self.errors.ok

    def spoiler(self) -> tuple[int, Closure] | None:
        """The edge that most triangles fail by, and the worst of these."""
        spoiling = [k for k in np.flatnonzero(self.failing).tolist() if not self.edges[k].locked]
        if not spoiling:
            return None
        index = max(spoiling, key=lambda k: (self.balance[k], -self.edges[k].strength))
        failed = [t for t in self._of[index] if self.alive[t] and not self.ok[t]]
        return index, self._closure(max(failed, key=lambda t: self.errors.translation[t]))

    def without(self, index: int) -> None:
        """Take an edge away."""
        for triangle in self._of[index]:
            if self.alive[triangle]:
                self.alive[triangle] = False
                sides = self.sides[triangle]
                self.balance[sides] -= -1 if self.ok[triangle] else 1
                self.failing[sides] -= not self.ok[triangle]

    def beside(self, index: int) -> set[int]:
        """Edges that are in a triangle with an edge."""
        alive = [t for t in self._of[index] if self.alive[t]]
        return set(self.sides[alive].ravel().tolist())

    def bearing_out(self) -> Bool:
        """For each edge, whether a triangle closes over it."""
        return np.isin(np.arange(len(self.edges)), self.sides[self.alive & self.ok])

    def taking_part(self) -> Bool:
        """For each edge, whether it lies in a triangle."""
        return np.isin(np.arange(len(self.edges)), self.sides[self.alive])

    def closures(self) -> list[Closure]:
        """Of all triangles that are left."""
        return [self._closure(t) for t in np.flatnonzero(self.alive).tolist()]

    def _closure(self, triangle: int) -> Closure:
        return self.errors.closure(triangle, self.stations[triangle].tolist())


class _Errors(NamedTuple):
    """Closure errors of many loops, (N,) each, and whether they count as closed."""

    translation: Float64
    rotation: Float64
    expected_translation: Float64
    expected_rotation: Float64
    ok: Bool

    def closure(self, loop: int, stations: Sequence[int]) -> Closure:
        return Closure(
            tuple(stations),
            float(self.translation[loop]),
            float(self.rotation[loop]),
            float(self.expected_translation[loop]),
            float(self.expected_rotation[loop]),
            bool(self.ok[loop]),
        )


def _errors(total: Float64, covariance: Float64, options: ClosureOptions) -> _Errors:
    translation = np.linalg.norm(total[:, :3, 3], axis=-1)
    rotation = rotation_angles(total)
    expected = np.sqrt(np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2))
    expected_rotation = np.sqrt(np.trace(covariance[:, :3, :3], axis1=1, axis2=2))
    ok = (translation <= np.maximum(options.translation, options.sigmas * expected)) & (
        rotation <= np.maximum(options.rotation, options.sigmas * expected_rotation)
    )
    return _Errors(translation, rotation, expected, expected_rotation, ok)


def _over_forest(forest: Forest, index: int, options: ClosureOptions) -> Closure:
    """The loop over the trees and an edge outside them."""
    return _errors(*forest.closure_errors(np.array([index])), options).closure(0, forest.walk(index))


def _broken_long_loops(
    edges: Sequence[Edge], alive: Bool, loops: Triangles, options: ClosureOptions
) -> list[tuple[int, Closure]]:
    """Edges to refuse, with their loops: one of the tree, or any number outside it, which change no other loop."""
    index: list[int] = np.flatnonzero(alive).tolist()
    forest = Forest([edges[k] for k in index])
    outside = np.flatnonzero(~forest.tree.inside)
    ok = _errors(*forest.closure_errors(outside), options).ok
    borne_out = loops.bearing_out()
    number = {frozenset(edges[k].ends): k for k in index}
    found: list[tuple[int, Closure]] = []
    touched: set[int] = set()
    for broken in outside[~ok].tolist():
        walk = forest.walk(broken)
        around = [number[frozenset(pair)] for pair in zip(walk, [*walk[1:], walk[0]], strict=True)]
        around = [k for k in around if not edges[k].locked]
        if not around:
            continue
        weakest = min(around, key=lambda k: (bool(borne_out[k]), edges[k].strength))
        if touched & set(around):
            break  # one before it may have taken away what bears them out
        if weakest == index[broken]:
            found.append((weakest, _over_forest(forest, broken, options)))
            touched |= loops.beside(weakest)
        elif not found:
            return [(weakest, _over_forest(forest, broken, options))]
    return found
