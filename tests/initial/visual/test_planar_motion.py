"""Eq. 3 against known motions, OpenCV's estimate, and matches that follow none."""

import cv2
import numpy as np
import pytest

from trihedral.errors import OptionError
from trihedral.initial.visual.planar_motion import PlanarMotionOptions, planar_motion


def scene(seed, right=60, wrong=140, noise=0.3):
    rng = np.random.default_rng(seed)
    angle, shift = rng.uniform(-np.pi, np.pi), rng.uniform(-200, 200, 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    a = rng.uniform(0, 640, (right + wrong, 2))
    b = a @ turn.T + shift + rng.normal(0, noise, a.shape)
    b[right:] = rng.uniform(0, 640, (wrong, 2))
    return a, b, angle, shift


@pytest.mark.parametrize("seed", range(10))
def test_the_motion_is_found_among_twice_as_many_wrong_matches(seed):
    a, b, angle, shift = scene(seed)
    found = planar_motion(a, b, 3.0, 2000, np.random.default_rng(0))
    assert np.angle(np.exp(1j * (found.angle - angle))) == pytest.approx(0, abs=2e-3)
    assert np.allclose(found.shift, shift, atol=1.0)
    assert found.inliers[:60].mean() > 0.98
    assert found.inliers[60:].sum() <= 3


@pytest.mark.parametrize("seed", range(5))
def test_opencv_finds_the_same_motion(seed):
    a, b, _, _ = scene(seed, right=80, wrong=40)
    found = planar_motion(a, b, 3.0, 2000, np.random.default_rng(0))
    theirs, _ = cv2.estimateAffinePartial2D(a, b, method=cv2.RANSAC, ransacReprojThreshold=3.0)
    corners = np.array([[0, 0], [640, 0], [0, 640], [640, 640.0]])
    cos, sin = np.cos(found.angle), np.sin(found.angle)
    ours = corners @ np.array([[cos, -sin], [sin, cos]]).T + found.shift
    # OpenCV's has a scale too, so the two differ by what the noise lets it scale.
    assert np.allclose(ours, corners @ theirs[:, :2].T + theirs[:, 2], atol=0.8)


def test_a_zoom_is_not_a_rigid_motion():
    rng = np.random.default_rng(3)
    a = rng.uniform(0, 640, (50, 2))
    found = planar_motion(a, 2 * a, 2.0, 2000, rng)
    assert found is None or found.inliers.sum() < 15


def test_the_other_direction_gives_the_inverse():
    a, b, _, _ = scene(7, wrong=20)
    there = planar_motion(a, b, 3.0, 5000, np.random.default_rng(0))
    back = planar_motion(b, a, 3.0, 5000, np.random.default_rng(0))
    assert np.array_equal(there.inliers, back.inliers)
    assert there.angle + back.angle == pytest.approx(0, abs=1e-9)


def test_the_same_seed_gives_the_same_motion():
    a, b, _, _ = scene(2)
    one, two = (planar_motion(a, b, 3.0, 300, np.random.default_rng(5)) for _ in range(2))
    assert one.angle == two.angle and np.array_equal(one.inliers, two.inliers)


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_matches_have_no_motion(count):
    nothing = np.zeros((count, 2))
    assert planar_motion(nothing, nothing, 3.0, 100, np.random.default_rng(0)) is None


def test_matches_at_one_place_fix_no_angle():
    one = np.full((10, 2), 55.0)
    assert planar_motion(one, one, 3.0, 100, np.random.default_rng(0)) is None


def test_options_that_make_no_sense_are_refused():
    with pytest.raises(OptionError, match="tolerance"):
        PlanarMotionOptions(tolerance=0)
    with pytest.raises(OptionError, match="samples"):
        PlanarMotionOptions(samples=0)
