"""Kabsch (Eq. 4) against SciPy's solution of the same problem, closed forms, and points that fix no motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from trihedral.geometry.kabsch import UndeterminedMotion, kabsch
from trihedral.geometry.se3 import inverse, motion, transform


def some_motion(rng):
    return motion(Rotation.random(rng=rng).as_matrix(), rng.uniform(-50, 50, 3))


@given(st.integers(0, 10_000), st.integers(3, 40))
def test_an_exact_motion_is_found(seed, count):
    rng = np.random.default_rng(seed)
    true, points = some_motion(rng), rng.normal(0, 5, (count, 3))
    assert np.allclose(kabsch(points, transform(true, points)), true, atol=1e-8)


@given(st.integers(0, 10_000))
def test_noisy_weighted_points_give_what_scipy_gives(seed):
    rng = np.random.default_rng(seed)
    a = rng.normal(0, 5, (30, 3))
    b = transform(some_motion(rng), a) + rng.normal(0, 0.3, a.shape)
    w = rng.uniform(0.01, 3, len(a))
    centre_a, centre_b = (np.average(p, axis=0, weights=w) for p in (a, b))
    turn, _ = Rotation.align_vectors(b - centre_b, a - centre_a, weights=w)
    found = kabsch(a, b, w)
    assert np.allclose(found[:3, :3], turn.as_matrix(), atol=1e-9)
    assert np.allclose(transform(found, centre_a[None]), centre_b, atol=1e-9)
    assert np.allclose(kabsch(b, a, w), inverse(found), atol=1e-9)


def test_points_of_no_weight_do_not_count():
    rng = np.random.default_rng(4)
    true, a = some_motion(rng), rng.normal(0, 5, (8, 3))
    b = transform(true, a)
    b[5:] += 100
    assert np.allclose(kabsch(a, b, [1, 1, 1, 1, 1, 0, 0, 0]), true, atol=1e-9)


@given(st.integers(0, 10_000))
def test_mirrored_points_get_the_best_rotation_never_a_reflection(seed):
    rng = np.random.default_rng(seed)
    a = rng.normal(0, 1, (20, 3)) * [5, 3, 1]
    b = a * [1, 1, -1] + rng.normal(0, 0.01, a.shape)
    found = kabsch(a, b)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)
    turn, _ = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
    assert np.allclose(found[:3, :3], turn.as_matrix(), atol=1e-6)


def test_flat_points_are_enough():
    rng = np.random.default_rng(1)
    true, a = some_motion(rng), rng.normal(0, 5, (4, 3)) * [1, 1, 0]
    found = kabsch(a, transform(true, a))
    assert np.allclose(found, true, atol=1e-9)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_points_are_refused(count):
    with pytest.raises(UndeterminedMotion, match=f"at least three.*{count}"):
        kabsch(np.eye(3)[:count], np.eye(3)[:count])


@pytest.mark.parametrize("weights", [None, [1.0, 2.0, 0.5, 1.0]])
def test_points_on_a_line_are_refused_also_as_float32(weights):
    line = (np.array([0.3, -0.7, 0.2]) * np.array([0, 1.1, 2.7, 9.4])[:, None] + 3).astype(np.float32)
    with pytest.raises(UndeterminedMotion, match="one line"):
        kabsch(line, line, weights)
    spread = np.random.default_rng(0).normal(size=(4, 3))
    with pytest.raises(UndeterminedMotion, match="one line"):
        kabsch(spread, line, weights)


def test_points_at_one_place_are_refused():
    with pytest.raises(UndeterminedMotion):
        kabsch(np.ones((5, 3)), np.ones((5, 3)))


def test_a_mirrored_copy_that_several_rotations_fit_is_refused():
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    with pytest.raises(UndeterminedMotion, match="several rotations"):
        kabsch(corners, -corners)


@pytest.mark.parametrize(
    ("a", "b", "weights"),
    [
        (np.zeros((4, 3)), np.zeros((5, 3)), None),
        (np.zeros((4, 2)), np.zeros((4, 2)), None),
        (np.eye(3), np.eye(3) * np.nan, None),
        (np.eye(3), np.eye(3), [1, 1, -1]),
        (np.eye(3), np.eye(3), [1, 1]),
    ],
)
def test_what_are_no_matched_points_is_said(a, b, weights):
    with pytest.raises(ValueError, match=r"points|weights"):
        kabsch(a, b, weights)
