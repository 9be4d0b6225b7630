"""The sparse normal matrix against NumPy's dense inverse."""

import numpy as np
import pytest

from trihedral.network.adjustment.sparse_cholesky import NormalMatrix

RNG = np.random.default_rng(5)


def scattered(sizes, pairs):
    """A positive definite matrix with blocks in some places, dense and as blocks."""
    first = np.concatenate([[0], np.cumsum(sizes)])
    dense = np.zeros((first[-1], first[-1]))
    for i, j in pairs:
        rows = np.r_[first[i] : first[i + 1], first[j] : first[j + 1]]
        root = RNG.normal(size=(len(rows), len(rows)))
        dense[np.ix_(rows, rows)] += root @ root.T

    def block(i, j):
        return dense[first[i] : first[i + 1], first[j] : first[j + 1]]

    stored = {(min(p), max(p)) for p in pairs} | {(k, k) for k in range(len(sizes))}
    return dense, {(i, j): block(i, j) for i, j in stored}, block, first


SIZES = [6, 3, 6, 6, 3, 6, 6, 6, 3, 6]
PAIRS = [(0, 1), (0, 2), (5, 2), (2, 3), (4, 3), (3, 5), (5, 6), (7, 6), (7, 0), (8, 9), (9, 7), (6, 2)]

# All nodes beside each other; a lattice, in which some come to have the same neighbours; parts, one of a single node.
CLIQUE = [(i, j) for i in range(6) for j in range(i)]
LATTICE = [(k, k + step) for k in range(48) for step in (1, 7) if k + step < 49 and (step > 1 or k % 7 < 6)]
APART = [(0, 1), (1, 2), (3, 4), (5, 5)]


@pytest.mark.parametrize(
    ("sizes", "pairs"),
    [(SIZES, PAIRS), ([6] * 6, CLIQUE), ([6, 3] * 24 + [6], LATTICE), ([6, 3, 6, 6, 3, 6], APART)],
    ids=["some", "clique", "lattice", "apart"],
)
def test_solution_and_inverse_are_those_of_the_dense_matrix(sizes, pairs):
    dense, blocks, _, first = scattered(sizes, pairs)
    normal = NormalMatrix(sizes, blocks)
    right = RNG.normal(size=(len(dense), 4))
    np.testing.assert_allclose(dense @ normal.solve(right), right, atol=1e-9)
    np.testing.assert_allclose(normal.solve(right[:, 0]), normal.solve(right)[:, 0], atol=1e-12)
    inverse, found = np.linalg.inv(dense), normal.inverse_blocks()
    assert found.keys() >= blocks.keys()
    for (i, j), block in found.items():
        expected = inverse[first[i] : first[i + 1], first[j] : first[j + 1]]
        np.testing.assert_allclose(block, expected, rtol=1e-8, atol=1e-10)


def test_what_is_not_determined_is_not_solved():
    with pytest.raises(np.linalg.LinAlgError):
        NormalMatrix([2], {(0, 0): np.diag([1.0, 0.0])})
