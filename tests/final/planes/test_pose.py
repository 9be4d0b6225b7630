import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.final.planes.pose import PlanesRefused, corner, sequential_rotation
from trihedral.geometry.se3 import rotation_between


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
