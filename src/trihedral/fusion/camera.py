"""From camera coordinates to pixels and back: pinhole with Brown's distortion, spherical, cylindrical.

Camera axes are x right, y down, z along the view; pixel centres lie at integers.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from trihedral.scan import CameraModel

Float = NDArray[np.float64]

#: Share by which the field of view is enlarged where a lens model is still trusted, so that surfaces cross the border.
_MARGIN = 1.15
_NEWTON_STEPS = 8


def complete(camera: CameraModel) -> bool:
    """Whether the camera says where directions fall in its picture."""
    if camera.kind == "pinhole":
        return camera.focal is not None and camera.centre is not None
    if camera.kind == "spherical":
        return camera.pixel_angle is not None
    if camera.kind == "cylindrical":
        return camera.pixel_angle is not None and camera.focal is not None and camera.centre is not None
    return False


def project(camera: CameraModel, xyz: NDArray[np.floating]) -> Float:
    """Pixels of points: Eq. (2) of Kim, Chen and Cho (2017) after the change to camera axes.

    Parameters
    ----------
    camera
        A complete one.
    xyz
        (N, 3) points in camera coordinates, metres.

    Returns
    -------
    (N, 2) column and row; also outside the picture. NaN for what a pinhole camera cannot see: points behind it, and
    points beyond the angle up to which its distortion is a lens's and not an artefact of its polynomial.
    """
    x, y, z = (np.asarray(xyz[:, k], dtype=np.float64) for k in range(3))
    if camera.kind == "pinhole":
        return _pinhole(camera, x, y, z)
    level = np.sqrt(x * x + z * z)
    assert camera.pixel_angle is not None
    with np.errstate(divide="ignore", invalid="ignore"):
        column = np.arctan2(x, z) / camera.pixel_angle[0] + (camera.width - 1) / 2.0
        if camera.kind == "spherical":
            row = np.arctan2(y, level) / camera.pixel_angle[1] + (camera.height - 1) / 2.0
        else:
            assert camera.focal is not None and camera.centre is not None
            row = camera.centre[1] + camera.focal[1] * y / level
    pixels = np.stack([column, row], axis=1)
    pixels[~np.isfinite(pixels).all(axis=1)] = np.nan
    return pixels


def _pinhole(camera: CameraModel, x: Float, y: Float, z: Float) -> Float:
    assert camera.focal is not None and camera.centre is not None
    ahead = z > 1e-9
    depth = np.where(ahead, z, 1.0)
    x, y = x / depth, y / depth
    inside = ahead & (x * x + y * y <= _widest(camera))
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    x, y = _distorted(camera.distortion, x, y)
    pixels = np.stack(
        [camera.focal[0] * x + camera.centre[0], camera.focal[1] * y + camera.centre[1]], axis=1
    )
    pixels[~inside] = np.nan
    return pixels


def _distorted(distortion: tuple[float, ...], x: Float, y: Float) -> tuple[Float, Float]:
    """Brown's model: radial k1, k2, k3 and tangential p1, p2 on (N,) coordinates in the plane z = 1."""
    if not any(distortion):
        return x, y
    k1, k2, p1, p2, k3 = (*distortion, *(0.0,) * 5)[:5]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def _fold(distortion: tuple[float, ...]) -> float:
    """Square of the radius at which the radial polynomial stops growing: beyond it pixels mean nothing."""
    k1, k2, _, _, k3 = (*distortion, *(0.0,) * 5)[:5]
    roots = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(min(real[real > 0], default=math.inf))


@lru_cache(maxsize=32)
def _widest(camera: CameraModel) -> float:
    """Square of the largest radius in the plane z = 1 that the camera may show."""
    fold = _fold(camera.distortion)
    limit = min(fold, 1e4)
    border = _border(camera)
    x, y, good = _undistorted(camera, border, limit)
    radius = float((x * x + y * y)[good].max(initial=0.0))
    if not good.all():
        # The picture's corners lie beyond the fold: everything up to it may show.
        radius = limit
    return min(radius * _MARGIN**2, limit)


def _border(camera: CameraModel) -> Float:
    along, down = np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 33)
    return np.concatenate(
        [np.stack([along, np.full(33, v)], axis=1) for v in (-0.5, camera.height - 0.5)]
        + [np.stack([np.full(33, u), down], axis=1) for u in (-0.5, camera.width - 0.5)]
    )


