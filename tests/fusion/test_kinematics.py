"""Eq. (1) against SciPy's rotations and against its own homogeneous form."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.fusion.kinematics import (
    beam_origins,
    beam_points,
    beam_transform,
    profile_points,
    station_from_body,
)
from trihedral.fusion.rig import LineScanner

CASES = np.random.default_rng(4).uniform([-7, -2, 0, -1, 0], [7, 2, 80, 1, 3], (40, 5))


@pytest.mark.parametrize("th1, th2, r, d, h", CASES)
def test_a_beam_is_two_rotations_and_two_shifts(th1: float, th2: float, r: float, d: float, h: float) -> None:
    # In the fan's plane up is positive, so the beam turns about -y; then the body turns about z.
    along = Rotation.from_rotvec([0.0, -th2, 0.0]).apply([r, 0.0, 0.0])
    expected = Rotation.from_rotvec([0.0, 0.0, th1]).apply(along + np.array([d, 0.0, h]))
    assert beam_points(th1, th2, r, d, h) == pytest.approx(expected, abs=1e-10)
    assert (beam_transform(th1, th2, d, h) @ [r, 0, 0, 1])[:3] == pytest.approx(expected, abs=1e-10)


def test_the_matrix_is_a_rigid_motion() -> None:
    for th1, th2, _, d, h in CASES:
        rotation = beam_transform(th1, th2, d, h)[:3, :3]
        assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_the_equation_as_printed() -> None:
    th1, th2, r, d, h = 0.3, -0.4, 12.0, 0.2, 1.3
    x, y, z = beam_points(th1, th2, r, d, h)
    assert x == pytest.approx(r * math.cos(th1) * math.cos(th2) + d * math.cos(th1))
    assert y == pytest.approx(r * math.sin(th1) * math.cos(th2) + d * math.sin(th1))
    assert z == pytest.approx(r * math.sin(th2) + h)


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
            own = [beam_points(0.0, beam[j], ranges[i, j], 0.2, 1.4) for j in range(11)]
            assert found[i] == pytest.approx(about.apply(turn.apply(own) + shift), abs=1e-9)
            assert beam_origins(scanner, body)[i] == pytest.approx(
                about.apply(turn.apply([0.2, 0.0, 1.4]) + shift), abs=1e-12
            )


def test_mounting_at_identity_is_equation_1() -> None:
    body, beam = np.linspace(0, 6, 5), np.linspace(-1.5, 1.5, 4)
    ranges = np.full((5, 4), 3.0)
    found = profile_points(LineScanner("s", 0.1, 1.2), body, beam, ranges)
    assert found == pytest.approx(beam_points(body[:, None], beam[None], ranges, 0.1, 1.2))


def test_the_body_turns_about_z() -> None:
    expected = Rotation.from_euler("z", 0.7).as_matrix()
    assert station_from_body(0.7)[:3, :3] == pytest.approx(expected)
