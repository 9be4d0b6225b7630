import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.yard import rectangle, yard
from trihedral.final.planes.choice import consistent_pairs
from trihedral.final.planes.match import match_planes
from trihedral.final.planes.options import PlaneMatchingOptions
from trihedral.final.planes.pose import PlanesRefused
from trihedral.geometry.se3 import distance, inverse, motion, transform

POSE = motion(
    Rotation.from_euler("xyz", [4.0, -6.0, 140.0], degrees=True).as_matrix(), np.array([7.0, -3.0, 0.4])
)


def coarse(pose: np.ndarray, degrees: tuple[float, float, float] = (3.0, -2.0, 8.0)) -> np.ndarray:
    """A pose that is off as initial alignments are."""
    off = motion(Rotation.from_euler("xyz", degrees, degrees=True).as_matrix(), np.array([1.0, -0.8, 0.3]))
    return off @ pose


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
    cosines = [(POSE[:3, :3] @ pair.a.normal) @ pair.b.normal for pair in pairs]
    assert len(pairs) >= 4 and np.allclose(np.abs(cosines), 1.0, atol=1e-4)
    assert [pair.sign for pair in pairs] == [np.sign(cosine) for cosine in cosines]


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
