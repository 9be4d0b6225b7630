"""Poses along the strongest links."""

from collections.abc import Sequence

import numpy as np

from trihedral.geometry.arrays import Float64, Int64
from trihedral.geometry.se3 import adjoint, carried, inverses
from trihedral.network.graph.connectivity import Tree
from trihedral.network.graph.edge import Edge


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
            back = inverses(self._transforms[link])
            self.poses[stations] = above @ np.where(forth, self._transforms[link], back)
            at = np.where(forth, above, above @ back)
            self.spread[stations] = self.spread[parents] + carried(adjoint(at), self._covariances[link])

    def closure_errors(self, chosen: Int64) -> tuple[Float64, Float64]:
        """Of the loop that each chosen edge closes: motion (N, 4, 4) and covariance (N, 6, 6), at its end `b`."""
        a, b = self._a[chosen], self._b[chosen]
        meeting = self.tree.meeting(a, b)
        b_from_root = inverses(self.poses[b])
        way = self.spread[a] + self.spread[b] - 2 * self.spread[meeting]
        expected = b_from_root @ self.poses[a]
        found, spread = self._transforms[chosen], self._covariances[chosen]
        return found @ inverses(expected), carried(adjoint(b_from_root), way) + spread

    def walk(self, index: int) -> list[int]:
        """Stations of the loop over the tree and an edge outside it."""
        return self.tree.walk(self.edges[index].b, self.edges[index].a)
