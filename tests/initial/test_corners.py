"""Poses from corners: a room with steps in it, from two places, at any tilt and without looks."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.geometry.motion import distance, inverse, motion, transform
from trihedral.initial.described import described
from trihedral.initial.hypotheses import HypothesisOptions, hypotheses
from trihedral.scan import Scan
from trihedral.scan.preparation import prepare

sys.path.append(str(Path(__file__).resolve().parent))
from textured_room import SIZE, scan_room

CORNERS = HypothesisOptions(sources=("corners",))
# Two blocks that stand on the floor against walls, so that the room is like itself in one pose only.
BLOCKS = np.array([[[1.5, -2.5, -1.5], [3.5, -1.0, -0.3]], [[-3.5, 0.7, -1.5], [-2.3, 2.5, 0.4]]])


def seen_from(position, rotation_deg, seed=1, rooms=1.0):
    """The prepared room of blocks and its project_from_station."""
    scan, _ = scan_room((0, 0, 0), (0, 0, 0), seed=seed, look=None)
    directions = scan.xyz.astype(np.float64)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rotation = Rotation.from_euler("zyx", rotation_deg, degrees=True).as_matrix()
    position = np.array(position, dtype=np.float64)
    rays = directions @ rotation.T
    with np.errstate(divide="ignore"):
        distances = ((np.sign(rays) * SIZE * rooms / 2 - position) / rays).min(axis=1)
        for low, high in BLOCKS * rooms:
            to_low, to_high = (low - position) / rays, (high - position) / rays
            near, far = np.minimum(to_low, to_high).max(axis=1), np.maximum(to_low, to_high).min(axis=1)
            distances = np.where((near > 0) & (near < far), np.minimum(distances, near), distances)
    distances += 0.002 * np.random.default_rng(seed).standard_normal(len(distances))
    xyz = (directions * distances[:, None]).astype(np.float32)
    seen = Scan(scan.header, xyz, np.zeros(3), row=scan.row, column=scan.column)
    return described(prepare(seen), seen, CORNERS), motion(rotation, position)


@pytest.fixture(scope="module")
def upright():
    return seen_from((0.8, -0.4, 0.1), (25, 0, 0))


@pytest.mark.parametrize("rotation", [(-70, 0, 0), (100, 20, -15), (10, 120, 60)])
def test_the_pose_is_proposed_first_whatever_the_tilt(upright, rotation):
    a, a_pose = upright
    b, b_pose = seen_from((-0.9, 0.2, 0.3), rotation, seed=2)
    best = hypotheses(a, b, CORNERS)[0]
    off, turned = distance(best.pose, inverse(b_pose) @ a_pose)
    assert best.source == "corners"
    assert off < 0.05 and np.degrees(turned) < 0.5


def test_the_corners_of_the_room_are_found(upright):
    prepared, pose = upright
    places = transform(pose, prepared.corner_points)
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    hidden = 0
    for corner in signs * SIZE / 2:
        hidden += np.linalg.norm(places - corner, axis=1).min() > 0.03
    # The blocks stand in two of the eight.
    assert hidden <= 2
    normals = prepared.facet_planes[prepared.corner_facets, :3]
    assert (np.linalg.det(normals) > 0).all()


def test_poses_are_distinct_and_the_best_comes_first(upright):
    a, _ = upright
    b, _ = seen_from((-0.9, 0.2, 0.3), (-70, 0, 0), seed=2)
    found = hypotheses(a, b, CORNERS)
    assert len(found) > 5
    scores = [h.score for h in found]
    assert scores == sorted(scores, reverse=True)
    for k, one in enumerate(found):
        for other in found[:k]:
            off, turned = distance(one.pose, other.pose)
            assert off >= 0.1 or np.degrees(turned) >= 0.99


def test_a_room_of_another_size_agrees_on_less(upright):
    a, _ = upright
    same, _ = seen_from((-0.9, 0.2, 0.3), (-70, 0, 0), seed=2)
    other, _ = seen_from((-0.9, 0.2, 0.3), (-70, 0, 0), seed=2, rooms=1.3)
    best = max((h.score for h in hypotheses(a, other, CORNERS)), default=0.0)
    assert best < 0.8 * hypotheses(a, same, CORNERS)[0].score
