"""The paper's measures of a pose against the true one: deviation angles and root mean square distance."""

import numpy as np

from trihedral.geometry.arrays import Floating
from trihedral.geometry.se3 import Matrix, transform


def deviation_angles(found: Matrix, true: Matrix) -> tuple[float, float, float]:
    """Degrees about the x, y and z axes of frame `b` that still turn a scan from where it was put to where it belongs.

    The rotation between the two poses ``b_from_a`` as angles about fixed axes, x first. A scan that was not moved at
    all (`found` the identity) has the paper's "original" deviation.
    """
    rest = true[:3, :3] @ found[:3, :3].T
    y = np.arctan2(-rest[2, 0], np.hypot(rest[0, 0], rest[1, 0]))
    x = np.arctan2(rest[2, 1], rest[2, 2])
    z = np.arctan2(rest[1, 0], rest[0, 0])
    return float(np.degrees(x)), float(np.degrees(y)), float(np.degrees(z))


def displacement_rmse(points: Floating, found: Matrix, true: Matrix) -> float:
    """Root mean square distance (m) between where two poses put each of the points (N, 3)."""
    off = transform(found, points) - transform(true, points)
    return float(np.sqrt(np.mean(np.einsum("ij,ij->i", off, off))))
