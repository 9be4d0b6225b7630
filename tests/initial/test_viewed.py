"""Poses from views: a textured room from two places, at any tilt, in colour or intensity or neither."""

import sys
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from trihedral import pipeline
from trihedral.errors import OptionError
from trihedral.fusion.camera import pixel_rays
from trihedral.fusion.surroundings import surroundings
from trihedral.geometry.motion import distance, inverse, transform
from trihedral.initial.described import described
from trihedral.initial.hypotheses import HypothesisOptions, hypotheses
from trihedral.scan import CameraModel, Photo
from trihedral.scan.preparation import prepare
from trihedral.scan.prepared import Prepared

sys.path.append(str(Path(__file__).resolve().parent))
from textured_room import SIZE, looked_at, scan_room

VIEWS = HypothesisOptions(sources=("views",))


def seen_from(*args, **kwargs):
    scan, pose = scan_room(*args, **kwargs)
    return described(prepare(scan), scan, VIEWS), pose


@pytest.fixture(scope="module")
def level():
    return seen_from((0.8, -0.4, 0.1), (25, 0, 0), seed=1)


@pytest.mark.parametrize("tilt", [(0, 0), (20, -15), (120, 40)])
def test_the_pose_is_proposed_first_whatever_the_tilt(level, tilt):
    a, a_pose = level
    b, b_pose = seen_from((-0.6, 0.3, 0.0), (-70, *tilt), seed=2)
    best = hypotheses(a, b, VIEWS)[0]
    off, turned = distance(best.pose, inverse(b_pose) @ a_pose)
    assert best.source == "views"
    assert off < 0.05 and np.degrees(turned) < 1.0


def test_intensity_serves_where_there_is_no_colour():
    a, a_pose = seen_from((0.8, -0.4, 0.1), (25, 0, 0), seed=1, look="intensity")
    b, b_pose = seen_from((-0.2, 0.3, 0.0), (-70, 10, 0), seed=2, look="intensity")
    assert distance(hypotheses(a, b, VIEWS)[0].pose, inverse(b_pose) @ a_pose)[0] < 0.05


def test_without_looks_there_are_no_keypoints_and_no_poses(level):
    bare, _ = seen_from((-0.6, 0.3, 0.0), (-70, 0, 0), look=None)
    assert len(bare.view_points) == 0
    assert hypotheses(level[0], bare, VIEWS) == []


def test_rooms_with_other_textures_agree_on_little(level):
    same, _ = seen_from((-0.6, 0.3, 0.0), (-70, 0, 0), seed=2)
    other, _ = seen_from((-0.6, 0.3, 0.0), (-70, 0, 0), seed=2, texture_seed=1)
    best = max((h.score for h in hypotheses(level[0], other, VIEWS)), default=0.0)
    assert best < 0.2 * hypotheses(level[0], same, VIEWS)[0].score


def test_keypoints_lie_on_the_walls(level):
    prepared, pose = level
    assert len(prepared.view_points) > 500
    off = np.abs(np.abs(transform(pose, prepared.view_points)) - SIZE / 2).min(axis=1)
    assert np.percentile(off, 95) < 0.02


def test_every_direction_is_found_again_in_the_picture_of_the_surroundings():
    scan, _ = scan_room((0.8, -0.4, 0.1), (25, 10, 0))
    seen = surroundings(scan)
    ranges = np.linalg.norm(scan.xyz, axis=1)
    column, row = seen.places(scan.xyz[::97])
    drawn = seen.range[np.rint(row).astype(int), np.rint(column).astype(int)]
    assert np.percentile(np.abs(drawn / ranges[::97] - 1), 95) < 0.03


def test_what_was_described_is_stored_and_read_again(level, tmp_path):
    level[0].save(tmp_path / "a.npz")
    again = Prepared.load(tmp_path / "a.npz")
    for field in fields(Prepared):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(level[0], field.name))


def test_unknown_sources_are_refused():
    with pytest.raises(OptionError, match="sources"):
        HypothesisOptions(sources=("views", "stars"))


def photographed(position, rotation, seed, damaged=False):
    """A scan without looks and a panorama taken from the scanner, as a job prepares them."""
    scan, pose = scan_room(position, rotation, seed=seed, look=None)
    angle = np.radians(0.25)
    camera = CameraModel("spherical", 1440, 720, pixel_angle=(angle, angle))
    # Camera axes x right, y down, z along the view, which is the scanner's x.
    station_from_camera = np.eye(4)
    station_from_camera[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    directions = pixel_rays(camera) @ (pose[:3, :3] @ station_from_camera[:3, :3]).T
    _, grey = looked_at(pose[:3, 3], directions)
    image = np.rint(255 * grey).astype(np.uint8).reshape(720, 1440)
    data = b"no picture" if damaged else cv2.imencode(".png", image)[1].tobytes()
    photo = Photo("panorama", "png", data, camera, station_from_camera)
    return replace(scan, header=replace(scan.header, photos=1)), pose, photo


def test_pictures_serve_where_the_points_have_no_colour(monkeypatch):
    made = []
    for seed, place in enumerate((((0.8, -0.4, 0.1), (25, 0, 0)), ((-0.2, 0.3, 0.0), (-70, 10, 0)))):
        scan, pose, photo = photographed(*place, seed)
        monkeypatch.setattr(pipeline, "read_photos", lambda header, photo=photo: [photo])
        made.append((pipeline.prepare_scan(scan, pipeline.Options(hypotheses=VIEWS)), pose))
    (a, a_pose), (b, b_pose) = made
    assert distance(hypotheses(a, b, VIEWS)[0].pose, inverse(b_pose) @ a_pose)[0] < 0.05


def test_a_damaged_picture_does_not_lose_the_scan(monkeypatch):
    scan, _, photo = photographed((0.8, -0.4, 0.1), (25, 0, 0), 1, damaged=True)
    monkeypatch.setattr(pipeline, "read_photos", lambda header: [photo])
    prepared = pipeline.prepare_scan(scan, pipeline.Options(hypotheses=VIEWS))
    assert len(prepared.points) > 1000 and not len(prepared.view_points)
