"""Eq. (2) with Brown's distortion against OpenCV; panoramas against closed forms."""

import math

import cv2
import numpy as np
import pytest

from support.fusion_room import CYLINDRICAL, PINHOLE, SPHERICAL
from trihedral.fusion import camera as lens
from trihedral.scan import CameraModel


def in_front(count: int = 400) -> np.ndarray:
    rng = np.random.default_rng(2)
    xyz = rng.uniform([-0.6, -0.45, 1.0], [0.6, 0.45, 1.0], (count, 3))
    return xyz * rng.uniform(0.3, 60.0, (count, 1))


def test_projection_is_opencvs() -> None:
    xyz = in_front()
    fx, fy = PINHOLE.focal
    matrix = np.array([[fx, 0, PINHOLE.centre[0]], [0, fy, PINHOLE.centre[1]], [0, 0, 1]])
    expected, _ = cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), matrix, np.array(PINHOLE.distortion))
    assert np.abs(lens.project(PINHOLE, xyz) - expected[:, 0]).max() < 1e-9


@pytest.mark.parametrize("camera", [PINHOLE, SPHERICAL, CYLINDRICAL], ids=lambda c: c.kind)
def test_rays_are_the_inverse_of_projection(camera: CameraModel) -> None:
    rng = np.random.default_rng(3)
    pixels = rng.uniform([0, 0], [camera.width - 1, camera.height - 1], (500, 2))
    directions = lens.rays(camera, pixels)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0)
    assert np.abs(lens.project(camera, directions * 7.0) - pixels).max() < 1e-6


def test_points_behind_a_pinhole_camera_have_no_pixel() -> None:
    xyz = in_front()
    assert np.isnan(lens.project(PINHOLE, -xyz)).all()
    assert np.isnan(lens.project(PINHOLE, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))).all()


def test_a_strong_barrel_does_not_fold_far_points_into_the_picture() -> None:
    camera = CameraModel("pinhole", 640, 480, (500.0, 500.0), (319.5, 239.5), (-0.35, 0.0, 0.0, 0.0, 0.0))
    angles = np.radians(np.arange(0, 89.5, 0.5))
    xyz = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    columns = lens.project(camera, xyz)[:, 0]
    seen = np.isfinite(columns)
    # Up to where the model is a lens, columns grow with the angle; beyond there is nothing.
    assert (np.diff(columns[seen]) > 0).all()
    assert not seen[angles > math.radians(60)].any()


def test_a_panorama_by_hand() -> None:
    ahead, right, below, back = lens.project(
        SPHERICAL, np.array([[0, 0, 2.0], [2.0, 0, 0], [0, 1.0, 1.0], [-1e-9, 0, -2.0]])
    )
    assert ahead == pytest.approx([359.5, 179.5])
    assert right == pytest.approx([359.5 + 180, 179.5])
    assert below == pytest.approx([359.5, 179.5 + 90])
    assert back == pytest.approx([-0.5, 179.5], abs=1e-6)
    up = lens.project(CYLINDRICAL, np.array([[0.0, -3.0, 3.0]]))
    assert up[0] == pytest.approx([359.5, 149.5 - 120.0])


def test_a_picture_of_half_the_size_shows_the_same_directions() -> None:
    half = lens.resized(PINHOLE, 160, 120)
    xyz = in_front(20)
    big, small = lens.project(PINHOLE, xyz), lens.project(half, xyz)
    assert small == pytest.approx((big + 0.5) / 2 - 0.5)
