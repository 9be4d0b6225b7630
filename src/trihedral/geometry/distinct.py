"""Poses that differ, out of many of which some are nearly the same."""

from collections.abc import Iterable

import numpy as np
from scipy.spatial import KDTree

from trihedral.geometry.arrays import Float64


def distinct(
    poses: Float64, order: Iterable[int], *, translation: float, rotation: float, count: int | None = None
) -> list[int]:
    """Take poses in their order, leaving out each that is near one that was taken before.

    Parameters
    ----------
    poses
        (N, 4, 4) motions between the same two frames.
    order
        Indices of poses, best first.
    translation, rotation
        Poses at most so far (m) and so much turned (radians) from each other are near.
    count
        Poses taken, at the most.

    Returns
    -------
    list
        Indices of the poses taken, best first.
    """
    near = KDTree(poses[:, :3, 3]).query_pairs(translation, output_type="ndarray")
    # The norm of the difference of two rotation matrices is sqrt(8) sin(angle / 2).
    rotations = poses[near[:, 0], :3, :3] - poses[near[:, 1], :3, :3]
    near = near[(rotations**2).sum(axis=(1, 2)) <= 8 * np.sin(rotation / 2) ** 2]
    near = np.concatenate([near, near[:, ::-1]])
    near = near[np.argsort(near[:, 0], kind="stable")]
    starts = np.searchsorted(near[:, 0], np.arange(len(poses) + 1))
    left = np.ones(len(poses), dtype=np.bool_)
    taken: list[int] = []
    for index in order:
        if len(taken) == count:
            break
        if left[index]:
            taken.append(int(index))
            left[near[starts[index] : starts[index + 1], 1]] = False
    return taken
