"""Poses that a pair offers: the right one among them, each distinct, none where a scan has no surface."""

import numpy as np
import pytest

from support.textured_room import scan_room
from trihedral.geometry.se3 import distance, inverse
from trihedral.initial.hypotheses import propose
from trihedral.scan.preparation import prepare


@pytest.fixture(scope="module")
def pair():
    made = []
    for seed, (position, rotation) in enumerate(
        (((0.8, -0.4, 0.1), (25, 0, 0)), ((-0.6, 0.3, 0.0), (-70, 3, 0)))
    ):
        scan, pose = scan_room(position, rotation, seed=seed)
        made.append((prepare(scan), pose))
    (a, a_pose), (b, b_pose) = made
    return a, b, inverse(b_pose) @ a_pose


def test_one_of_them_is_near_the_truth(pair):
    a, b, true = pair
    assert min(distance(pose, true)[0] for pose in propose(a, b)) < 0.6


def test_they_are_distinct(pair):
    a, b, _ = pair
    poses = np.array(propose(a, b))
    for k in range(0, len(poses), 17):
        for other in poses[:k]:
            off, turned = distance(poses[k], other)
            at_origin = np.linalg.norm(poses[k][:3, 3] - other[:3, 3])
            assert max(off, at_origin) >= 0.0999 or turned >= np.radians(0.99)
