"""Appearance of rooms that are the same in shape: painted walls of known texture, seen twice."""

import dataclasses

import numpy as np
import pytest

from support.room import HALF, room_scan
from trihedral.geometry.se3 import motion
from trihedral.scan.preparation import prepare
from trihedral.verdict import verification
from trihedral.verdict.appearance import AppearanceOptions, appearance_similarity
from trihedral.verdict.evidence import EvidenceOptions
from trihedral.verdict.verification import RankedPose, VerificationOptions, verify


def painted(paint, exposure=1.0, seed=1, noise=6.0, step=0.25, seen=("color",)):
    """The room with walls painted in waves of half a metre, whose phases are `paint`'s own.

    Lamps fall off in colour; intensity with the cosine and with the range.
    """
    scan = room_scan(step=step, seed=seed)
    rng = np.random.default_rng(paint)
    waves = rng.normal(size=(6, 3))
    waves *= 2 * np.pi / 0.5 / np.linalg.norm(waves, axis=1, keepdims=True)
    phases = rng.uniform(0, 2 * np.pi, 6)
    shade = np.sin(scan.xyz @ waves.T + phases).sum(axis=1) * 12
    distance = np.linalg.norm(scan.xyz, axis=1)
    lamp = 40 / (1 + distance)
    grain = noise * np.random.default_rng(seed + 7).normal(size=len(scan))
    grey = exposure * (110 + shade + lamp) + grain
    color = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[:, None], 3, axis=1)
    wall = np.argmax(np.abs(scan.xyz) / HALF, axis=1)
    cosine = HALF[wall] / distance
    intensity = (110 + shade + grain) / 255 * cosine / (1 + distance / 10)
    known = {"color": color, "intensity": intensity.astype(np.float32)}
    return prepare(dataclasses.replace(scan, **{kind: known[kind] for kind in seen}))


@pytest.fixture(scope="module")
def room():
    return painted(paint=3)


def test_the_same_room_looks_the_same_whatever_the_exposure(room):
    again = painted(paint=3, exposure=0.7, seed=2)
    assert appearance_similarity(room, again, np.eye(4)) == pytest.approx(1.0, abs=0.2)
    assert appearance_similarity(again, room, np.eye(4)) == pytest.approx(1.0, abs=0.2)


def test_a_room_of_the_same_shape_painted_otherwise_does_not(room):
    assert abs(appearance_similarity(room, painted(paint=4, seed=2), np.eye(4))) < 0.2


def test_a_pose_that_slides_along_the_walls_does_not(room):
    slid = motion(None, np.array([0.25, 0.25, 0.0]))
    assert appearance_similarity(room, painted(paint=3, seed=2), slid) < 0.5


def test_intensity_tells_rooms_apart_too():
    room = painted(paint=3, seen=("intensity",))
    again = painted(paint=3, seed=2, seen=("intensity",))
    assert appearance_similarity(room, again, np.eye(4)) == pytest.approx(1.0, abs=0.2)
    assert abs(appearance_similarity(room, painted(paint=4, seed=2, seen=("intensity",)), np.eye(4))) < 0.2


def test_what_both_scans_have_is_compared(room):
    # A scanner with a camera in one, without in the other: the intensity of both.
    both, other = painted(paint=3, seen=("color", "intensity")), painted(paint=3, seed=2, seen=("intensity",))
    assert appearance_similarity(both, other, np.eye(4)) == pytest.approx(1.0, abs=0.2)
    assert appearance_similarity(other, both, np.eye(4)) == pytest.approx(1.0, abs=0.2)
    assert appearance_similarity(both, painted(paint=3, seed=2), np.eye(4)) == pytest.approx(1.0, abs=0.2)
    assert np.isnan(appearance_similarity(room, other, np.eye(4)))


def test_nothing_is_said_without_colour_or_texture(room):
    plain = prepare(room_scan(step=0.25, seed=2))
    assert np.isnan(appearance_similarity(room, plain, np.eye(4)))
    grey = dataclasses.replace(room_scan(step=0.25, seed=2))
    noise = np.random.default_rng(9).normal(110, 6, len(grey)).clip(0, 255).astype(np.uint8)
    untextured = prepare(dataclasses.replace(grey, color=np.repeat(noise[:, None], 3, axis=1)))
    assert np.isnan(appearance_similarity(room, untextured, np.eye(4)))


def test_a_pose_that_looks_otherwise_gives_way_to_the_next_one(room, monkeypatch):
    again = painted(paint=3, seed=2)
    slid, true = motion(translation=np.array([0.2, 0.2, 0.0])), np.eye(4)
    assert appearance_similarity(room, again, slid) < 0.5
    # Half of the best score makes a rival, and a similarity of 0.5 is asked of all.
    appearance = AppearanceOptions(refused_similarity=0.5, similarity_a_share=0.0)
    options = VerificationOptions(rival_score=0.5, evidence=EvidenceOptions(appearance=appearance))

    def left(ranked, chance=lambda pose: 0.5):
        monkeypatch.setattr(verification, "rank", lambda *_: [RankedPose(*one) for one in ranked])
        monkeypatch.setattr(verification, "gather", lambda a, b, pose, options: pose)
        monkeypatch.setattr(verification, "probabilities", lambda poses: [chance(pose) for pose in poses])
        return [(one.pose, one.score) for one in verify(room, again, [], options)]

    assert [score for _, score in left([(slid, 1.0), (true, 0.3)])] == [0.3]
    # Behind a pose that does look the same only rivals are compared.
    assert [score for _, score in left([(true, 1.0), (slid, 0.9), (slid, 0.3)])] == [1.0, 0.3]
    # None is right: the best one is what to show.
    wrong = [(slid, 1.0), (slid, 0.9)]
    assert left(wrong) == wrong
    # So it is where what is left is a scrap that is still less likely.
    scrap = [(slid, 1.0), (true, 0.01)]
    assert left(scrap, chance=lambda pose: 0.2 if pose is slid else 0.05) == scrap
