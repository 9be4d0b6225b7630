"""The rigid motion that takes one set of points nearest to another (Eq. 4 of the paper)."""

import numpy as np

from trihedral.errors import TrihedralError
from trihedral.geometry.arrays import Float64, Floating
from trihedral.geometry.se3 import Matrix, motion

# Points whose second extent is below this share of the first are on one line, as far as float32 coordinates tell.
COLLINEAR = 1e-6


class UndeterminedMotion(TrihedralError):  # noqa: N818 - it is an outcome as much as an error
    """Points that do not fix a rigid motion; the text says why."""


def kabsch(
    points_a: Floating,
    points_b: Floating,
    weights: Floating | None = None,
) -> Matrix:
    """Least-squares ``b_from_a`` of matched points, always a proper rotation.

    Parameters
    ----------
    points_a, points_b
        (N, 3), metres; row by row the same places in both frames.
    weights
        (N,), not negative; a point of weight 0 does not count.

    Returns
    -------
    4x4 ``b_from_a`` that minimises the weighted sum of squared distances. For mirrored points it is the best
    rotation, not the reflection that would fit.

    Raises
    ------
    UndeterminedMotion
        If fewer than three points count, if they lie on one line, or if several rotations fit equally well.
    ValueError
        If the arrays differ in shape, hold values that are not finite, or weights are negative.

    Notes
    -----
    W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Cryst. A32 (1976), with the
    determinant's sign as in his note of 1978.
    """
    a, b, w = _counted(points_a, points_b, weights)
    w = w / w.sum()
    centre_a, centre_b = w @ a, w @ b
    centred_a, centred_b = a - centre_a, b - centre_b
    for centred in (centred_a, centred_b):
        extents = np.linalg.svd(centred, compute_uv=False)
        if extents[1] <= COLLINEAR * extents[0]:
            raise UndeterminedMotion(
                "The matched points lie on one line: the rotation about it is not determined."
            )
    u, spread, vt = np.linalg.svd((centred_b * w[:, None]).T @ centred_a)
    sign = 1.0 if np.linalg.det(u) * np.linalg.det(vt) >= 0 else -1.0
    # The rotation is unique only while the two least singular values, the last with its sign, do not cancel.
    if spread[1] + sign * spread[2] <= COLLINEAR**2 * spread[0]:
        raise UndeterminedMotion(
            "The matched points fit several rotations equally well: they are no rigid copy."
        )
    rotation = u @ np.diag([1.0, 1.0, sign]) @ vt
    return motion(rotation, centre_b - rotation @ centre_a)


def _counted(
    points_a: Floating, points_b: Floating, weights: Floating | None
) -> tuple[Float64, Float64, Float64]:
    """Points that have a weight, and the weights."""
    a = np.asarray(points_a, dtype=np.float64)
    b = np.asarray(points_b, dtype=np.float64)
    if a.ndim != 2 or a.shape[1] != 3 or a.shape != b.shape:
        raise ValueError(f"matched points must be two arrays (N, 3), not {a.shape} and {b.shape}")
    w = np.ones(len(a)) if weights is None else np.asarray(weights, dtype=np.float64)
    if w.shape != (len(a),):
        raise ValueError(f"{len(a)} points need as many weights, not {w.shape}")
    if not (np.isfinite(a).all() and np.isfinite(b).all() and np.isfinite(w).all()):
        raise ValueError("points and weights must be finite")
    if (w < 0).any():
        raise ValueError("weights must not be negative")
    counted = w > 0
    a, b, w = a[counted], b[counted], w[counted]
    if len(a) < 3:
        raise UndeterminedMotion(
            f"A rigid motion needs at least three matched points; there {'is' if len(a) == 1 else 'are'} {len(a)}."
        )
    return a, b, w
