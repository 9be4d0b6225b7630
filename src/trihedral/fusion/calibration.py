"""Camera calibration: intrinsics from checkerboards, extrinsics from a mounting or from picked 2D-3D pairs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError, TrihedralError
from trihedral.fusion.camera import project, rays
from trihedral.geometry.se3 import Matrix, inverse, motion, transform
from trihedral.scan import CameraModel

# Boards that must be found: with fewer, focal length and distance cannot be told apart safely.
LEAST_BOARDS = 3
# Pairs that a pose needs: three leave up to four poses open.
LEAST_PAIRS = 4
# Corners are refined in pictures of any size, but looked for in ones no larger than this (pixels).
_SEARCHED_SIDE = 1600


class CalibrationError(TrihedralError):
    """What was given does not determine the camera; the text says what is missing."""


@dataclass(frozen=True)
class Board:
    """A checkerboard."""

    #: Inner corners along the longer side, and along the shorter one.
    columns: int = 9
    rows: int = 6
    #: Side of a square, metres.
    square_m: float = 0.025

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise OptionError("A checkerboard needs at least 3 x 3 inner corners.")
        if not self.square_m > 0:
            raise OptionError("The square of a checkerboard must be larger than 0.")

    @property
    def points(self) -> NDArray[np.float32]:
        """(C, 3) inner corners in the board's plane, metres."""
        grid = np.zeros((self.rows * self.columns, 3), np.float32)
        grid[:, :2] = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square_m
        return grid


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera."""

    #: Pinhole with Brown's distortion.
    camera: CameraModel
    #: Root mean square of the distances between corners found and corners projected, over all pictures.
    rms_px: float
    #: The same for each picture, in the order given.
    each_px: tuple[float, ...]
    #: Standard deviations of fx and fy that the adjustment itself estimates.
    sigma_focal_px: tuple[float, float]


def find_board(image: NDArray[np.uint8], board: Board) -> NDArray[np.float64] | None:
    """Find the inner corners (C, 2) of a board in a grey picture (H, W), or None where there is no whole board."""
    size = (board.columns, board.rows)
    scale = min(1.0, _SEARCHED_SIDE / max(image.shape))
    small = (
        image
        if scale == 1.0
        else np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    )
    found, corners = cv2.findChessboardCornersSB(
        small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    )
    if not found:
        return None
    places: NDArray[np.float64] = (corners.reshape(-1, 2).astype(np.float64) + 0.5) / scale - 0.5
    if scale < 1.0:
        window = int(np.clip(np.ceil(1.5 / scale), 3, 15))
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
        refined = cv2.cornerSubPix(
            image, places.astype(np.float32).reshape(-1, 1, 2), (window, window), (-1, -1), stop
        )
        places = np.asarray(refined, np.float64).reshape(-1, 2)
    return places


def calibrate(corners: Sequence[NDArray[np.float64]], board: Board, size: tuple[int, int]) -> Calibration:
    """Estimate focal lengths, principal point and distortion.

    Parameters
    ----------
    corners
        (C, 2) for each picture, from `find_board`.
    size
        Columns and rows of the pictures, pixels.

    Raises
    ------
    CalibrationError
        With fewer than three boards, or boards that were all held the same way, so that the focal length is open.
    """
    if len(corners) < LEAST_BOARDS:
        raise CalibrationError(
            f"{len(corners)} of the pictures show a whole board; at least {LEAST_BOARDS} are needed, "
            "better ten, with the board turned and tilted and in all parts of the picture."
        )
    objects = [board.points] * len(corners)
    images = [np.asarray(c, np.float32).reshape(-1, 1, 2) for c in corners]
    try:
        _, matrix, distortion, turns, shifts, deviations, _, _ = cv2.calibrateCameraExtended(
            objects, images, size, np.eye(3), np.zeros(5)
        )
    except cv2.error as error:
        raise CalibrationError(f"The boards do not determine the camera ({error.err}).") from error
    sigma = (float(deviations[0, 0]), float(deviations[1, 0]))
    focal = (float(matrix[0, 0]), float(matrix[1, 1]))
    spread = _tilt_spread([np.asarray(turn, np.float64) for turn in turns])
    finite = np.isfinite(matrix).all() and np.isfinite(distortion).all() and np.isfinite(sigma).all()
    if not finite or max(s / f for s, f in zip(sigma, focal, strict=True)) > 0.05 or spread < math.radians(5):
        raise CalibrationError(
            "The boards do not determine the focal length: they were all held the same way. Take pictures with the "
            "board tilted by 20 to 40 degrees to several sides."
        )
    camera = CameraModel(
        "pinhole",
        *size,
        focal=focal,
        centre=(float(matrix[0, 2]), float(matrix[1, 2])),
        distortion=tuple(float(k) for k in distortion.ravel()[:5]),
    )
    errors = []
    for points, turn, shift, image in zip(objects, turns, shifts, images, strict=True):
        off = cv2.projectPoints(points, turn, shift, matrix, distortion)[0] - image
        errors.append(math.sqrt(float((off.reshape(-1, 2) ** 2).sum(axis=1).mean())))
    return Calibration(camera, math.sqrt(sum(e * e for e in errors) / len(errors)), tuple(errors), sigma)


def _tilt_spread(turns: Sequence[NDArray[np.float64]]) -> float:
    """Largest angle between the normals of two boards (rad)."""
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    return float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())


def mounting_pose(position: Sequence[float], heading: float, pitch: float = 0.0, roll: float = 0.0) -> Matrix:
    """`body_from_camera` of a camera by where it sits and where it looks.

    Parameters
    ----------
    position
        Its centre on the body, x, y, z, metres.
    heading
        Direction of the view about the axis, from x towards y (rad).
    pitch
        Of the view above the level (rad).
    roll
        About the view; positive turns the camera clockwise as it looks (rad).
    """
    ch, sh, cp, sp, cr, sr = (f(angle) for angle in (heading, pitch, roll) for f in (math.cos, math.sin))
    view = np.array([ch * cp, sh * cp, sp])
    right = np.array([sh, -ch, 0.0])
    down = np.cross(view, right)
    turn = np.column_stack([cr * right + sr * down, cr * down - sr * right, view])
    return motion(turn, np.asarray(position, np.float64))


@dataclass(frozen=True)
class Extrinsics:
    """Where a camera was."""

    #: 4x4, in the frame of the points that were picked.
    frame_from_camera: Matrix
    #: (N,) distance between each pixel picked and its point projected.
    residuals_px: NDArray[np.float64]
    #: (3,) standard deviations of position (along the frame's axes) and of rotations about the camera's
    #: axes.
    sigma_m: NDArray[np.float64]
    sigma_rad: NDArray[np.float64]

    @property
    def rms_px(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt((self.residuals_px**2).mean()))


def solve_extrinsics(
    points: NDArray[np.float64], pixels: NDArray[np.float64], camera: CameraModel
) -> Extrinsics:
    """Find the pose of a pinhole camera from points picked in a scan and in a picture.

    Parameters
    ----------
    points
        (N, 3) metres.
    pixels
        (N, 2) column and row.
    camera
        Calibrated.

    Raises
    ------
    CalibrationError
        With fewer than four pairs, points on a line or in one place, or pairs that fit no pose.
    """
    points, pixels = np.asarray(points, np.float64), np.asarray(pixels, np.float64)
    directions = _checked_rays(points, pixels, camera)
    centre = points.mean(axis=0)
    local = points - centre
    camera_from_local, residual = _best_pose(local, pixels, directions, camera)
    covariance = _covariance(camera_from_local, local, camera, residual)
    if covariance is None:
        raise CalibrationError(
            "The pairs leave the pose open: pick points farther apart, not all in one plane."
        )
    local_from_camera = inverse(camera_from_local)
    pose = local_from_camera.copy()
    pose[:3, 3] += centre
    along = local_from_camera[:3, :3] @ covariance[3:, 3:] @ local_from_camera[:3, :3].T
    return Extrinsics(pose, residual, np.sqrt(np.diag(along)), np.sqrt(np.diag(covariance[:3, :3])))


def _checked_rays(
    points: NDArray[np.float64], pixels: NDArray[np.float64], camera: CameraModel
) -> NDArray[np.float64]:
    """(N, 3) directions of the pixels; refuses pairs that determine no pose."""
    if len(points) != len(pixels):
        raise CalibrationError(f"There are {len(points)} points and {len(pixels)} pixels.")
    if camera.kind != "pinhole" or camera.focal is None or camera.centre is None:
        raise CalibrationError("The pose is found for calibrated pinhole cameras only.")
    if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise CalibrationError("A coordinate of the pairs is not a finite number.")
    if len(points) < LEAST_PAIRS:
        raise CalibrationError(f"{len(points)} pairs are given; at least {LEAST_PAIRS} are needed.")
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] <= 0.02 * spread[0]:
        raise CalibrationError("The points lie on a line: any turn about it fits. Pick some beside it.")
    directions = rays(camera, pixels)
    if np.isnan(directions).any():
        bad = int(np.flatnonzero(np.isnan(directions[:, 0]))[0]) + 1
        raise CalibrationError(f"Pair {bad}: no direction falls on its pixel with this distortion.")
    return directions


def _best_pose(
    local: NDArray[np.float64],
    pixels: NDArray[np.float64],
    directions: NDArray[np.float64],
    camera: CameraModel,
) -> tuple[Matrix, NDArray[np.float64]]:
    """``camera_from_local`` that projects the points nearest to their pixels, of several solvers' poses."""
    # Undistorted pixels of a unit camera: the closed-form solvers need no lens model then.
    flat = np.ascontiguousarray(directions[:, :2] / directions[:, 2:3])
    best: tuple[float, Matrix, NDArray[np.float64]] | None = None
    for method in (cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_EPNP, cv2.SOLVEPNP_ITERATIVE):
        try:
            found, turn, shift = cv2.solvePnP(local, flat, np.eye(3), None, flags=method)
            if not found:
                continue
            turn, shift = cv2.solvePnPRefineLM(local, flat, np.eye(3), None, turn, shift)
        except cv2.error:
            continue
        pose = motion(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(shift, np.float64).ravel())
        residual = np.linalg.norm(project(camera, transform(pose, local)) - pixels, axis=1)
        error = float(np.sqrt((residual**2).mean()))
        if math.isfinite(error) and (best is None or error < best[0]):
            best = (error, pose, residual)
    if best is None:
        raise CalibrationError("No pose puts all the points before the camera: are pairs mixed up?")
    return best[1], best[2]


