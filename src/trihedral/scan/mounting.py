"""How the scanner was mounted: which way is up in a scan that hangs, lies, or is of other axes."""

from dataclasses import dataclass, replace

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
# Metres that a tripod holds a scanner above its floor, and the share of a scan's surface that a floor or ceiling has.
TRIPOD = (1.2, 2.3)
LEAST_LEVEL = 0.05
TURNED_OVER = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Mounting:
    """Ways in which the scanner may have been mounted.

    Attributes
    ----------
    upright_from_scanner
        (M, 3, 3) rotations that set the scan upright but for a lean of some degrees, the likeliest first.
    log_likelihood
        (M,) against the likeliest.
    either_way
        Whether up may as well be down.
    """

    upright_from_scanner: Float64
    log_likelihood: Float64
    either_way: bool

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

    @property
    def turned_over(self) -> "Mounting":
        """The same with up and down exchanged."""
        return replace(self, upright_from_scanner=TURNED_OVER @ self.upright_from_scanner)


STANDING_UPRIGHT = Mounting(np.eye(3)[None], np.zeros(1), either_way=False)


def mounting(surfels: Surfels, patch_normals: NDArray[np.floating], noise: NoiseModel) -> Mounting:
    """Tell how the scanner was mounted from the surface that it saw.

    A place is lower than it is wide, its surface level or upright, and what is level lies in few layers. Which of two
    opposite directions is up the surface hardly says: the one along an axis of the scanner is taken, and may be down
    unless a floor is as far below as below a tripod.
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
    either_way = bool(kept[0] != 0) or not _on_a_tripod(*seen)
    return Mounting(np.array(rotations), likelihood[kept], either_way)


def _on_a_tripod(points: Float64, normals: Float64, areas: Float64) -> bool:
    """Whether what is level about a scanner is where a standing one has it, and not where a hanging one does."""
    distance = []
    for up in (1.0, -1.0):
        facing = (up * normals[:, 2] > np.cos(2 * TOLERANCE)) & (up * points[:, 2] < 0)
        area, height = _thickest_layer(points[facing, 2], areas[facing])
        distance.append(abs(height) if area > LEAST_LEVEL * areas.sum() else np.inf)
    below, above = distance
    if TRIPOD[0] < below < TRIPOD[1]:
        return not below < above < TRIPOD[1]
    return not np.isfinite(above)


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
        level += areas[facing].sum()
        layered += _thickest_layer(heights[facing], areas[facing])[0]
    likelihood: float = HEIGHT * np.log(max(high - low, LAYER)) + SQUARE * areas[square].sum() / total
    return likelihood + LAYERED * layered / max(level, np.finfo(np.float64).tiny)


def _thickest_layer(heights: Float64, areas: Float64) -> tuple[float, float]:
    """Area and height of the layer that has most of some surface (N,)."""
    if not len(heights):
        return 0.0, 0.0
    slices = np.floor(3 * heights / LAYER).astype(np.int64)
    filled = np.bincount(slices - slices.min() + 1, areas, np.ptp(slices) + 3)
    layers = filled[:-2] + filled[1:-1] + filled[2:]
    best = int(layers.argmax())
    return float(layers[best]), (slices.min() + best + 0.5) * LAYER / 3
