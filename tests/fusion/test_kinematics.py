"""Points of profiles against SciPy's rotations and against Eq. (1) in both of its forms."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.fusion.kinematics import beam_origins, profile_points, station_from_body
from trihedral.fusion.rig import LineScanner

CASES = np.random.default_rng(4).uniform([-7, -2, 0, -1, 0], [7, 2, 80, 1, 3], (40, 5))


def beam_point(th1: float, th2: float, r: float, d: float, h: float) -> np.ndarray:
    """Where the beam of a scanner with its mounting at identity ends."""
    return profile_points(LineScanner("s", d, h), np.array([th1]), np.array([th2]), np.array([[r]]))[0, 0]


@pytest.mark.parametrize("th1, th2, r, d, h", CASES)
def test_a_beam_is_two_rotations_and_two_shifts(th1: float, th2: float, r: float, d: float, h: float) -> None:
    # In the fan's plane up is positive, so the beam turns about -y; then the body turns about z.
    along = Rotation.from_rotvec([0.0, -th2, 0.0]).apply([r, 0.0, 0.0])
    expected = Rotation.from_rotvec([0.0, 0.0, th1]).apply(along + np.array([d, 0.0, h]))
    assert beam_point(th1, th2, r, d, h) == pytest.approx(expected, abs=1e-10)


def test_the_equation_as_printed() -> None:
    th1, th2, r, d, h = 0.3, -0.4, 12.0, 0.2, 1.3
    c1, s1, c2, s2 = math.cos(th1), math.sin(th1), math.cos(th2), math.sin(th2)
    matrix = np.array([[c1 * c2, -c1 * s2, s1, d * c1], [s1 * c2, -s1 * s2, -c1, d * s1], [s2, c2, 0, h]])
    found = beam_point(th1, th2, r, d, h)
    assert found == pytest.approx(matrix @ [r, 0, 0, 1])
    assert found == pytest.approx([r * c1 * c2 + d * c1, r * s1 * c2 + d * s1, r * s2 + h])


def test_several_scanners_each_with_its_mounting() -> None:
    rng = np.random.default_rng(9)
    body, beam = rng.uniform(-4, 4, 7), rng.uniform(-1.6, 1.6, 11)
    ranges = rng.uniform(0.5, 80, (7, 11))
    for _ in range(4):
        turn, shift = Rotation.random(random_state=int(rng.integers(99))), rng.normal(size=3)
        mounting = np.eye(4)
        mounting[:3, :3], mounting[:3, 3] = turn.as_matrix(), shift
        scanner = LineScanner("s", 0.2, 1.4, mounting)
        found = profile_points(scanner, body, beam, ranges)
        for i in range(7):
            about = Rotation.from_rotvec([0, 0, body[i]])
            own = [beam_point(0.0, beam[j], ranges[i, j], 0.2, 1.4) for j in range(11)]
            assert found[i] == pytest.approx(about.apply(turn.apply(own) + shift), abs=1e-9)
            assert beam_origins(scanner, body)[i] == pytest.approx(
                about.apply(turn.apply([0.2, 0.0, 1.4]) + shift), abs=1e-12
            )


def test_the_body_turns_about_z() -> None:
    expected = Rotation.from_euler("z", 0.7).as_matrix()
    assert station_from_body(0.7)[:3, :3] == pytest.approx(expected)
