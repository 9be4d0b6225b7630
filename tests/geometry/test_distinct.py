"""Distinct poses against trying every pair of them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.geometry.distinct import distinct
from trihedral.geometry.se3 import distance, motion


def scattered(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.normal(scale=0.05, size=(count, 3))).as_matrix()
    return np.array([motion(r, t) for r, t in zip(turns, rng.uniform(0, 1.5, (count, 3)), strict=True)])


@pytest.mark.parametrize("count", [None, 7])
def test_none_taken_is_near_one_before_and_each_left_out_is(count):
    poses = scattered(200, seed=1)
    order = np.random.default_rng(2).permutation(200)
    taken = distinct(poses, order, translation=0.3, rotation=np.radians(3), count=count)
    expected: list[int] = []
    for index in order:
        apart = [distance(poses[index], poses[other]) for other in expected]
        if all(t > 0.3 or r > np.radians(3) for t, r in apart):
            expected.append(int(index))
    assert taken == expected[:count]
    assert 7 < len(expected) < 200


def test_no_poses_give_none():
    assert distinct(np.empty((0, 4, 4)), [], translation=0.1, rotation=0.1) == []
