"""Poses from features on patches seen straight on: a single match is enough, whatever the tilt."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trihedral.geometry.motion import distance, inverse, transform
from trihedral.initial.described import described
from trihedral.initial.hypotheses import HypothesisOptions, hypotheses
from trihedral.initial.matching import match
from trihedral.initial.rectified import RectifiedOptions
from trihedral.scan.preparation import prepare

sys.path.append(str(Path(__file__).resolve().parent))
from textured_room import SIZE, scan_room

RECTIFIED = HypothesisOptions(sources=("rectified",))


def seen_from(*args, **kwargs):
    scan, pose = scan_room(*args, **kwargs)
    return described(prepare(scan), scan, RECTIFIED), pose


@pytest.fixture(scope="module")
def pair():
    a, a_pose = seen_from((1.5, -0.8, 0.1), (25, 0, 0), seed=1)
    b, b_pose = seen_from((-1.3, 0.6, -0.2), (-70, 30, 20), seed=2)
    return a, b, inverse(b_pose) @ a_pose, a_pose


def test_the_pose_is_proposed_first_whatever_the_tilt(pair):
    a, b, true, _ = pair
    best = hypotheses(a, b, RECTIFIED)[0]
    off, turned = distance(best.pose, true)
    assert best.source == "rectified"
    assert off < 0.05 and np.degrees(turned) < 0.5


def test_a_single_match_gives_the_pose(pair):
    a, b, true, _ = pair
    options = RectifiedOptions()
    found = match(
        a.rectified_descriptors.astype(np.float32),
        b.rectified_descriptors.astype(np.float32),
        options.match,
        sizes=(a.rectified_sizes, b.rectified_sizes),
    )
    off = np.linalg.norm(transform(true, a.rectified_points[found.a]) - b.rectified_points[found.b], axis=1)
    assert (off < 0.05).sum() >= 10
    right = int(np.flatnonzero(off < 0.05)[0])

    def alone(prepared, index):
        # A second keypoint that is like nothing: a match must beat a runner-up.
        blank = np.zeros((1, 128), dtype=np.uint8)
        kept = {
            name: getattr(prepared, name)[[index, index]]
            for name in ("rectified_points", "rectified_normals", "rectified_along", "rectified_sizes")
        }
        return replace(
            prepared,
            rectified_descriptors=np.concatenate([prepared.rectified_descriptors[[index]], blank]),
            **kept,
        )

    poses = hypotheses(alone(a, found.a[right]), alone(b, found.b[right]), RECTIFIED)
    assert min(distance(h.pose, true)[0] for h in poses) < 0.1


def test_frames_lie_on_the_walls(pair):
    a, _, _, pose = pair
    places = transform(pose, a.rectified_points)
    wall = np.abs(np.abs(places) - SIZE / 2).argmin(axis=1)
    assert np.abs(np.abs(places) - SIZE / 2).min(axis=1).max() < 0.02
    normals = a.rectified_normals @ pose[:3, :3].T
    inwards = -np.sign(places[np.arange(len(wall)), wall])
    assert (normals[np.arange(len(wall)), wall] * inwards > 0.999).all()
    assert np.abs(np.einsum("ij,ij->i", a.rectified_normals, a.rectified_along)).max() < 1e-4


def test_without_looks_there_are_no_keypoints_and_no_poses(pair):
    bare, _ = seen_from((1.5, -0.8, 0.1), (25, 0, 0), look=None)
    assert len(bare.rectified_points) == 0
    assert hypotheses(bare, pair[1], RECTIFIED) == []
