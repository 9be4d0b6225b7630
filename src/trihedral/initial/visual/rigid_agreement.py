"""The rigid motion that most of a set of lifted matches agree on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Bool, Float64
from trihedral.geometry.kabsch import UndeterminedMotion, kabsch
from trihedral.geometry.se3 import transform

# Matches that propose motions, best supported first, and how many supporters each is fitted with.
SEEDS = 60
SUPPORTERS = 12
# Matches compared at the most; the memory and time of the comparison grow with the square and the cube of it.
MOST = 1500
# Two matches nearer to each other than this many tolerances support each other whatever the motion.
APART = 4.0
# Matches of one group that must follow a motion, or none of the group counts.
LEAST_TOGETHER = 3


@dataclass(frozen=True)
class RigidAgreement:
    """``b_from_a`` and the matches that follow it, (M,)."""

    pose: Float64
    inliers: Bool


def rigid_agreement(
    points_a: Float64, points_b: Float64, tolerance: Float64, group: NDArray[np.intp] | None = None
) -> RigidAgreement | None:
    """The motion that most matches follow, by the distances that any rigid motion keeps.

    Parameters
    ----------
    points_a, points_b
        (M, 3) metres, matched row by row, the most distinct match first.
    tolerance
        (M,) metres within which a match follows a motion.
    group
        (M,) what the matches come from, numbered from 0, such as the picture pair. Pictures that show the same place
        share several matches; one that follows a motion alone in its group does so by chance, and far from the others
        it would turn the motion. All are one group if None.

    Returns
    -------
    The motion, fitted to its inliers by `kabsch` with weights ``1 / tolerance**2``; None if no three matches agree. Of
    several the one with the greatest sum of ``1 - (distance / tolerance)**2`` over its inliers.

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

    matches = _Matches(
        points_a, points_b, tolerance, np.zeros(len(points_a), dtype=np.intp) if group is None else group
    )
    found: list[tuple[RigidAgreement | None, float]] = []
    for seed in ranked:
        supporters = np.argsort(-support[seed], kind="stable")[:SUPPORTERS]
        found.append(_grown(matches, np.concatenate([[seed], supporters[support[seed, supporters] > 0]])))
    return max(found, key=lambda item: item[1])[0]


@dataclass(frozen=True)
class _Matches:
    a: Float64
    b: Float64
    tolerance: Float64
    group: NDArray[np.intp]


def _grown(matches: _Matches, supporters: NDArray[np.intp]) -> tuple[RigidAgreement | None, float]:
    """Fit, take what follows, fit again, until nothing changes or it gets worse; the best and its score."""
    inliers = np.zeros(len(matches.a), dtype=bool)
    inliers[supporters] = True
    best: RigidAgreement | None = None
    best_score = 0.0
    for _ in range(20):
        try:
            weights = 1 / matches.tolerance[inliers] ** 2
            pose = kabsch(matches.a[inliers], matches.b[inliers], weights)
        except UndeterminedMotion:
            break
        offset = np.linalg.norm(transform(pose, matches.a) - matches.b, axis=1) / matches.tolerance
        following = offset <= 1
        together = np.bincount(matches.group, weights=following)
        following &= together[matches.group] >= LEAST_TOGETHER
        score = float((1 - offset[following] ** 2).sum())
        if score <= best_score:
            break
        settled = bool((following == inliers).all())
        best, best_score, inliers = RigidAgreement(pose, following), score, following
        if settled:
            break
    return best, best_score


def _distances(points: Float64) -> Float64:
    x, y, z = (axis[:, None] - axis for axis in points.T)
    distances: Float64 = np.sqrt(x * x + y * y + z * z)
    return distances