def _undistorted(camera: CameraModel, pixels: Float, limit: float) -> tuple[Float, Float, NDArray[np.bool_]]:
    """Coordinates in the plane z = 1 of (N, 2) pixels by Newton's method, and where it found them."""
    assert camera.focal is not None and camera.centre is not None
    goal_x = (pixels[:, 0] - camera.centre[0]) / camera.focal[0]
    goal_y = (pixels[:, 1] - camera.centre[1]) / camera.focal[1]
    if not any(camera.distortion):
        return goal_x, goal_y, np.ones(len(pixels), bool)
    k1, k2, p1, p2, k3 = (*camera.distortion, *(0.0,) * 5)[:5]
    x, y = goal_x.copy(), goal_y.copy()
    # Begin inside the fold, where the model is one to one.
    shrink = np.minimum(1.0, 0.95 * math.sqrt(limit) / np.maximum(np.hypot(x, y), 1e-12))
    x, y = x * shrink, y * shrink
    for _ in range(_NEWTON_STEPS):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))
        off_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - goal_x
        off_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - goal_y
        xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        det = xx * yy - xy * xy
        det = np.where(np.abs(det) < 1e-9, 1e-9, det)
        x, y = x - (yy * off_x - xy * off_y) / det, y - (xx * off_y - xy * off_x) / det
        radius = np.hypot(x, y)
        back = np.minimum(1.0, math.sqrt(limit) / np.maximum(radius, 1e-12))
        x, y = x * back, y * back
    again_x, again_y = _distorted(camera.distortion, x, y)
    return x, y, np.hypot(again_x - goal_x, again_y - goal_y) < 1e-6


def rays(camera: CameraModel, pixels: NDArray[np.floating | np.integer]) -> Float:
    """Directions that pixels look along.

    Parameters
    ----------
    camera
        A complete one.
    pixels
        (N, 2) column and row.

    Returns
    -------
    (N, 3) unit vectors in camera coordinates; NaN for pixels that no direction falls on.
    """
    places: Float = pixels.astype(np.float64)
    if camera.kind == "pinhole":
        x, y, good = _undistorted(camera, places, min(_fold(camera.distortion), 1e4))
        directions = np.stack([x, y, np.ones(len(x))], axis=1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        directions[~good] = np.nan
        return directions
    assert camera.pixel_angle is not None
    azimuth = (places[:, 0] - (camera.width - 1) / 2.0) * camera.pixel_angle[0]
    if camera.kind == "spherical":
        below = (places[:, 1] - (camera.height - 1) / 2.0) * camera.pixel_angle[1]
        below = np.where(np.abs(below) <= math.pi / 2, below, np.nan)
    else:
        assert camera.focal is not None and camera.centre is not None
        below = np.arctan((places[:, 1] - camera.centre[1]) / camera.focal[1])
    level = np.cos(below)
    return np.stack([level * np.sin(azimuth), np.sin(below), level * np.cos(azimuth)], axis=1)


@lru_cache(maxsize=4)
def pixel_rays(camera: CameraModel) -> Float:
    """(H * W, 3) unit directions of all pixels, row by row, camera coordinates; the array is shared."""
    row, column = np.mgrid[: camera.height, : camera.width]
    directions = rays(camera, np.stack([column.ravel(), row.ravel()], axis=1))
    directions.setflags(write=False)
    return directions


def pixels_per_radian(camera: CameraModel) -> float:
    """Pixels that an angle of one radian covers in the middle of the picture."""
    if camera.kind == "pinhole":
        assert camera.focal is not None
        return max(camera.focal)
    assert camera.pixel_angle is not None
    return 1.0 / min(camera.pixel_angle)


def period(camera: CameraModel) -> float | None:
    """Columns after which a full panorama begins again; None for every other picture."""
    if camera.kind == "pinhole" or camera.pixel_angle is None:
        return None
    turn = 2.0 * math.pi / camera.pixel_angle[0]
    return turn if camera.width > turn - 1.5 else None


def resized(camera: CameraModel, width: int, height: int) -> CameraModel:
    """Give the camera of the same picture with another number of pixels."""
    fx, fy = width / camera.width, height / camera.height
    return CameraModel(
        kind=camera.kind,
        width=width,
        height=height,
        focal=None if camera.focal is None else (camera.focal[0] * fx, camera.focal[1] * fy),
        centre=None
        if camera.centre is None
        else ((camera.centre[0] + 0.5) * fx - 0.5, (camera.centre[1] + 0.5) * fy - 0.5),
        distortion=camera.distortion,
        pixel_angle=None
        if camera.pixel_angle is None
        else (camera.pixel_angle[0] / fx, camera.pixel_angle[1] / fy),
    )
