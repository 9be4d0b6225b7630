"""Poses from matches whose truth is known: a distant scene, a near one, wrong matches, none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.errors import OptionError
from trihedral.geometry.se3 import distance, inverse, motion, transform
from trihedral.initial.visual.alignment import VisualOptions, visual_alignment
from trihedral.initial.visual.features import Features
from trihedral.initial.visual.rigid_agreement import rigid_agreement

SIZE, FOCAL = (640, 480), 500.0


def unlike(rng, count):
    values = rng.normal(size=(count, 64))
    return np.rint(512 * values / np.linalg.norm(values, axis=1, keepdims=True)).astype(np.float32)


def features(name, pixels, points, descriptors):
    count = len(pixels)
    return Features(
        name,
        SIZE,
        pixels,
        np.full(count, 2.0),
        np.zeros(count),
        np.zeros(count, dtype=np.int8),
        descriptors,
        points,
        np.linalg.norm(points, axis=1) / FOCAL,
    )


def project(points):
    return points[:, :2] / points[:, 2:] * FOCAL + [320, 240]


def stations(seed, near, far, b_from_a, count=120, wrong=0.5, noise=0.01):
    """Pictures along z of both stations; a share of the descriptors belongs to other places."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(near, far, count)
    a = np.column_stack([rng.uniform(-0.5, 0.5, count) * z, rng.uniform(-0.4, 0.4, count) * z, z])
    b = transform(b_from_a, a)
    appearance = unlike(rng, count)
    others = rng.permutation(count)[: int(wrong * count)]
    looks_b = appearance.copy()
    looks_b[others] = appearance[np.roll(others, 1)]
    noisy = [points + rng.normal(0, noise, points.shape) for points in (a, b)]
    one = features("a", project(a), noisy[0], appearance)
    two = features("b", project(b), noisy[1], looks_b)
    # A second picture of each that has nothing to do with the other's.
    blank = [
        features(f"{k}-blank", rng.uniform(0, 480, (40, 2)), rng.uniform(3, 9, (40, 3)), unlike(rng, 40))
        for k in "ab"
    ]
    return [blank[0], one], [two, blank[1]]


SMALL_TURN = motion(Rotation.from_euler("z", 12, degrees=True).as_matrix(), np.array([0.3, -0.2, 0.1]))
BIG_STEP = motion(Rotation.from_euler("yz", [20, 5], degrees=True).as_matrix(), np.array([-1.5, 0.2, 0.4]))


@pytest.mark.parametrize("seed", range(4))
def test_a_distant_scene_is_aligned_through_eq_3(seed):
    a, b = stations(seed, 20, 40, SMALL_TURN)
    found = visual_alignment(a, b)
    assert found.gate == "planar-motion" and found.reason == ""
    metres, radians = distance(found.pose, SMALL_TURN)
    assert metres < 0.1 and np.degrees(radians) < 0.2
    best = found.pairs[0]
    assert (best.view_a, best.view_b) == ("a", "b")
    assert best.planar[best.agreeing].all() and found.agreeing >= 50
    assert found.picture_pairs == 4


@pytest.mark.parametrize("seed", range(4))
def test_a_near_scene_is_aligned_where_eq_3_cannot_hold(seed):
    a, b = stations(seed, 1.5, 9, BIG_STEP, wrong=0.3)
    found = visual_alignment(a, b)
    metres, radians = distance(found.pose, BIG_STEP)
    assert metres < 0.06 and np.degrees(radians) < 0.6
    without = visual_alignment(a, b, VisualOptions(gate="none"))
    metres, radians = distance(without.pose, BIG_STEP)
    assert metres < 0.02 and np.degrees(radians) < 0.2
    assert without.gate == "none" and without.reason == ""
    assert without.agreeing >= 0.6 * 120
    if found.gate == "none":
        assert "Eq. 3" in found.reason


