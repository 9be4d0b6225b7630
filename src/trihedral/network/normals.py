"""A sparse normal matrix: solved, and the part of its inverse that lies where it has entries itself.

SciPy's sparse solver gives no such part, and solving for it costs minutes at a thousand stations where this takes a
second; gtsam gives it one pair of unknowns at a time.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

Float64 = NDArray[np.float64]


class NormalMatrix:
    """A symmetric positive definite matrix of blocks, factored.

    Blocks are eliminated in the order of least degree (Tinney and Walker 1967), each as a dense matrix over itself and
    its neighbours at the time (multifrontal, Duff and Reid 1983). The inverse goes back the same way (Takahashi et al.
    1973).

    Parameters
    ----------
    sizes
        Rows of each block.
    blocks
        ``(i, j)`` with ``i <= j``: the block in row `i`, column `j`; the rest is zero or follows by symmetry. Every
        diagonal block must be there.

    Raises
    ------
    numpy.linalg.LinAlgError
        It is not positive definite: something is not determined.
    """

    def __init__(self, sizes: Sequence[int], blocks: Mapping[tuple[int, int], Float64]) -> None:
        self.first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._order, self._beside = _eliminated(len(sizes), list(blocks))
        rank = {node: place for place, node in enumerate(self._order)}
        self._rows: list[NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)] * len(sizes)
        self._root: list[Float64] = [np.zeros((0, 0))] * len(sizes)  # Cholesky root of the pivot
        self._below: list[Float64] = [np.zeros((0, 0))] * len(sizes)  # what is below it in its columns
        self._parent = [-1] * len(sizes)
        updates: list[list[tuple[list[int], Float64]]] = [[] for _ in sizes]
        own: list[list[tuple[int, Float64]]] = [[] for _ in sizes]
        for (i, j), block in blocks.items():
            if rank[i] <= rank[j]:
                own[i].append((j, block.T))
            else:
                own[j].append((i, block))
        for node in self._order:
            beside = sorted(self._beside[node], key=rank.__getitem__)
            self._beside[node] = beside
            front = [node, *beside]
            rows = np.concatenate([np.arange(self.first[k], self.first[k + 1]) for k in front])
            place = dict(
                zip(front, np.concatenate([[0], np.cumsum([sizes[k] for k in front])]), strict=False)
            )
            matrix = np.zeros((len(rows), len(rows)))
            for other, block in own[node]:
                at = int(place[other])
                matrix[at : at + sizes[other], : sizes[node]] = block
            for members, update in updates[node]:
                at_rows = np.concatenate([np.arange(place[k], place[k] + sizes[k]) for k in members])
                matrix[np.ix_(at_rows, at_rows)] += update
            size = sizes[node]
            root = np.asarray(np.linalg.cholesky(matrix[:size, :size]), dtype=np.float64)
            below = solve_triangular(root, matrix[size:, :size].T, lower=True, check_finite=False).T
            self._rows[node], self._root[node], self._below[node] = rows[size:], root, below
            if beside:
                self._parent[node] = beside[0]
                updates[beside[0]].append((beside, matrix[size:, size:] - below @ below.T))
            updates[node] = []

    def solve(self, right: Float64) -> Float64:
        """Solve for one or many right-hand sides, (N,) or (N, K)."""
        result = np.array(right, dtype=np.float64)
        for node in self._order:
            own = slice(self.first[node], self.first[node + 1])
            result[own] = solve_triangular(self._root[node], result[own], lower=True, check_finite=False)
            result[self._rows[node]] -= self._below[node] @ result[own]
        for node in reversed(self._order):
            own = slice(self.first[node], self.first[node + 1])
            rest = result[own] - self._below[node].T @ result[self._rows[node]]
            result[own] = solve_triangular(self._root[node], rest, lower=True, trans="T", check_finite=False)
        return result

    def inverse_blocks(self) -> dict[tuple[int, int], Float64]:
        """Blocks of the inverse, ``(i, j)`` with ``i <= j``, on the diagonal and wherever the matrix has one."""
        fronts: dict[int, tuple[dict[int, int], Float64]] = {}
        waiting = [0] * len(self._parent)
        for parent in self._parent:
            if parent >= 0:
                waiting[parent] += 1
        blocks: dict[tuple[int, int], Float64] = {}
        for node in reversed(self._order):
            size = int(self.first[node + 1] - self.first[node])
            root_inverse = solve_triangular(self._root[node], np.eye(size), lower=True, check_finite=False)
            pivot = root_inverse.T @ root_inverse
            beside = self._beside[node]
            place, at = {}, 0
            for other in [node, *beside]:
                place[other] = at
                at += int(self.first[other + 1] - self.first[other])
            front = np.zeros((at, at))
            front[:size, :size] = pivot
            if beside:
                above_place, above = fronts[self._parent[node]]
                chosen = np.concatenate(
                    [above_place[k] + np.arange(self.first[k + 1] - self.first[k]) for k in beside]
                )
                known = above[np.ix_(chosen, chosen)]
                ratio = self._below[node] @ root_inverse
                side = -known @ ratio
                front[size:, size:] = known
                front[size:, :size] = side
                front[:size, size:] = side.T
                front[:size, :size] = pivot - ratio.T @ side
                waiting[self._parent[node]] -= 1
                if not waiting[self._parent[node]]:
                    del fronts[self._parent[node]]
            if waiting[node]:
                fronts[node] = place, front
            for other, at in place.items():
                width = int(self.first[other + 1] - self.first[other])
                block = front[:size, at : at + width]
                blocks[min(node, other), max(node, other)] = block if node <= other else block.T
        return blocks


def _eliminated(count: int, pairs: Sequence[tuple[int, int]]) -> tuple[list[int], list[list[int]]]:
    """Order of least degree, and for each node its neighbours when its turn comes."""
    beside: list[set[int]] = [set() for _ in range(count)]
    for i, j in pairs:
        if i != j:
            beside[i].add(j)
            beside[j].add(i)
    degrees: dict[int, set[int]] = {}
    for node in range(count):
        degrees.setdefault(len(beside[node]), set()).add(node)
    order = []
    for _ in range(count):
        least = min(degree for degree, nodes in degrees.items() if nodes)
        node = min(degrees[least])
        degrees[least].remove(node)
        order.append(node)
        for other in beside[node]:
            degrees[len(beside[other])].remove(other)
            beside[other] |= beside[node]
            beside[other] -= {node, other}
            degrees.setdefault(len(beside[other]), set()).add(other)
    return order, [sorted(nodes) for nodes in beside]
