import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.final.planes.match import (
    Plane,
    PlaneMatchingOptions,
    PlanesRefused,
    consistent_pairs,
    corner,
    first_three,
    match_planes,
    pair_by_normals,
    segment,
    sequential_rotation,
)
from trihedral.geometry.se3 import distance, inverse, motion, rotation_between, transform

POSE = motion(
    Rotation.from_euler("xyz", [4.0, -6.0, 140.0], degrees=True).as_matrix(), np.array([7.0, -3.0, 0.4])
)


def coarse(pose: np.ndarray, degrees: tuple[float, float, float] = (3.0, -2.0, 8.0)) -> np.ndarray:
    """A pose that is off as initial alignments are."""
    off = motion(Rotation.from_euler("xyz", degrees, degrees=True).as_matrix(), np.array([1.0, -0.8, 0.3]))
    return off @ pose


def rectangle(rng: np.random.Generator, origin: list[float], u: list[float], v: list[float]) -> np.ndarray:
    """100 points a square metre, 5 mm of noise across."""
    u_, v_ = np.array(u), np.array(v)
    area = np.linalg.norm(np.cross(u_, v_))
    normal = np.cross(u_, v_) / area
    s, t = rng.uniform(size=(2, int(100 * area), 1))
    return origin + s * u_ + t * v_ + rng.normal(scale=0.005, size=s.shape) * normal


def yard(seed: int) -> np.ndarray:
    """Ground of 14 x 10 m, walls of 10 x 5 and 14 x 3 m that are 100 degrees apart, and clutter."""
    rng = np.random.default_rng(seed)
    skewed = [14 * np.cos(np.radians(10)), 14 * np.sin(np.radians(10)), 0.0]
    return np.concatenate(
        [
            rectangle(rng, [0, 0, -1.6], [14, 0, 0], [0, 10, 0]),
            rectangle(rng, [0, 0, -1.6], [0, 10, 0], [0, 0, 5]),
            rectangle(rng, [0, 0, -1.6], skewed, [0, 0, 3]),
            rng.uniform([1, 1, -1.6], [9, 8, 2], (2500, 3)),
        ]
    )


def plane(normal: list[float], distance: float = 1.0, points: int = 1) -> Plane:
    unit = np.array(normal) / np.linalg.norm(normal)
    return Plane(unit, distance, 0.0, unit * distance, np.zeros(points, dtype=np.uint32))


def test_equation_5_is_the_shortest_rotation_and_has_its_degenerate_cases() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        v1, v2 = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        found = rotation_between(v1, v2)
        axis = np.cross(v1, v2) / np.linalg.norm(np.cross(v1, v2))
        expected = Rotation.from_rotvec(axis * np.arccos(v1 @ v2)).as_matrix()
        np.testing.assert_allclose(found, expected, atol=1e-7)
    same = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(rotation_between(same, same), np.eye(3), atol=1e-15)
    for v in (*np.eye(3), same):
        half_turn = rotation_between(v, -v)
        np.testing.assert_allclose(half_turn @ v, -v, atol=1e-12)
        assert np.isclose(np.linalg.det(half_turn), 1.0) and np.isclose(np.trace(half_turn), -1.0)
    # Next to opposite, the formula still turns by nearly 180 degrees and stays a rotation.
    near = Rotation.from_rotvec([0, np.pi - 1e-5, 0]).as_matrix() @ same
    np.testing.assert_allclose(rotation_between(same, near) @ same, near, atol=1e-9)


