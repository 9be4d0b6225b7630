import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from trihedral.errors import OptionError
from trihedral.geometry.motion import inverse, motion, transform
from trihedral.overlap.nearest import OverlapOptions, has_neighbour, overlap


def strip(start: float, end: float) -> np.ndarray:
    x, y = np.meshgrid(np.arange(start, end, 0.1), np.arange(0.0, 5.0, 0.1))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float32)


def test_share_of_area_of_two_strips_under_a_pose() -> None:
    a, b = strip(0.0, 10.0), strip(6.0, 30.0)
    b_from_a = motion(
        Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix(), np.array([5.0, -3.0, 1.0])
    )
    found = overlap(a, transform(b_from_a, b), b_from_a, 0.05)
    assert found.of_a == pytest.approx(0.4, abs=0.011)  # 4 of 10 m
    assert found.of_b == pytest.approx(4.0 / 24.0, abs=0.005)
    # The reference scan is `b`; the other way round the two shares change places.
    back = overlap(transform(b_from_a, b), a, inverse(b_from_a), 0.05)
    assert (back.of_a, back.of_b) == (found.of_b, found.of_a)
    np.testing.assert_array_equal(found.shared_a, a[:, 0] > 5.94)


def test_neighbours_agree_with_scipy() -> None:
    rng = np.random.default_rng(2)
    points, queries = rng.normal(size=(4000, 3)), rng.normal(size=(3000, 3)) * 1.5
    expected = cKDTree(points).query(queries)[0] < 0.2
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(has_neighbour(queries, points, 0.2), expected)


def test_nothing_overlaps_nothing() -> None:
    empty = np.zeros((0, 3), dtype=np.float32)
    found = overlap(empty, strip(0, 1), np.eye(4), 1.0)
    assert (found.of_a, found.of_b) == (0.0, 0.0)


def test_radius_follows_the_coarser_sampling() -> None:
    options = OverlapOptions(spacings=2.0, slack=0.1)
    assert options.radius(0.05, 0.2) == options.radius(0.2, 0.05) == pytest.approx(0.5)


@pytest.mark.parametrize(
    "bad", [{"threshold": 1.2}, {"threshold": float("nan")}, {"spacings": 0.0}, {"slack": -1.0}]
)
def test_options_that_make_no_sense_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(OptionError):
        OverlapOptions(**bad)


def test_a_radius_of_nothing_is_refused() -> None:
    with pytest.raises(OptionError, match="positive"):
        overlap(strip(0, 1), strip(0, 1), np.eye(4), 0.0)
