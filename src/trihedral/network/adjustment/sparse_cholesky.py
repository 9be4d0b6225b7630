"""A sparse normal matrix: solved, and the part of its inverse that lies where it has entries itself.

SciPy's sparse solver gives no such part, and solving for it costs minutes at a thousand stations where this takes a
second; gtsam gives it one pair of unknowns at a time.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import solve_triangular

from trihedral.geometry.arrays import Float64, Int64

_NO_ROWS = np.zeros(0, dtype=np.int64)


class NormalMatrix:
    """A symmetric positive definite matrix of blocks, factored.

    Blocks are eliminated in the order of least degree (Tinney and Walker 1967), those with the same neighbours at once
    (George and Liu 1989), as a dense matrix over them and their neighbours at the time (multifrontal, Duff and Reid
    1983). The inverse goes back the same way (Takahashi et al. 1973).

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
        first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._rows_of = [np.arange(first[node], first[node + 1]) for node in range(len(sizes))]
        self._fronts = _eliminated(len(sizes), list(blocks))
        rank = {node: place for place, node in enumerate(node for group, _ in self._fronts for node in group)}
        front_of = [0] * len(sizes)
        for number, (group, beside) in enumerate(self._fronts):
            beside.sort(key=rank.__getitem__)
            for node in group:
                front_of[node] = number
        own: list[list[tuple[int, int, Float64]]] = [[] for _ in self._fronts]
        for (i, j), block in blocks.items():
            if rank[i] <= rank[j]:
                own[front_of[i]].append((j, i, block.T))
            else:
                own[front_of[j]].append((i, j, block))
        self._pivots: list[Int64] = []  # rows of each front's group
        self._rows: list[Int64] = []  # and of what is beside it
        self._root: list[Float64] = []  # Cholesky root of the pivot
        self._below: list[Float64] = []  # what is below it in its columns
        self._parent = [front_of[beside[0]] if beside else -1 for _, beside in self._fronts]
        updates: list[list[tuple[list[int], Float64]]] = [[] for _ in self._fronts]
        for number, (group, beside) in enumerate(self._fronts):
            size = sum(sizes[node] for node in group)
            place = self._places([*group, *beside])
            matrix = np.zeros((size + sum(sizes[node] for node in beside),) * 2)
            for i, j, block in own[number]:
                matrix[np.ix_(place[i], place[j])] = block
            for nodes, update in updates[number]:
                at = np.concatenate([place[node] for node in nodes])
                matrix[np.ix_(at, at)] += update
            updates[number] = []
            # Only the lower triangle is whole, and only that is read.
            root = np.asarray(np.linalg.cholesky(matrix[:size, :size]), dtype=np.float64)
            below = solve_triangular(root, matrix[size:, :size].T, lower=True, check_finite=False).T
            self._pivots.append(np.concatenate([self._rows_of[node] for node in group]))
            self._rows.append(np.concatenate([_NO_ROWS, *(self._rows_of[node] for node in beside)]))
            self._root.append(root)
            self._below.append(below)
            if beside:
                updates[self._parent[number]].append((beside, matrix[size:, size:] - below @ below.T))

    def _places(self, nodes: Sequence[int]) -> dict[int, Int64]:
        """Rows of each of some nodes in the front that they make, one after the other."""
        places, at = {}, 0
        for node in nodes:
            width = len(self._rows_of[node])
            places[node] = np.arange(at, at + width)
            at += width
        return places

    def solve(self, right: Float64) -> Float64:
        """Solve for one or many right-hand sides, (N,) or (N, K)."""
        result = np.array(right, dtype=np.float64)
        factors = list(zip(self._pivots, self._rows, self._root, self._below, strict=True))
        for pivots, rows, root, below in factors:
            result[pivots] = solve_triangular(root, result[pivots], lower=True, check_finite=False)
            result[rows] -= below @ result[pivots]
        for pivots, rows, root, below in reversed(factors):
            rest = result[pivots] - below.T @ result[rows]
            result[pivots] = solve_triangular(root, rest, lower=True, trans="T", check_finite=False)
        return result

    def inverse_blocks(self) -> dict[tuple[int, int], Float64]:
        """Blocks of the inverse, ``(i, j)`` with ``i <= j``, on the diagonal and wherever the matrix has one."""
        fronts: dict[int, tuple[dict[int, Int64], Float64]] = {}
        waiting = Counter(self._parent)
        blocks: dict[tuple[int, int], Float64] = {}
        for number in reversed(range(len(self._fronts))):
            group, beside = self._fronts[number]
            size = len(self._pivots[number])
            root_inverse = solve_triangular(self._root[number], np.eye(size), lower=True, check_finite=False)
            pivot = root_inverse.T @ root_inverse
            places = self._places([*group, *beside])
            front = np.zeros((size + len(self._rows[number]),) * 2)
            front[:size, :size] = pivot
            if beside:
                parent = self._parent[number]
                above_places, above = fronts[parent]
                chosen = np.concatenate([above_places[node] for node in beside])
                known = above[np.ix_(chosen, chosen)]
                ratio = self._below[number] @ root_inverse
                side = -known @ ratio
                front[size:, size:] = known
                front[size:, :size] = side
                front[:size, size:] = side.T
                front[:size, :size] = pivot - ratio.T @ side
                waiting[parent] -= 1
                if not waiting[parent]:
                    del fronts[parent]
            if waiting[number]:
                fronts[number] = places, front
            for node in group:
                for other, columns in places.items():
                    block = front[np.ix_(places[node], columns)]
                    blocks[min(node, other), max(node, other)] = block if node <= other else block.T
        return blocks


def _eliminated(count: int, pairs: Sequence[tuple[int, int]]) -> list[tuple[list[int], list[int]]]:
    """Nodes in the order of least degree, and those beside them when their turn comes.

    Nodes that have the same neighbours, and each other, go at once.
    """
    # With itself: what goes together has the same.
    beside: list[set[int]] = [{node} for node in range(count)]
    for i, j in pairs:
        beside[i].add(j)
        beside[j].add(i)
    degrees: dict[int, set[int]] = {}
    for node in range(count):
        degrees.setdefault(len(beside[node]), set()).add(node)
    fronts: list[tuple[list[int], list[int]]] = []
    left = count
    while left:
        least = min(degree for degree, nodes in degrees.items() if nodes)
        node = min(degrees[least])
        front = beside[node]
        group = [other for other in sorted(front & degrees[least]) if beside[other] == front]
        degrees[least].difference_update(group)
        left -= len(group)
        rest = front.difference(group)
        for other in rest:
            degrees[len(beside[other])].remove(other)
            beside[other] |= rest
            beside[other].difference_update(group)
            degrees.setdefault(len(beside[other]), set()).add(other)
        fronts.append((group, list(rest)))
    return fronts
