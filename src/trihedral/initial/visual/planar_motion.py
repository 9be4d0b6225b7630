"""The rotation and shift between two pictures that most matches follow (Eq. 3 of the paper)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Bool, Float64, Floating


@dataclass(frozen=True)
class PlanarMotionOptions:
    """How Eq. 3 is sought."""

    #: A match follows the motion within this share of the picture's diagonal. Eq. 3 is exact only for a distant scene
    #: or one that faces the camera, so this is much more than a keypoint's own error.
    tolerance: float = 0.02
    #: Pairs of matches that are tried.
    samples: int = 2000

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise OptionError(f"planar tolerance is {self.tolerance}: a share between 0 and 1 is needed")
        if self.samples < 1:
            raise OptionError("samples must be at least 1")


@dataclass(frozen=True)
class PlanarMotion:
    """``[x2, y2] = R(angle) [x1, y1] + shift``."""

    #: Radians, from x towards y.
    angle: float
    #: (2,) pixels.
    shift: Float64
    #: (M,) the matches that follow it.
    inliers: Bool


def planar_motion(
    pixels_a: Floating,
    pixels_b: Floating,
    tolerance: float,
    samples: int,
    rng: np.random.Generator,
) -> PlanarMotion | None:
    """RANSAC on Eq. 3: of the motions through two matches, the one that most matches follow, fitted to these.

    Parameters
    ----------
    pixels_a, pixels_b
        (M, 2) x, y of matched keypoints.
    tolerance
        Pixels within which a match follows the motion.
    samples
        Pairs of matches tried; all of them where there are no more.

    Returns
    -------
    The motion, or None where no two matches are as far apart in one picture as in the other.
    """
    a, b = np.asarray(pixels_a, dtype=np.float64), np.asarray(pixels_b, dtype=np.float64)
    i, j = _pairs(len(a), samples, rng)
    along_a, along_b = a[j] - a[i], b[j] - b[i]
    length_a, length_b = np.hypot(*along_a.T), np.hypot(*along_b.T)
    # Two matches at one place fix no angle; two that follow one motion are equally far apart in both pictures.
    usable = (np.minimum(length_a, length_b) > tolerance) & (np.abs(length_a - length_b) <= 2 * tolerance)
    if not usable.any():
        return None
    i, j, along_a, along_b = i[usable], j[usable], along_a[usable], along_b[usable]
    angles = np.arctan2(*along_b.T[::-1]) - np.arctan2(*along_a.T[::-1])
    cos, sin = np.cos(angles), np.sin(angles)
    middle_a, middle_b = (a[i] + a[j]) / 2, (b[i] + b[j]) / 2
    shift_x = middle_b[:, 0] - cos * middle_a[:, 0] + sin * middle_a[:, 1]
    shift_y = middle_b[:, 1] - sin * middle_a[:, 0] - cos * middle_a[:, 1]
    offset_x = cos[:, None] * a[:, 0] - sin[:, None] * a[:, 1] + shift_x[:, None] - b[:, 0]
    offset_y = sin[:, None] * a[:, 0] + cos[:, None] * a[:, 1] + shift_y[:, None] - b[:, 1]
    counts = (offset_x**2 + offset_y**2 <= tolerance**2).sum(axis=1)
    best = int(counts.argmax())
    angle, shift = float(angles[best]), np.array([shift_x[best], shift_y[best]])
    inliers = _following(a, b, angle, shift, tolerance)
    for _ in range(10):
        fitted = _fit(a[inliers], b[inliers])
        following = _following(a, b, *fitted, tolerance)
        if following.sum() < inliers.sum():
            break
        angle, shift = fitted
        if (following == inliers).all():
            break
        inliers = following
    return PlanarMotion(float(np.arctan2(np.sin(angle), np.cos(angle))), shift, inliers)


def _pairs(count: int, samples: int, rng: np.random.Generator) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    if count * (count - 1) // 2 <= samples:
        i, j = np.triu_indices(count, 1)
        return i, j
    i = rng.integers(0, count, samples)
    j = rng.integers(0, count - 1, samples)
    return i, j + (j >= i)


def _following(a: Float64, b: Float64, angle: float, shift: Float64, tolerance: float) -> Bool:
    cos, sin = np.cos(angle), np.sin(angle)
    moved = a @ np.array([[cos, sin], [-sin, cos]]) + shift
    close: Bool = ((moved - b) ** 2).sum(axis=1) <= tolerance**2
    return close


def _fit(a: Float64, b: Float64) -> tuple[float, Float64]:
    """Least squares: the plane's case of Kabsch's problem, where the angle has a closed form."""
    centre_a, centre_b = a.mean(axis=0), b.mean(axis=0)
    p, q = a - centre_a, b - centre_b
    angle = float(np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum()))
    cos, sin = np.cos(angle), np.sin(angle)
    return angle, centre_b - np.array([[cos, -sin], [sin, cos]]) @ centre_a
