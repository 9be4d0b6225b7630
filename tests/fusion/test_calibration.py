"""Calibration on boards projected with OpenCV, whose camera is known."""

import math

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.errors import OptionError
from trihedral.fusion.calibration import (
    Board,
    CalibrationError,
    calibrate,
    find_board,
    mounting_pose,
    solve_extrinsics,
)
from trihedral.scan import CameraModel

BOARD = Board(8, 5, 0.03)
MATRIX = np.array([[820.0, 0, 505.0], [0, 824.0, 390.0], [0, 0, 1]])
DISTORTION = np.array([-0.18, 0.06, 0.0008, -0.0005, 0.0])
CAMERA = CameraModel("pinhole", 1024, 768, (820.0, 824.0), (505.0, 390.0), tuple(DISTORTION))


def board_poses(count: int, tilt: float = 0.5) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(8)
    middle = BOARD.points.mean(axis=0)
    poses = []
    for _ in range(count):
        turn = Rotation.from_euler("xyz", rng.uniform(-tilt, tilt, 3)).as_matrix()
        place = np.array([rng.uniform(-0.12, 0.12), rng.uniform(-0.08, 0.08), rng.uniform(0.35, 0.6)])
        poses.append((cv2.Rodrigues(turn)[0], place - turn @ middle))
    return poses


