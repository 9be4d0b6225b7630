"""Poses from shape: rolling ground with boulders, nothing plane, from two places and at any tilt."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.geometry.motion import distance, inverse, motion, transform
from trihedral.initial.described import described
from trihedral.initial.hypotheses import HypothesisOptions, hypotheses
from trihedral.initial.shape import ShapeOptions
from trihedral.scan import Scan
from trihedral.scan.preparation import prepare

sys.path.append(str(Path(__file__).resolve().parent))
from textured_room import scan_room

SHAPE = HypothesisOptions(sources=("shape",))
HALL = 14.0  # metres, radius of the rough dome


def boulders(seed):
    rng = np.random.default_rng(seed)
    centres = np.column_stack([rng.uniform(-10, 10, (60, 2)), rng.uniform(-2.2, -1.2, 60)])
    return centres[np.hypot(*centres[:, :2].T) > 3.0], rng.uniform(0.4, 1.6, 60)


def seen_from(position, rotation_deg, seed=1, place=0):
    """The prepared scan of boulders on the floor of a dome, and project_from_station."""
    scan, _ = scan_room((0, 0, 0), (0, 0, 0), seed=seed, look=None)
    directions = scan.xyz.astype(np.float64)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rotation = Rotation.from_euler("zyx", rotation_deg, degrees=True).as_matrix()
    position = np.array(position, dtype=np.float64)
    rays = directions @ rotation.T
    along = rays @ position
    distances = -along + np.sqrt(along**2 - position @ position + HALL**2)
    centres, radii = boulders(place)
    for centre, radius in zip(centres, radii, strict=False):
        before = rays @ (position - centre)
        inside = before**2 - (position - centre) @ (position - centre) + radius**2
        near = -before - np.sqrt(np.maximum(inside, 0))
        distances = np.where((inside > 0) & (near > 0), np.minimum(distances, near), distances)
    distances += 0.002 * np.random.default_rng(seed).standard_normal(len(distances))
    xyz = (directions * distances[:, None]).astype(np.float32)
    seen = Scan(scan.header, xyz, np.zeros(3), row=scan.row, column=scan.column)
    return described(prepare(seen), seen, SHAPE), motion(rotation, position)


@pytest.fixture(scope="module")
def first():
    return seen_from((0.5, -0.4, 0.1), (25, 0, 0))


@pytest.mark.parametrize("rotation", [(-70, 0, 0), (100, 20, -15), (10, 120, 60)])
def test_the_pose_is_proposed_first_whatever_the_tilt(first, rotation):
    a, a_pose = first
    b, b_pose = seen_from((-0.9, 0.8, 0.3), rotation, seed=2)
    best = hypotheses(a, b, SHAPE)[0]
    off, turned = distance(best.pose, inverse(b_pose) @ a_pose)
    assert best.source == "shape"
    assert off < 0.6 and np.degrees(turned) < 4


def test_another_place_agrees_on_less(first):
    a, _ = first
    same, _ = seen_from((-0.9, 0.8, 0.3), (-70, 0, 0), seed=2)
    other, _ = seen_from((-0.9, 0.8, 0.3), (-70, 0, 0), seed=2, place=5)
    best = max((h.score for h in hypotheses(a, other, SHAPE)), default=0.0)
    assert best < 0.5 * hypotheses(a, same, SHAPE)[0].score


def test_places_on_a_plain_dome_are_not_described(first):
    prepared, pose = first
    places = transform(pose, prepared.shape_points)
    fine = places[prepared.shape_levels == 0]
    centres, radii = boulders(0)
    radii = radii[: len(centres)]
    to_boulder = (np.linalg.norm(fine[:, None] - centres, axis=2) - radii).min(axis=1)
    reach = ShapeOptions().reach * ShapeOptions().spacings[0]
    assert len(fine) > 100
    assert (to_boulder < reach).all()


def test_descriptors_do_not_turn_with_the_scan(first):
    a, a_pose = first
    b, b_pose = seen_from((0.5, -0.4, 0.1), (80, 35, 10), seed=1)
    places_a, places_b = transform(a_pose, a.shape_points), transform(b_pose, b.shape_points)
    apart = np.linalg.norm(places_a[:, None] - places_b, axis=2)
    apart[a.shape_levels[:, None] != b.shape_levels] = np.inf
    nearest = apart.argmin(axis=1)
    close = apart.min(axis=1) < 0.1
    values_a, values_b = (p.shape_descriptors.astype(np.float64) for p in (a, b))
    same = np.linalg.norm(values_a[close] - values_b[nearest[close]], axis=1)
    chance = np.linalg.norm(values_a[close] - np.roll(values_b[nearest[close]], 7, axis=0), axis=1)
    assert close.sum() > 30
    assert np.median(same) < 0.5 * np.median(chance)
