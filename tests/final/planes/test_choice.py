import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.errors import OptionError
from trihedral.final.planes.choice import first_three, pair_by_normals
from trihedral.final.planes.options import PlaneMatchingOptions
from trihedral.final.planes.pose import PlanesRefused
from trihedral.final.planes.segmentation import Plane


def plane(normal: list[float], distance: float = 1.0, points: int = 1) -> Plane:
    unit = np.array(normal) / np.linalg.norm(normal)
    return Plane(unit, distance, 0.0, unit * distance, np.zeros(points, dtype=np.uint32))


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


@pytest.mark.parametrize(
    "bad", [{"near": 0.0}, {"near_angle": 0.0}, {"widest": -0.1}, {"planes": 2}, {"choice": "all"}]
)
def test_options_that_mean_nothing_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(OptionError):
        PlaneMatchingOptions(**bad)
