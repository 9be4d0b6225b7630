"""From camera coordinates to pixels and back: pinhole with Brown's distortion, spherical, cylindrical.

Camera axes are x right, y down, z along the view; pixel centres lie at integers.
"""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.geometry.arrays import Float64
from trihedral.scan import CameraModel


def complete(camera: CameraModel) -> bool:
    """Whether the camera says where directions fall in its picture."""
    framed, stepped = camera.focal is not None and camera.centre is not None, camera.pixel_angle is not None
    needed = {"pinhole": framed, "spherical": stepped, "cylindrical": framed and stepped}
    return needed.get(camera.kind, False)


def project(camera: CameraModel, xyz: NDArray[np.floating]) -> Float64:
    """Pixels (N, 2), column and row, that a complete camera shows points (N, 3) at, camera coordinates, metres.

    Eq. (2) of Kim, Chen and Cho (2017) after the change to camera axes; also outside the picture. NaN for what a
    pinhole camera cannot see: points behind it, and points beyond the angle up to which its distortion is a lens's
    and not an artefact of its polynomial.
    """
    return model(camera).project(np.ascontiguousarray(xyz, np.float64))


@lru_cache(maxsize=32)
def model(camera: CameraModel) -> _core.Camera:
    """Give a complete camera as the kernels use it."""
    size = (camera.width, camera.height)
    if camera.kind == "pinhole":
        assert camera.focal is not None and camera.centre is not None
        distortion = [*camera.distortion, *(0.0,) * 5][:5]
        return _core.Camera.pinhole(size, camera.focal, camera.centre, distortion, _fold(camera.distortion))
    assert camera.pixel_angle is not None
    if camera.kind == "spherical":
        return _core.Camera.spherical(size, camera.pixel_angle)
    assert camera.focal is not None and camera.centre is not None
    return _core.Camera.cylindrical(size, camera.pixel_angle[0], camera.focal[1], camera.centre[1])


def _fold(distortion: tuple[float, ...]) -> float:
    """Square of the radius at which the radial polynomial stops growing: beyond it pixels mean nothing."""
    k1, k2, _, _, k3 = (*distortion, *(0.0,) * 5)[:5]
    roots = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(min(real[real > 0], default=math.inf))


def rays(camera: CameraModel, pixels: NDArray[np.floating | np.integer]) -> Float64:
    """Directions (N, 3) that pixels (N, 2), column and row, of a complete camera look along.

    They are unit vectors in camera coordinates; NaN for pixels that no direction falls on.
    """
    return model(camera).rays(np.ascontiguousarray(pixels, np.float64))


@lru_cache(maxsize=4)
def pixel_rays(camera: CameraModel) -> Float64:
    """(H * W, 3) unit directions of all pixels, row by row, camera coordinates; the array is shared."""
    row, column = np.mgrid[: camera.height, : camera.width]
    directions = rays(camera, np.stack([column.ravel(), row.ravel()], axis=1))
    directions.setflags(write=False)
    return directions


def pixels_per_radian(camera: CameraModel) -> float:
    """Pixels that an angle of one radian covers at the centre of the picture."""
    return model(camera).pixels_per_radian


def resized(camera: CameraModel, width: int, height: int) -> CameraModel:
    """Give the camera of the same picture with another number of pixels."""
    fx, fy = width / camera.width, height / camera.height
    focal, centre, angle = camera.focal, camera.centre, camera.pixel_angle
    return replace(
        camera,
        width=width,
        height=height,
        focal=focal and (focal[0] * fx, focal[1] * fy),
        centre=centre and ((centre[0] + 0.5) * fx - 0.5, (centre[1] + 0.5) * fy - 0.5),
        pixel_angle=angle and (angle[0] / fx, angle[1] / fy),
    )
