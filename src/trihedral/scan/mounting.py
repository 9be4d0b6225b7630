"""How the scanner was mounted: which way is up in a scan that hangs, lies, or is of other axes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import rotation_between
from trihedral.scan.noise import NoiseModel
from trihedral.scan.surfels import LEAST_COSINE, Surfels, incidence

Z = np.array([0.0, 0.0, 1.0])

# Surfels that are looked at, and patches that suggest a vertical.
SAMPLES = 20_000
SUGGESTING = 40
# Verticals are as far apart (rad); those within the larger angle of the instrument's axis are of one that leans.
APART = np.radians(15.0)
LEANING = np.radians(25.0)
# Radians off the level or the plumb line, and off the direction of a layer.
TOLERANCE = np.radians(4.0)
# Metres: thickness of a layer.
LAYER = 0.3
# Log-likelihoods of what a vertical makes of a scan: its height (a power), the share of surface that is level or
# upright, and the share of what is level that lies in the lowest and the highest layer (docs/method/preparation.md).
HEIGHT, SQUARE, LAYERED = -2.0, 6.0, 6.5
# The instrument stands upright so many times as often as not; what is less likely than the best by as much is left out.
STANDING = np.log(20.0)
# Kept at the most.
MOST = 3


@dataclass(frozen=True)
class Mounting:
    """Ways in which the scanner may have been mounted.

    Attributes
    ----------
    upright_from_scanner
        (M, 3, 3) rotations that set the scan upright but for a lean of some degrees, the likeliest first.
    log_likelihood
        (M,) against the likeliest.
    """

    upright_from_scanner: Float64
    log_likelihood: Float64

    @property
    def rotation(self) -> Float64:
        """(3, 3) the likeliest."""
        rotation: Float64 = self.upright_from_scanner[0]
        return rotation

    @property
    def up(self) -> Float64:
        """(3,) what is then up."""
        up: Float64 = self.rotation[2]
        return up

    @property
    def standing(self) -> bool:
        """Whether the scanner most likely stood upright."""
        return bool(np.array_equal(self.rotation, np.eye(3)))


STANDING_UPRIGHT = Mounting(np.eye(3)[None], np.zeros(1))


def mounting(surfels: Surfels, patch_normals: NDArray[np.floating], noise: NoiseModel) -> Mounting:
    """Tell how the scanner was mounted from the surface that it saw.

    A place is lower than it is wide, its surface level or upright, and what is level lies in few layers. Whether up or
    down is up the surface does not say: of two opposite directions the one along an axis of the scanner is taken.
    """
    seen = _seen(surfels, noise)
    if seen is None or not len(patch_normals):
        return STANDING_UPRIGHT
    suggested = patch_normals[:SUGGESTING].astype(np.float64)
    leaning = suggested[np.abs(suggested[:, 2]) > np.cos(LEANING)]
    verticals, scores = [Z], [max(_likelihood(vertical, *seen) for vertical in (Z, *leaning)) + STANDING]
    for vertical in suggested:
        if np.abs(np.array(verticals) @ vertical).max() < np.cos(APART) and abs(vertical[2]) < np.cos(
            LEANING
        ):
            verticals.append(vertical * np.sign(vertical[np.argmax(np.abs(vertical))]))
            scores.append(_likelihood(vertical, *seen))
    likelihood = np.array(scores) - max(scores)
    kept = [index for index in np.argsort(-likelihood, kind="stable") if likelihood[index] > -STANDING][:MOST]
    rotations = [np.eye(3) if index == 0 else rotation_between(verticals[index], Z) for index in kept]
    return Mounting(np.array(rotations), likelihood[kept])


def _seen(surfels: Surfels, noise: NoiseModel) -> tuple[Float64, Float64, Float64] | None:
    """Points (N, 3), normals (N, 3) and areas (N,) of surface that is seen at an angle."""
    planar = np.flatnonzero(surfels.planar)
    planar = planar[incidence(surfels.points[planar], surfels.normals[planar]) > LEAST_COSINE]
    planar = planar[:: max(1, len(planar) // SAMPLES)]
    if not len(planar):
        return None
    # One far surfel must not outvote the rest.
    areas = np.minimum(surfels.areas(noise.angular_step)[planar], 10 * surfels.spacing**2)
    return surfels.points[planar].astype(np.float64), surfels.normals[planar].astype(np.float64), areas


def _likelihood(vertical: Float64, points: Float64, normals: Float64, areas: Float64) -> float:
    cosines, heights = normals @ vertical, points @ vertical
    total = areas.sum()
    square = (np.abs(cosines) > np.cos(TOLERANCE)) | (np.abs(cosines) < np.sin(TOLERANCE))
    order = np.argsort(heights)
    low, high = np.interp([0.05 * total, 0.95 * total], np.cumsum(areas[order]), heights[order])
    level = layered = 0.0
    for facing in (cosines > np.cos(2 * TOLERANCE), cosines < -np.cos(2 * TOLERANCE)):
        if facing.any():
            slices = np.floor(3 * heights[facing] / LAYER).astype(np.int64)
            filled = np.bincount(slices - slices.min() + 1, areas[facing], np.ptp(slices) + 3)
            level += areas[facing].sum()
            layered += (filled[:-2] + filled[1:-1] + filled[2:]).max()
    likelihood: float = HEIGHT * np.log(max(high - low, LAYER)) + SQUARE * areas[square].sum() / total
    return likelihood + LAYERED * layered / max(level, np.finfo(np.float64).tiny)
