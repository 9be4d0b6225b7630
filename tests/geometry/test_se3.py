"""Rigid motions against SciPy and their own laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import distance, inverse, motion, rotation_angle, rotation_between, transform

numbers = st.floats(-10, 10)


@st.composite
def motions(draw):
    rotation = Rotation.from_rotvec([draw(numbers), draw(numbers), draw(numbers)]).as_matrix()
    return motion(rotation, np.array([draw(numbers), draw(numbers), draw(numbers)]))


@given(motions(), motions())
def test_inverse_and_chain(b_from_a, c_from_b):
    assert np.allclose(inverse(b_from_a) @ b_from_a, np.eye(4), atol=1e-12)
    points = np.array([[1.0, 2.0, 3.0], [-4.0, 0.0, 0.5]])
    chained = transform(c_from_b, transform(b_from_a, points))
    assert np.allclose(chained, transform(c_from_b @ b_from_a, points), atol=1e-10)


@given(motions())
def test_angle_agrees_with_scipy(pose):
    assert rotation_angle(pose) == pytest.approx(Rotation.from_matrix(pose[:3, :3]).magnitude(), abs=1e-7)


def test_small_angles_keep_their_digits():
    pose = motion(Rotation.from_rotvec([0.0, 3e-9, 4e-9]).as_matrix(), np.zeros(3))
    assert distance(np.eye(4), pose)[1] == pytest.approx(5e-9, rel=1e-6)


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers))
def test_rotation_between_takes_one_onto_the_other(a, b):
    a, b = np.array(a), np.array(b)
    if np.linalg.norm(a) < 1e-3 or np.linalg.norm(b) < 1e-3:
        return
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    rotation = rotation_between(a, b)
    assert np.allclose(rotation @ a, b, atol=1e-6)
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-6)


def test_opposite_vectors_turn_by_half_a_circle():
    for vector in np.eye(3):
        rotation = rotation_between(vector, -vector)
        assert np.allclose(rotation @ vector, -vector)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
