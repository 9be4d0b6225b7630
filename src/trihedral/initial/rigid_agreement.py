"""The rigid motion that most of a set of lifted matches agree on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.kabsch import UndeterminedMotion, kabsch
from trihedral.geometry.motion import transform

Float64 = NDArray[np.float64]

# Matches that propose motions, best supported first, and how many supporters each is fitted with.
SEEDS = 60
SUPPORTERS = 12
# Matches compared at the most; the memory and time of the comparison grow with the square and the cube of it.
MOST = 1500
# Two matches nearer to each other than this many tolerances support each other whatever the motion.
APART = 4.0


@dataclass(frozen=True)
class RigidAgreement:
    """``b_from_a`` and the matches that follow it, (M,)."""

    pose: Float64
    inliers: NDArray[np.bool_]


def rigid_agreement(points_a: Float64, points_b: Float64, tolerance: Float64) -> RigidAgreement | None:
    """The motion that most matches follow, by the distances that any rigid motion keeps.

    Parameters
    ----------
    points_a, points_b
        (M, 3) metres, matched row by row, the most distinct match first.
    tolerance
        (M,) metres within which a match follows a motion.

    Returns
    -------
    The motion, fitted to its inliers by `kabsch` with weights ``1 / tolerance**2``; None if no three matches agree.

    Notes
    -----
    Two right matches are equally far apart in both scans. Matches are ranked by the number of others that keep their
    distance both to them and to their supporters (the second-order measure of Chen et al., "SC2-PCR", CVPR 2022); each
    of the best proposes the motion of itself with its supporters. Samples are chosen by this rank instead of by chance,
    so there is no seed and both directions try the same ones.
    """
    count = min(len(points_a), MOST)
    a, b, limit = points_a[:count], points_b[:count], tolerance[:count]
    if count < 3:
        return None
    apart_a, apart_b = _distances(a), _distances(b)
    either = limit[:, None] + limit
    compatible = np.abs(apart_a - apart_b) <= either
    compatible &= np.minimum(apart_a, apart_b) > APART * either
    adjacency = compatible.astype(np.float32)
    support = (adjacency @ adjacency) * adjacency
    ranked = np.argsort(-support.sum(axis=1), kind="stable")[:SEEDS]

    best: RigidAgreement | None = None
    for seed in ranked:
        group = np.argsort(-support[seed], kind="stable")[:SUPPORTERS]
        group = np.concatenate([[seed], group[support[seed, group] > 0]])
        found = _grown(points_a, points_b, tolerance, group)
        if found is not None and (best is None or found.inliers.sum() > best.inliers.sum()):
            best = found
    return best


def _grown(a: Float64, b: Float64, tolerance: Float64, group: NDArray[np.intp]) -> RigidAgreement | None:
    """Fit, take what follows, fit again, until nothing changes."""
    inliers = np.zeros(len(a), dtype=bool)
    inliers[group] = True
    best: RigidAgreement | None = None
    for _ in range(20):
        try:
            pose = kabsch(a[inliers], b[inliers], 1 / tolerance[inliers] ** 2)
        except UndeterminedMotion:
            return best
        following = np.linalg.norm(transform(pose, a) - b, axis=1) <= tolerance
        if best is not None and following.sum() < best.inliers.sum():
            return best
        settled = bool((following == inliers).all())
        best, inliers = RigidAgreement(pose, following), following
        if settled:
            return best
    return best


def _distances(points: Float64) -> Float64:
    x, y, z = (axis[:, None] - axis for axis in points.T)
    distances: Float64 = np.sqrt(x * x + y * y + z * z)
    return distances