def test_equation_6_is_the_rotation_between_corners_of_the_same_shape() -> None:
    rng = np.random.default_rng(2)
    for _ in range(30):
        normals = rng.normal(size=(3, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        turn = Rotation.from_rotvec(rng.normal(scale=0.4, size=3))
        found = sequential_rotation(normals, turn.apply(normals))
        assert np.isclose(np.linalg.det(found), 1.0)
        # The last pair is exact; that the others are near shows only after the second rotation has turned about the
        # first normal, which the shortest rotation does where the normals are at right angles.
        np.testing.assert_allclose(found @ normals[2], turn.apply(normals[2]), atol=1e-9)
    frame = Rotation.random(rng=rng).as_matrix()
    turn = Rotation.from_euler("xyz", [4, -3, 9], degrees=True).as_matrix()
    found = sequential_rotation(frame, frame @ turn.T)
    np.testing.assert_allclose(found, turn, atol=2e-2)


def test_equation_7_against_a_linear_solver() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        point = rng.normal(scale=20, size=3)
        normals = np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.normal(scale=0.1, size=(3, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        distances = normals @ point
        np.testing.assert_allclose(corner(normals, distances), point, atol=1e-9)
        expected = np.linalg.lstsq(normals, distances, rcond=None)[0]
        np.testing.assert_allclose(corner(normals, distances), expected, atol=1e-9)
    with pytest.raises(PlanesRefused, match="no corner"):
        corner(np.array([[1.0, 0, 0], [0, 1.0, 0], [np.sqrt(0.5), np.sqrt(0.5), 0]]), np.ones(3))


def test_a_whole_match_is_near_the_truth_from_either_side() -> None:
    b = yard(1)
    a = transform(inverse(POSE), yard(2))
    there = match_planes(a, b, coarse(POSE), (1, 2))
    metres, radians = distance(there.pose, POSE)
    assert metres < 0.01 and np.degrees(radians) < 0.05
    np.testing.assert_allclose(transform(POSE, there.corner_a[None])[0], there.corner_b, atol=0.01)
    np.testing.assert_allclose(there.corner_b, [0.0, 0.0, -1.6], atol=0.01)
    assert [p.points for p in there.planes_b] == sorted((p.points for p in there.planes_b), reverse=True)
    back = match_planes(b, a, inverse(coarse(POSE)), (2, 1))
    metres, radians = distance(back.pose, inverse(POSE))
    assert metres < 0.02 and np.degrees(radians) < 0.05


def test_planes_are_found_largest_first_and_share_no_point() -> None:
    found = segment(yard(4), seed=7)
    sizes = [p.points for p in found]
    assert sizes == sorted(sizes, reverse=True)
    together = np.concatenate([p.inliers for p in found])
    assert len(np.unique(together)) == len(together)
    expected = [
        ([0, 0, 1], 1.6),
        ([1, 0, 0], 0.0),
        ([-np.sin(np.radians(10)), np.cos(np.radians(10)), 0], 0.0),
    ]
    for got, (normal, distance_) in zip(found, expected, strict=False):
        assert abs(got.normal @ normal) > 0.99999
        assert got.distance == pytest.approx(distance_, abs=0.003)


@pytest.mark.parametrize(
    ("planes", "reason"),
    [
        ([], "only 0"),
        ([plane([0, 0, 1]), plane([1, 0, 0])], "only 2"),
        ([plane([0, 0, 1]), plane([0, 0, 1], 4.0), plane([0.02, 0, 1]), plane([0, 0.02, -1])], "parallel"),
        ([plane([1, 0, 0]), plane([0, 1, 0]), plane([1, 1, 0]), plane([1, -0.3, 0.01])], "upright"),
    ],
)
def test_planes_without_a_corner_are_refused_in_words(planes: list[Plane], reason: str) -> None:
    with pytest.raises(PlanesRefused, match=reason):
        first_three(planes)


def test_nearly_parallel_planes_are_passed_over_for_a_later_one() -> None:
    planes = [plane([0, 0, 1]), plane([0.05, 0, 1]), plane([1, 0, 0]), plane([1, 0.1, 0]), plane([0, 1, 0.1])]
    assert first_three(planes) == (planes[0], planes[2], planes[4])


def test_pairing_finds_the_order_and_the_signs() -> None:
    normals = np.array([[0.0, 0, 1], [1, 0, 0], [np.sin(0.2), np.cos(0.2), 0]])
    turned = normals @ Rotation.from_euler("xyz", [4, 3, 10], degrees=True).as_matrix().T
    order, signs = pair_by_normals(turned[[2, 0, 1]] * [[1], [-1], [-1]], normals)
    assert order == (1, 2, 0)
    assert signs == (-1.0, -1.0, 1.0)


def test_pairings_that_cannot_be_told_apart_or_do_not_fit_are_refused() -> None:
    normals = np.eye(3)
    half_way = normals @ Rotation.from_euler("z", 44, degrees=True).as_matrix().T
    with pytest.raises(PlanesRefused, match="ambiguous"):
        pair_by_normals(half_way, normals, PlaneMatchingOptions(widest=np.radians(60)))
    other = np.array([[0.0, 0, 1], [1, 0, 0], [np.sqrt(0.5), np.sqrt(0.5), 0]])
    with pytest.raises(PlanesRefused, match="not the same"):
        pair_by_normals(other, normals)


def test_parallel_walls_are_told_apart_by_the_motion_that_lays_most_planes_on_each_other() -> None:
    """A second wall 2.5 m behind the first, and a start that is 2 m off: the nearer wall is the wrong one."""
    rng = np.random.default_rng(8)

    def walls() -> np.ndarray:
        behind = rectangle(rng, [-2.5, 0, -1.6], [0, 10, 0], [0, 0, 5])
        return np.concatenate([yard(int(rng.integers(100))), behind])

    b, a = walls(), transform(inverse(POSE), walls())
    start = motion(translation=np.array([-2.0, 0.3, 0.1])) @ coarse(POSE, (1.0, -1.0, 2.0))
    found = match_planes(a, b, start, (1, 2))
    metres, radians = distance(found.pose, POSE)
    assert metres < 0.02 and np.degrees(radians) < 0.1
    pairs = consistent_pairs(found.found_a, found.found_b, a, b, start)
    true_normals = [(POSE[:3, :3] @ found.found_a[i].normal) @ found.found_b[j].normal for i, j, _ in pairs]
    assert len(pairs) >= 4 and np.allclose(np.abs(true_normals), 1.0, atol=1e-4)
    assert [sign for _, _, sign in pairs] == [np.sign(cosine) for cosine in true_normals]


def test_the_three_largest_of_each_scan_are_taken_where_that_is_asked_for() -> None:
    """A wall that only the moving scan sees is larger than those that both see: the paper's words go wrong."""
    rng = np.random.default_rng(6)
    b = yard(1)
    seen_once = rectangle(rng, [0, 30, -1.6], [14, 0, 0], [0, 0, 12])
    a = transform(inverse(POSE), np.concatenate([yard(2), seen_once]))
    start = coarse(POSE, (0.5, -0.5, 1.0))
    largest = match_planes(a, b, start, (1, 2), PlaneMatchingOptions(choice="largest"))
    told = match_planes(a, b, start, (1, 2))
    assert distance(largest.pose, POSE)[0] > 5.0
    assert distance(told.pose, POSE)[0] < 0.02


def test_a_plain_field_and_a_few_points_are_refused_naming_the_scan() -> None:
    rng = np.random.default_rng(5)
    field = rectangle(rng, [0, 0, 0], [20, 0, 0], [0, 20, 0])
    with pytest.raises(PlanesRefused, match="moving scan, only 1 of the three"):
        match_planes(field, yard(1), np.eye(4), (1, 2))
    with pytest.raises(PlanesRefused, match="reference scan, only 0"):
        match_planes(yard(1), np.zeros((2, 3)), np.eye(4), (1, 2))
    line = np.linspace([0, 0, 0], [9, 9, 9], 500)
    with pytest.raises(PlanesRefused, match="only 0"):
        match_planes(line, line, np.eye(4), (1, 2))


def test_same_seed_same_bits_whatever_the_number_of_threads() -> None:
    script = """
import numpy as np
from trihedral.final.planes.match import segment
rng = np.random.default_rng(1)
points = rng.uniform(-5, 5, (20000, 3)); points[:8000, 2] = rng.normal(scale=0.01, size=8000)
points[8000:12000, 0] = rng.normal(scale=0.01, size=4000)
for plane in segment(points, 3):
    print(plane.normal.tobytes().hex(), plane.distance.hex(), plane.inliers.sum())
"""
    runs = {
        subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "RAYON_NUM_THREADS": str(threads)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in (1, 2, 5)
    }
    assert len(runs) == 1 and runs.pop().count("\n") >= 2
