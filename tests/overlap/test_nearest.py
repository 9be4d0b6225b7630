import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from trihedral.errors import OptionError
from trihedral.geometry.se3 import inverse, motion, transform
from trihedral.overlap.nearest import OverlapOptions, has_neighbour, overlap

# Half of what the points of a strip lie apart.
NEAR = OverlapOptions(spacings=0.5, slack=0.0)


def strip(start: float, end: float) -> np.ndarray:
    x, y = np.meshgrid(np.arange(start, end, 0.1), np.arange(0.0, 5.0, 0.1))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float32)


def test_share_of_area_of_two_strips_under_a_pose() -> None:
    a, b = strip(0.0, 10.0), strip(6.0, 30.0)
    b_from_a = motion(
        Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix(), np.array([5.0, -3.0, 1.0])
    )
    found = overlap(a, transform(b_from_a, b), b_from_a, NEAR)
    assert found.of_a == pytest.approx(0.4, abs=0.011)  # 4 of 10 m
    assert found.of_b == pytest.approx(4.0 / 24.0, abs=0.005)
    # The reference scan is `b`; the other way round the two shares change places.
    back = overlap(transform(b_from_a, b), a, inverse(b_from_a), NEAR)
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
    found = overlap(empty, strip(0, 1), np.eye(4))
    assert (found.of_a, found.of_b) == (0.0, 0.0)


def test_the_radius_follows_what_a_point_lies_from_its_own_neighbours() -> None:
    coarse, fine = strip(0.0, 10.0)[::5], strip(20.0, 25.0)
    radii = OverlapOptions(spacings=2.0, slack=0.1).radii(np.concatenate([coarse, fine]))
    # The fourth neighbour within a strip of every fifth point is 0.2 m off or more; of a grid of 0.1 m it is 0.1 m off.
    assert np.median(radii[len(coarse) :]) == pytest.approx(2.0 * 0.1 + 0.1, abs=1e-3)
    assert np.median(radii[: len(coarse)]) > 2.0 * 0.1 + 0.1 + 0.1


def test_thin_surface_is_shared_all_the_same() -> None:
    """Two samplings of one far floor, each with points 2 m apart, overlap; with one radius of 0.5 m they would not."""
    x, y = np.meshgrid(np.arange(0.0, 40.0, 2.0), np.arange(0.0, 40.0, 2.0))
    a = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    b = a + np.array([0.9, 0.9, 0.0])
    found = overlap(a, b, np.eye(4))
    assert found.of_a > 0.98 and found.of_b > 0.98
    assert not has_neighbour(a, b, 0.5).any()


@pytest.mark.parametrize(
    "bad", [{"threshold": 1.2}, {"threshold": float("nan")}, {"spacings": 0.0, "slack": 0.0}, {"slack": -1.0}]
)
def test_options_that_make_no_sense_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(OptionError):
        OverlapOptions(**bad)