def picture(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Draw the board's squares, projected with fine outlines, four samples a pixel."""
    scale = 4
    image = np.full((768 * scale, 1024 * scale), 180, np.uint8)
    for i in range(-1, BOARD.columns):
        for j in range(-1, BOARD.rows):
            t = np.linspace(0, 1, 9)[:-1]
            sides = [(t, 0 * t), (0 * t + 1, t), (1 - t, 0 * t + 1), (0 * t, 1 - t)]
            edge = np.concatenate([np.stack(side) for side in sides], axis=1).T
            outline = np.column_stack([(edge + np.array([i, j])) * BOARD.square_m, np.zeros(len(edge))])
            pixels = cv2.projectPoints(outline, turn, shift, MATRIX, DISTORTION)[0][:, 0]
            color = 20 if (i + j) % 2 else 235
            cv2.fillPoly(
                image, [np.rint(((pixels + 0.5) * scale - 0.5) * 16).astype(np.int32)], color, shift=4
            )
    return cv2.GaussianBlur(cv2.resize(image, (1024, 768), interpolation=cv2.INTER_AREA), (0, 0), 0.6)


def test_a_camera_is_found_from_its_pictures() -> None:
    corners = []
    for turn, shift in board_poses(9):
        found = find_board(picture(turn, shift), BOARD)
        assert found is not None
        truth = cv2.projectPoints(BOARD.points, turn, shift, MATRIX, DISTORTION)[0][:, 0]
        # The board may be found from its other end.
        assert min(np.abs(found - truth).max(), np.abs(found[::-1] - truth).max()) < 0.5
        corners.append(found)
    result = calibrate(corners, BOARD, (1024, 768))
    assert result.camera.focal == pytest.approx((820.0, 824.0), rel=0.01)
    assert result.camera.centre == pytest.approx((505.0, 390.0), abs=8)
    assert result.camera.distortion[0] == pytest.approx(-0.18, abs=0.04)
    assert result.rms_px < 0.2
    assert len(result.each_px) == 9
    assert result.rms_px == pytest.approx(math.sqrt(np.mean(np.square(result.each_px))))
    assert abs(result.camera.focal[0] - 820) < 6 * result.sigma_focal_px[0] + 0.5


def exact(poses: list[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    return [cv2.projectPoints(BOARD.points, t, s, MATRIX, DISTORTION)[0][:, 0] for t, s in poses]


def test_exact_corners_give_the_exact_camera() -> None:
    result = calibrate(exact(board_poses(12)), BOARD, (1024, 768))
    assert result.camera.focal == pytest.approx((820.0, 824.0), abs=0.05)
    assert result.camera.centre == pytest.approx((505.0, 390.0), abs=0.05)
    assert result.rms_px < 1e-3


def test_fewer_than_three_boards_are_refused() -> None:
    with pytest.raises(CalibrationError, match="2 of the pictures show a whole board; at least 3"):
        calibrate(exact(board_poses(2)), BOARD, (1024, 768))


def test_boards_held_all_the_same_way_are_refused() -> None:
    with pytest.raises(CalibrationError, match="held the same way"):
        calibrate(exact(board_poses(6, tilt=0.02)), BOARD, (1024, 768))


def test_no_board_no_corners() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (480, 640)).astype(np.uint8)
    assert find_board(noise, BOARD) is None


@pytest.mark.parametrize("arguments", [(2, 6, 0.02), (9, 6, 0.0), (9, 6, -1.0)])
def test_boards_that_cannot_be(arguments: tuple[int, int, float]) -> None:
    with pytest.raises(OptionError):
        Board(*arguments)


def scattered(count: int, noise: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", [-1.7, 0.2, -0.9]).as_matrix()
    pose[:3, 3] = [3.0, -2.0, 1.5]
    local = rng.uniform([-0.5, -0.4, 1.0], [0.5, 0.4, 1.0], (count, 3)) * rng.uniform(2, 15, (count, 1))
    pixels = cv2.projectPoints(local, np.zeros(3), np.zeros(3), MATRIX, DISTORTION)[0][:, 0]
    return local @ pose[:3, :3].T + pose[:3, 3], pixels + noise * rng.standard_normal((count, 2)), pose


@pytest.mark.parametrize("count", [4, 6, 20])
def test_exact_pairs_give_the_exact_pose(count: int) -> None:
    points, pixels, pose = scattered(count, 0.0)
    found = solve_extrinsics(points, pixels, CAMERA)
    assert found.frame_from_camera == pytest.approx(pose, abs=1e-5)
    assert found.residuals_px.max() < 1e-3


def test_noisy_pairs_stay_within_the_stated_deviations() -> None:
    off = []
    for seed in range(30):
        points, pixels, pose = scattered(15, 1.0, seed)
        found = solve_extrinsics(points, pixels, CAMERA)
        off.append((found.frame_from_camera[:3, 3] - pose[:3, 3]) / found.sigma_m)
        assert 0.3 < found.rms_px < 2.5
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.7


def test_points_far_from_the_origin() -> None:
    points, pixels, pose = scattered(12, 0.0)
    shift = np.array([431_000.0, 5_412_000.0, 300.0])
    found = solve_extrinsics(points + shift, pixels, CAMERA)
    assert found.frame_from_camera[:3, 3] - shift == pytest.approx(pose[:3, 3], abs=1e-4)


@pytest.mark.parametrize(
    "points, pixels, reason",
    [
        (np.zeros((3, 3)), np.zeros((3, 2)), "3 pairs are given; at least 4"),
        (np.zeros((5, 3)), np.zeros((4, 2)), "5 points and 4 pixels"),
        (np.full((5, 3), np.nan), np.zeros((5, 2)), "not a finite number"),
        (
            np.arange(6)[:, None] * [1.0, 2.0, 0.5],
            np.random.default_rng(0).uniform(0, 700, (6, 2)),
            "on a line",
        ),
        (np.ones((6, 3)), np.random.default_rng(0).uniform(0, 700, (6, 2)), "on a line"),
    ],
)
def test_pairs_that_leave_the_pose_open(points: np.ndarray, pixels: np.ndarray, reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason):
        solve_extrinsics(points, pixels, CAMERA)


def test_a_mounting_by_position_and_direction() -> None:
    pose = mounting_pose((0.1, 0.0, 1.6), math.radians(90))
    assert pose[:3, 2] == pytest.approx([0, 1, 0], abs=1e-12)  # looks along y
    assert pose[:3, 0] == pytest.approx([1, 0, 0], abs=1e-12)  # x is to its right
    assert pose[:3, 1] == pytest.approx([0, 0, -1], abs=1e-12)
    tilted = mounting_pose((0, 0, 0), 0.4, 0.3, 0.2)
    # The same by SciPy: turn a camera that looks along x by roll, pitch and heading.
    start = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    expected = Rotation.from_euler("ZYX", [0.4, -0.3, 0.2]).as_matrix() @ start
    assert tilted[:3, :3] == pytest.approx(expected, abs=1e-12)