def _covariance(
    camera_from_local: Matrix, local: NDArray[np.float64], camera: CameraModel, residual: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """6x6 of a small rotation about and shift along the camera's axes; None where they are not determined."""
    seen = transform(camera_from_local, local)
    jacobian = np.zeros((2 * len(local), 6))
    scale = float(np.median(np.linalg.norm(seen, axis=1)))
    for k in range(6):
        step = 1e-6 * (1.0 if k < 3 else scale)
        moved = []
        for sign in (1.0, -1.0):
            by = np.zeros(3)
            by[k % 3] = sign * step
            moved.append(project(camera, seen + (np.cross(by, seen) if k < 3 else by)))
        jacobian[:, k] = ((moved[0] - moved[1]) / (2.0 * step)).ravel()
    normal = jacobian.T @ jacobian
    weights = np.sqrt(np.diag(normal))
    if not np.isfinite(normal).all() or (weights == 0).any():
        return None
    scaled = normal / np.outer(weights, weights)
    if np.linalg.eigvalsh(scaled)[0] < 1e-9:
        return None
    # With the least number of pairs the residuals hardly say anything: a pixel is assumed then.
    freedom = 2 * len(local) - 6
    sigma2 = max(float((residual**2).sum()) / freedom, 0.25)
    covariance: NDArray[np.float64] = np.linalg.inv(scaled) / np.outer(weights, weights) * sigma2
    return covariance
