import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from trihedral.errors import OptionError
from trihedral.final.point_to_point import IcpOptions, align
from trihedral.geometry.se3 import distance, inverse, motion, transform

SMALL = motion(
    Rotation.from_euler("xyz", [1.0, -0.7, 1.5], degrees=True).as_matrix(), np.array([0.06, -0.04, 0.05])
)


def room(count: int = 6000, seed: int = 1) -> np.ndarray:
    """Points on the inside of a box of 6 x 4 x 3 m."""
    rng = np.random.default_rng(seed)
    size = np.array([6.0, 4.0, 3.0])
    points = rng.uniform(0.0, 1.0, (count, 3)) * size
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = rng.integers(0, 2, count) * size[axis]
    return points - [1.0, 1.5, 1.2]


def test_recovers_the_motion_of_the_same_points_and_its_inverse() -> None:
    b = room()
    a = transform(inverse(SMALL), b)
    plain = IcpOptions(rounds=0)
    there, back = align(a, b, np.eye(4), plain), align(b, a, np.eye(4), plain)
    assert there.converged and back.converged
    assert distance(there.pose, SMALL) < (1e-5, 1e-5)
    assert distance(back.pose, inverse(SMALL)) < (1e-5, 1e-5)
    assert there.rmse < 1e-5 and there.matched == len(a)


def test_ends_at_the_minimum_that_scipy_finds() -> None:
    """Two samplings of the same surface: the minimum is not the truth, and both end at it."""
    b, a = room(seed=1), transform(inverse(SMALL), room(seed=2))[:1500]
    found = align(a, b, np.eye(4), IcpOptions(translation=1e-9, rotation=1e-9, iterations=500, rounds=0))
    tree = cKDTree(b.astype(np.float32).astype(np.float64))

    def residuals(x: np.ndarray) -> np.ndarray:
        # The nearest points are those of the pose that was found: there the gradient must vanish.
        moved = transform(motion(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:]) @ found.pose, a)
        return (moved - nearest).ravel()

    nearest = tree.data[tree.query(transform(found.pose, a))[1]]
    step = least_squares(residuals, np.zeros(6)).x
    assert np.abs(step).max() < 1e-5
    assert found.rmse == pytest.approx(np.sqrt((residuals(np.zeros(6)) ** 2).sum() / len(a)), rel=1e-4)


def test_points_out_of_reach_pull_nowhere() -> None:
    b = room()
    a = np.concatenate([transform(inverse(SMALL), b), np.random.default_rng(3).uniform(20, 30, (3000, 3))])
    found = align(a, b, np.eye(4), IcpOptions(max_correspondence_distance=1.0, rounds=0))
    assert distance(found.pose, SMALL) < (1e-4, 1e-4) and found.matched == len(b)
    # Without a limit they do: the figure that the paper's Table 2 shows for scans that overlap little.
    unlimited = align(a, b, np.eye(4), IcpOptions(rounds=0))
    assert distance(unlimited.pose, SMALL)[0] > 0.1


def test_outliers_tell_themselves() -> None:
    """Some of the points lie on surface that the other scan lacks, half a metre and more off."""
    b = room(20_000)
    rng = np.random.default_rng(3)
    more = rng.uniform([-3.0, -1.0, -1.0], [-1.5, 2.0, 1.5], (800, 3))
    a = np.concatenate([transform(inverse(SMALL), room(5000, seed=2)), more])
    with_them = align(a, b, np.eye(4), IcpOptions(max_correspondence_distance=1.5, rounds=0))
    without = align(a, b, np.eye(4), IcpOptions(max_correspondence_distance=1.5))
    assert distance(with_them.pose, SMALL)[0] > 0.02
    assert distance(without.pose, SMALL) < (0.005, np.radians(0.1))
    assert 0.05 < without.max_correspondence_distance < 0.4 and without.matched < len(a) - 600


def test_the_number_of_threads_does_not_show() -> None:
    script = """
import numpy as np
from trihedral.final.point_to_point import align
rng = np.random.default_rng(1)
b = rng.normal(size=(5000, 3)); a = b[::2] + [0.1, 0.02, -0.05] + rng.normal(size=(2500, 3)) * 0.01
print(align(a, b, np.eye(4)).pose.tobytes().hex())
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
    assert len(runs) == 1


def test_too_few_points_and_nothing_within_reach_stay_where_they_are() -> None:
    start = motion(translation=np.array([1.0, 2.0, 3.0]))
    for a, options in (
        (np.zeros((0, 3)), IcpOptions()),
        (room()[:2], IcpOptions()),
        (room() + 1e3, IcpOptions(max_correspondence_distance=1.0)),
    ):
        found = align(a, room(), start, options)
        assert not found.converged and np.array_equal(found.pose, start)


@pytest.mark.parametrize(
    "bad",
    [
        {"max_correspondence_distance": 0.0},
        {"max_correspondence_distance": float("nan")},
        {"samples": 2},
        {"iterations": 0},
        {"outliers": 0.0},
        {"rounds": -1},
    ],
)
def test_options_that_make_no_sense_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(OptionError):
        IcpOptions(**bad)
