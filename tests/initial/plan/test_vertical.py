"""Verticals, headings and hypotheses of a room that leans by a known angle."""

import numpy as np
import pytest

from support.room import room_view
from trihedral.geometry.se3 import distance, inverse
from trihedral.initial.hypotheses import HypothesisOptions, propose
from trihedral.initial.plan.headings import turns, wall_headings
from trihedral.initial.plan.vertical import upright_rotations
from trihedral.model.link import LinkVerdict
from trihedral.pair.auto import AutoOptions, register_pair
from trihedral.verdict.verification import VerificationOptions, rank


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (12.0, -9.0), (-18.0, 6.0)])
def test_the_vertical_of_a_leaning_scan_is_found(tilt):
    prepared, project_from_station = room_view((0.5, -0.3, 0.1), 40.0, tilt)
    up = upright_rotations(prepared)[0].T @ np.array([0.0, 0.0, 1.0])
    true = project_from_station[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    assert np.degrees(np.arccos(np.clip(up @ true, -1, 1))) < 0.2


def test_the_true_turn_is_among_the_headings():
    a, a_pose = room_view((0.5, -0.3, 0.1), 33.4)
    b, b_pose = room_view((-1.0, 0.8, 0.0), -71.0, seed=2)
    relative = inverse(b_pose) @ a_pose
    true = np.arctan2(relative[1, 0], relative[0, 0])
    found = turns(wall_headings(a, np.eye(3)), wall_headings(b, np.eye(3)), 8)
    off = np.abs((found - true + np.pi) % (2 * np.pi) - np.pi)
    assert np.degrees(off.min()) < 0.3


def test_without_walls_turns_go_all_round():
    flat = np.zeros(360)
    found = np.sort(np.degrees(turns(flat, flat, 12)))
    assert np.diff(found).max() < 60


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (15.0, -8.0)])
def test_a_pair_is_tied_to_a_tenth_of_the_noise(tilt):
    a, a_pose = room_view((0.5, -0.3, 0.1), 33.0, tilt, paint=3)
    b, b_pose = room_view((-1.0, 0.8, 0.0), -71.0, seed=2, paint=3)
    true = inverse(b_pose) @ a_pose
    poses = propose(a, b, HypothesisOptions())
    assert any(distance(pose, true)[0] < 0.8 for pose in poses)
    best = rank(a, b, poses, VerificationOptions())[0].pose
    assert distance(best, true)[0] < 0.02
    link = register_pair(a, b, AutoOptions())
    off, turned = distance(link.transform, true)
    assert link.verdict is LinkVerdict.ACCEPTED
    assert off < 0.0005
    assert np.degrees(turned) < 0.01


def test_a_room_of_which_only_the_shape_is_known_may_be_a_copy():
    a, a_pose = room_view((0.5, -0.3, 0.1), 33.0)
    b, b_pose = room_view((-1.0, 0.8, 0.0), -71.0, seed=2)
    link = register_pair(a, b, AutoOptions())
    assert distance(link.transform, inverse(b_pose) @ a_pose)[0] < 0.0005
    assert link.verdict is LinkVerdict.DOUBTFUL
    assert "rooms have copies, and nothing is known of its appearance" in link.reason


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        ({"paint": 4}, "do not look the same"),
        ({"paint": 3, "box": False}, "stand where the other scan saw empty space"),
    ],
)
def test_rooms_that_are_alike_but_look_otherwise_or_hold_other_things_are_not_accepted(other, reason):
    a, _ = room_view((0.5, -0.3, 0.1), 33.0, paint=3)
    b, _ = room_view((-1.0, 0.8, 0.0), -71.0, seed=2, **other)
    link = register_pair(a, b, AutoOptions())
    assert link.verdict is not LinkVerdict.ACCEPTED
    assert reason in link.reason
