"""Appearance of rooms that are the same in shape: painted walls of known texture, seen twice."""

import dataclasses

import numpy as np
import pytest

from support.room import HALF, room_scan
from trihedral.geometry.se3 import motion
from trihedral.scan.preparation import prepare
from trihedral.verdict import verification
from trihedral.verdict.appearance import AppearanceOptions, appearance_similarity, enclosed
from trihedral.verdict.evidence import EvidenceOptions
from trihedral.verdict.verification import RankedPose, VerificationOptions, verify

HERE = np.eye(4)
# Of a yard: as wide as the room, with high walls.
YARD = np.array([4.02, 3.03, 4.0])


def kept(scan, which):
    """Some points of a scan."""
    return dataclasses.replace(scan, xyz=scan.xyz[which], row=scan.row[which], column=scan.column[which])


def yard_scan(step=0.25, seed=1):
    """High walls without a ceiling."""
    scan = room_scan(step=step, seed=seed, half=YARD)
    return kept(scan, scan.xyz[:, 2] < YARD[2] - 0.05)


def shade_of(xyz, paint):
    """Waves of half a metre, whose phases are `paint`'s own."""
    rng = np.random.default_rng(paint)
    waves = rng.normal(size=(6, 3))
    waves *= 2 * np.pi / 0.5 / np.linalg.norm(waves, axis=1, keepdims=True)
    return np.sin(xyz @ waves.T + rng.uniform(0, 2 * np.pi, 6)).sum(axis=1) * 12


def painted(paint, exposure=1.0, seed=1, noise=6.0, seen=("color",), shadows=None, yard=False):
    """The room or the yard with painted walls; `shadows` are what colour shows instead, if given.

    Lamps fall off in colour; intensity with the cosine and with the range.
    """
    scan = (yard_scan if yard else room_scan)(step=0.25, seed=seed)
    half = YARD if yard else HALF
    distance = np.linalg.norm(scan.xyz, axis=1)
    lamp = 40 / (1 + distance)
    grain = noise * np.random.default_rng(seed + 7).normal(size=len(scan))
    shade = shade_of(scan.xyz, paint)
    lit = shade if shadows is None else shade_of(scan.xyz, shadows)
    grey = exposure * (110 + lit + lamp) + grain
    color = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[:, None], 3, axis=1)
    cosine = half[np.argmax(np.abs(scan.xyz) / half, axis=1)] / distance
    intensity = (110 + shade + grain) / 255 * cosine / (1 + distance / 10)
    known = {"color": color, "intensity": intensity.astype(np.float32)}
    return prepare(dataclasses.replace(scan, **{kind: known[kind] for kind in seen}))


def similarity(a, b, pose=HERE):
    """What is told of a pose of which something is told."""
    found = appearance_similarity(a, b, pose)
    assert found is not None
    return found.value


@pytest.fixture(scope="module")
def room():
    return painted(paint=3)


def test_the_same_room_looks_the_same_whatever_the_exposure(room):
    again = painted(paint=3, exposure=0.7, seed=2)
    assert similarity(room, again) == pytest.approx(1.0, abs=0.2)
    assert similarity(again, room) == pytest.approx(1.0, abs=0.2)


def test_a_room_of_the_same_shape_painted_otherwise_does_not(room):
    assert abs(similarity(room, painted(paint=4, seed=2))) < 0.2


def test_a_pose_that_slides_along_the_walls_does_not(room):
    slid = motion(None, np.array([0.25, 0.25, 0.0]))
    assert similarity(room, painted(paint=3, seed=2), slid) < 0.5


def test_intensity_tells_rooms_apart_too():
    room = painted(paint=3, seen=("intensity",))
    again = painted(paint=3, seed=2, seen=("intensity",))
    assert similarity(room, again) == pytest.approx(1.0, abs=0.2)
    assert abs(similarity(room, painted(paint=4, seed=2, seen=("intensity",)))) < 0.2


def test_what_both_scans_have_is_compared(room):
    # A scanner with a camera in one, without in the other: the intensity of both.
    both = painted(paint=3, shadows=5, seen=("color", "intensity"))
    other = painted(paint=3, seed=2, seen=("intensity",))
    for one, two, pose_of in ((both, other, "intensity"), (other, both, "intensity"), (both, both, "color")):
        found = appearance_similarity(one, two, HERE)
        assert found.of == pose_of
        assert found.value == pytest.approx(1.0, abs=0.2) or one is two
    # Colour tells more: where both have it, it is compared, and here it shows another paint.
    assert abs(similarity(both, painted(paint=3, seed=2, seen=("color", "intensity")))) < 0.2
    assert appearance_similarity(room, other, HERE) is None