def test_matches_agree_exactly_where_they_are_right():
    a, b = stations(1, 3, 9, SMALL_TURN)
    pair = visual_alignment(a, b, VisualOptions(gate="none")).pairs[0]
    right = np.linalg.norm(transform(SMALL_TURN, pair.points_a) - pair.points_b, axis=1) < 0.05
    assert np.array_equal(pair.agreeing, right)
    assert pair.planar.all()


def test_both_ways_round_are_inverse():
    a, b = stations(3, 4, 30, SMALL_TURN, wrong=0.6)
    for gate in ("planar-motion", "none"):
        there = visual_alignment(a, b, VisualOptions(gate=gate))
        back = visual_alignment(b, a, VisualOptions(gate=gate))
        metres, radians = distance(there.pose, inverse(back.pose))
        assert metres < 1e-6 and radians < 1e-6


def test_pictures_of_other_places_are_refused_in_words():
    a, _ = stations(1, 3, 9, SMALL_TURN)
    _, b = stations(2, 3, 9, SMALL_TURN)
    for gate in ("planar-motion", "none"):
        found = visual_alignment(a, b, VisualOptions(gate=gate))
        assert found.pose is None and np.isnan(found.rmse)
        assert "matches" in found.reason and found.reason.endswith(".")


def test_matches_that_all_are_wrong_are_refused():
    a, b = stations(1, 3, 9, SMALL_TURN, wrong=1.0)
    found = visual_alignment(a, b)
    assert found.pose is None and "agree in 3D" in found.reason
    assert found.matches > 100 and found.pairs


def test_one_place_seen_in_many_keypoints_is_one_place():
    rng = np.random.default_rng(0)
    points = np.repeat(rng.uniform(3, 6, (4, 3)), 10, axis=0) + rng.normal(0, 0.001, (40, 3))
    appearance = unlike(rng, 40)
    one = features("a", rng.uniform(0, 400, (40, 2)), points, appearance)
    found = visual_alignment([one], [one], VisualOptions(gate="none"))
    assert found.pose is None and "only 4 places" in found.reason


def test_matches_on_a_line_are_refused():
    rng = np.random.default_rng(0)
    points = np.linspace(0, 5, 30)[:, None] * [0.6, 0.0, 0.8] + [0, 0, 3]
    one = features("a", project(points), points, unlike(rng, 30))
    found = visual_alignment([one], [one])
    assert found.pose is None and found.reason


def test_no_pictures_are_a_refusal_not_a_crash():
    assert visual_alignment([], []).pose is None
    empty = features("a", np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 64), np.float32))
    assert visual_alignment([empty], [empty]).pose is None


@pytest.mark.parametrize("seed", range(5))
def test_agreement_finds_one_right_match_in_twelve(seed):
    rng = np.random.default_rng(seed)
    a = rng.uniform(-8, 8, (360, 3))
    true = motion(Rotation.random(rng=rng).as_matrix(), rng.uniform(-20, 20, 3))
    b = rng.uniform(-20, 20, (360, 3))
    right = rng.permutation(360)[:30]
    b[right] = transform(true, a[right]) + rng.normal(0, 0.015, (30, 3))
    found = rigid_agreement(a, b, np.full(360, 0.06))
    assert found.inliers[right].sum() >= 28 and found.inliers.sum() <= 32
    metres, radians = distance(found.pose, true)
    assert metres < 0.05 and np.degrees(radians) < 0.3


def test_agreement_needs_three_matches():
    assert rigid_agreement(np.eye(3)[:2], np.eye(3)[:2], np.full(2, 0.1)) is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"gate": "homography"},
        {"tolerance": 0.0},
        {"picture_pairs": 0},
        {"least_agreeing": 2},
        {"tolerance_pixels": -1},
    ],
)
def test_options_that_make_no_sense_are_refused(wrong):
    with pytest.raises(OptionError):
        VisualOptions(**wrong)
