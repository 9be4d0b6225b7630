"""Walks over graphs against their definitions, on random graphs."""

import numpy as np
import pytest

from trihedral.network.graph.connectivity import Tree, blocks, component_labels, components, path, triangles


def graph(seed, count=14, links=17):
    rng = np.random.default_rng(seed)
    pairs = {(min(p), max(p)) for p in rng.integers(count, size=(links, 2)).tolist() if p[0] != p[1]}
    return count, [(b, a) if rng.uniform() < 0.5 else (a, b) for a, b in sorted(pairs)]


def reached(count, ends):
    """Which stations are reached from which: powers of the adjacency."""
    matrix = np.eye(count, dtype=bool)
    for a, b in ends:
        matrix[a, b] = matrix[b, a] = True
    for _ in range(count):
        matrix = matrix @ matrix
    return matrix


@pytest.mark.parametrize("seed", range(8))
def test_parts_blocks_paths_and_triangles(seed):
    count, ends = graph(seed)
    together = reached(count, ends)
    for part in components(count, ends):
        assert all(set(np.flatnonzero(together[s])) == set(part) for s in part)
    # Two stations are in one block if no single link parts them.
    firm = together.copy()
    for k in range(len(ends)):
        firm &= reached(count, ends[:k] + ends[k + 1 :])
    expected = {tuple(np.flatnonzero(row).tolist()) for row in firm}
    assert {tuple(block) for block in blocks(count, ends)} == expected
    adjacency = np.zeros((count, count), dtype=np.int64)
    for a, b in ends:
        adjacency[a, b] = adjacency[b, a] = 1
    assert len(triangles(ends)) == np.trace(np.linalg.matrix_power(adjacency, 3)) // 6
    hops = np.where(np.eye(count, dtype=bool), 0, np.inf)
    for length in range(1, count):
        hops[(np.linalg.matrix_power(adjacency, length) > 0) & np.isinf(hops)] = length
    for a in range(count):
        for b in range(count):
            way = path(count, ends, a, b)
            assert (way is None) == np.isinf(hops[a, b])
            assert way is None or len(way) == hops[a, b]


def test_a_tree_takes_the_first_links_and_walks_over_them_only():
    ends = [(0, 1), (1, 2), (0, 2), (2, 3), (5, 4)]
    tree = Tree(6, ends, [2, 0, 1, 3, 4])
    assert tree.inside.tolist() == [True, False, True, True, True]
    assert tree.walk(1, 3) == [1, 0, 2, 3]
    assert tree.meeting(np.array([1, 3, 3, 4]), np.array([3, 1, 2, 5])).tolist() == [0, 0, 2, 4]


def test_a_component_is_called_by_its_least_station():
    assert component_labels(6, [(5, 3), (1, 4), (4, 2)]).tolist() == [0, 1, 1, 3, 1, 3]
