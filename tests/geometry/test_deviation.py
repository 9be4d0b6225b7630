import numpy as np
from scipy.spatial.transform import Rotation

from trihedral.geometry.deviation import deviation_angles, displacement_rmse
from trihedral.geometry.se3 import motion


def test_deviation_is_the_rotation_that_is_missing() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        angles = rng.uniform([-170, -80, -170], [170, 80, 170])
        missing = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        found = motion(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
        true = motion(missing @ found[:3, :3], rng.normal(size=3))
        np.testing.assert_allclose(deviation_angles(found, true), angles, atol=1e-9)


def test_no_deviation_of_the_true_pose_and_the_original_one_of_the_identity() -> None:
    true = motion(Rotation.from_euler("xyz", [-15.334, 3.922, 168.125], degrees=True).as_matrix())
    assert np.allclose(deviation_angles(true, true), 0.0)
    np.testing.assert_allclose(deviation_angles(np.eye(4), true), [-15.334, 3.922, 168.125], atol=1e-9)


def test_rmse_of_a_shift_is_its_length_and_of_a_turn_that_of_the_chords() -> None:
    points = np.array([[10.0, 0.0, 0.0], [0.0, 20.0, 5.0]])
    assert np.isclose(
        displacement_rmse(points, motion(translation=np.array([0.03, 0.04, 0.0])), np.eye(4)), 0.05
    )
    angle = np.radians(0.3)
    turned = motion(Rotation.from_euler("z", angle).as_matrix())
    chord = 2 * np.sin(angle / 2)
    expected = np.sqrt(((10 * chord) ** 2 + (20 * chord) ** 2) / 2)
    assert np.isclose(displacement_rmse(points, turned, np.eye(4)), expected)