def test_outdoors_shadows_move_and_intensity_is_compared_alone():
    morning = painted(paint=3, shadows=5, seen=("color", "intensity"), yard=True)
    evening = painted(paint=3, shadows=6, seed=2, seen=("color", "intensity"), yard=True)
    found = appearance_similarity(morning, evening, HERE)
    assert found.of == "intensity"
    assert found.value == pytest.approx(1.0, abs=0.2)
    assert abs(similarity(morning, painted(paint=4, seed=2, seen=("intensity",), yard=True))) < 0.2
    # Colour alone says nothing, not even where it is the same.
    assert appearance_similarity(*(painted(paint=3, seed=seed, yard=True) for seed in (1, 2)), HERE) is None


def reaching(degrees, half):
    """The walls of a room, seen by beams up to an elevation; what they show of a ceiling is left out."""
    scan = room_scan(step=0.5, half=np.array(half))
    up = scan.xyz[:, 2]
    elevation = np.degrees(np.arcsin(up / np.linalg.norm(scan.xyz, axis=1)))
    return prepare(kept(scan, (elevation < degrees) & (up < half[2] - 0.05)))


def test_a_scan_whose_beams_do_not_reach_up_may_be_enclosed(room):
    flat = reaching(15.0, (15.0, 12.0, 9.0))  # no higher than 5.2 m
    high = reaching(15.0, (30.0, 25.0, 20.0))  # up to 10 m, where a ceiling would be seen
    steep = reaching(45.0, (5.0, 4.0, 4.5))  # as low, but a ceiling would be seen above
    assert enclosed(flat, flat) and enclosed(flat, room) and enclosed(room, room)
    for outdoors in (high, steep):
        assert not enclosed(outdoors, outdoors)
        assert not enclosed(outdoors, room) and not enclosed(room, outdoors)


def test_nothing_is_said_without_colour_or_texture(room):
    plain = prepare(room_scan(step=0.25, seed=2))
    assert appearance_similarity(room, plain, HERE) is None
    grey = room_scan(step=0.25, seed=2)
    noise = np.random.default_rng(9).normal(110, 6, len(grey)).clip(0, 255).astype(np.uint8)
    untextured = prepare(dataclasses.replace(grey, color=np.repeat(noise[:, None], 3, axis=1)))
    assert appearance_similarity(room, untextured, HERE) is None


def test_a_pose_that_looks_otherwise_gives_way_to_the_next_one(room, monkeypatch):
    again = painted(paint=3, seed=2)
    slid, true = motion(translation=np.array([0.2, 0.2, 0.0])), HERE
    assert similarity(room, again, slid) < 0.5
    # Half of the best score makes a rival, and a similarity of 0.5 is asked of all.
    appearance = AppearanceOptions(refused_similarity=0.5, similarity_a_share=0.0)
    options = VerificationOptions(rival_score=0.5, evidence=EvidenceOptions(appearance=appearance))

    def left(ranked, chance=lambda pose: 0.5, scans=(room, again)):
        monkeypatch.setattr(verification, "rank", lambda *_: [RankedPose(*one) for one in ranked])
        monkeypatch.setattr(verification, "gather", lambda a, b, estimate, options: estimate.transform)
        monkeypatch.setattr(verification, "probabilities", lambda poses: [chance(pose) for pose in poses])
        return [(one.pose, one.score) for one in verify(*scans, [], options)]

    assert [score for _, score in left([(slid, 1.0), (true, 0.3)])] == [0.3]
    # Behind a pose that does look the same only rivals are compared.
    assert [score for _, score in left([(true, 1.0), (slid, 0.9), (slid, 0.3)])] == [1.0, 0.3]
    # None is right: the best one is what to show.
    wrong = [(slid, 1.0), (slid, 0.9)]
    assert left(wrong) == wrong
    # So it is where what is left is a scrap that is still less likely.
    scrap = [(slid, 1.0), (true, 0.01)]
    assert left(scrap, chance=lambda pose: 0.2 if pose is slid else 0.05) == scrap
    # Outdoors it stays: only under a ceiling is it refused.
    yards = [painted(paint=3, seed=seed, seen=("intensity",), yard=True) for seed in (1, 2)]
    assert similarity(*yards, slid) < 0.5
    assert left([(slid, 1.0), (true, 0.3)], scans=yards) == [(slid, 1.0), (true, 0.3)]
