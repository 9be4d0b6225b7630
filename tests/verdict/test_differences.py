"""Rooms that are copies but for a poster: what differs is found where it is, and light and cameras are not."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.room import HALF, room_scan
from trihedral.geometry.se3 import motion
from trihedral.scan.preparation import prepare
from trihedral.verdict.differences import differences

HERE = np.eye(4)
# On the wall at y = HALF[1]: lowest and highest corner (x, z) of a poster.
POSTER = np.array([[0.5, -0.3], [1.3, 0.5]])
RED, GREY = np.array([0.75, 0.2, 0.15]), np.array([0.35, 0.35, 0.35])


def room(poster=None, seed=1, gains=(1.0, 1.0, 1.0), lamp=0.0, turned=HERE):
    """A room of patterned paint, lit from `lamp` metres along x, by a camera of such gains, in a turned frame."""
    scan = room_scan(step=0.25, seed=seed)
    grain = np.random.default_rng(seed + 7).normal(0, 0.01, (len(scan), 3))
    waves = 0.05 * np.sin(9 * scan.xyz[:, 0]) * np.cos(7 * scan.xyz[:, 2])
    color = np.repeat((0.6 + waves)[:, None], 3, axis=1)
    if poster is not None:
        on_wall = scan.xyz[:, 1] > HALF[1] - 0.05
        place = scan.xyz[:, [0, 2]]
        color[on_wall & ((place > POSTER[0]) & (place < POSTER[1])).all(axis=1)] = poster
    distance = np.linalg.norm(scan.xyz - [lamp, 0.0, 0.0], axis=1)
    lit = color / (1 + 0.1 * distance)[:, None] * gains + grain
    xyz = (scan.xyz @ turned[:3, :3].T).astype(np.float32)
    return prepare(dataclasses.replace(scan, xyz=xyz, color=(255 * lit.clip(0, 1)).astype(np.uint8)))


@pytest.fixture(scope="module")
def plain():
    return room()


@pytest.mark.parametrize("poster", [RED, GREY], ids=["red", "grey"])
def test_a_poster_that_one_of_two_rooms_lacks_is_found_where_it_hangs(plain, poster):
    with_poster = room(poster, seed=2)
    for one, two in ((plain, with_poster), (with_poster, plain)):
        found = differences(one, two, HERE)
        # 0.64 m2 of cells of 0.0625 m2, those on its border in part.
        assert 5 <= len(found.places) <= 25
        assert np.abs(found.places[:, 1] - HALF[1]).max() < 0.02
        middle = found.places[:, [0, 2]].mean(axis=0)
        assert np.abs(middle - POSTER.mean(axis=0)).max() < 0.15
        # 133 m2 of wall, floor and ceiling, in the middle of which the scanner looks too steeply to see much.
        assert found.compared > 500


def test_places_are_told_in_the_frame_of_the_first_scan(plain):
    b_from_a = motion(Rotation.from_euler("z", 40, degrees=True).as_matrix(), None)
    found = differences(room(RED), room(turned=b_from_a), b_from_a)
    assert np.abs(found.places[:, 1] - HALF[1]).max() < 0.02


@pytest.mark.parametrize(
    "camera", [{}, {"gains": (0.6, 0.6, 0.6)}, {"gains": (1.0, 0.85, 0.7)}, {"lamp": 2.0}],
    ids=["same", "darker", "warmer", "another lamp"],
)  # fmt: skip
@pytest.mark.parametrize("poster", [None, RED])
def test_one_room_differs_nowhere_whatever_camera_and_light(poster, camera):
    found = differences(room(poster), room(poster, seed=2, **camera), HERE)
    assert found.compared > 500
    assert len(found.places) <= 1


def test_nothing_is_said_without_colour(plain):
    bare = prepare(room_scan(step=0.25, seed=2))
    assert differences(plain, bare, HERE) is None
