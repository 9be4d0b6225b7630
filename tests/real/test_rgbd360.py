"""Two stations of a real eight-camera RGB-D rig, tied by their pictures alone."""

import json

import cv2
import numpy as np
import pytest

from trihedral.geometry.se3 import distance, inverse, rotation_angle
from trihedral.initial.visual.alignment import VisualOptions, visual_alignment
from trihedral.initial.visual.features import FeatureOptions, find_features
from trihedral.scan.view import View

# Inverse ranges of a plane change linearly from pixel to pixel; a jump bends them by more than this share.
BEND = 0.03


def views(folder):
    found = []
    for camera in json.loads((folder / "cameras.json").read_text())["cameras"]:
        image = cv2.cvtColor(cv2.imread(str(folder / camera["image"])), cv2.COLOR_BGR2RGB)
        depth = cv2.imread(str(folder / camera["depth"]), cv2.IMREAD_UNCHANGED) / 1000.0
        depth[depth == 0] = np.nan
        y, x = np.mgrid[: camera["height"], : camera["width"]]
        rays = np.stack(
            [(x - camera["cx"]) / camera["fx"], (y - camera["cy"]) / camera["fy"], np.ones_like(depth)],
            axis=2,
        )
        pose = np.array(camera["station_from_camera"])
        points = (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
        edge = np.zeros(depth.shape, dtype=bool)
        bend = np.abs(np.diff(1 / depth, 2, axis=1)) * depth[:, 1:-1]
        edge[:, 1:-1] |= bend > BEND
        edge[1:-1] |= np.abs(np.diff(1 / depth, 2, axis=0)) * depth[1:-1] > BEND
        found.append(View(camera["image"], image, points.astype(np.float32), edge))
    return found


@pytest.fixture(scope="module")
def stations(shared):
    folder = shared / "data" / "rgbd360"
    return [views(folder / name) for name in ("station1", "station2")]


@pytest.mark.parametrize("kind", ["surf", "sift"])
@pytest.mark.parametrize("gate", ["planar-motion", "none"])
def test_the_stations_are_tied_both_ways_round(stations, kind, gate):
    a, b = ([find_features(view, FeatureOptions(kind)) for view in station] for station in stations)
    there = visual_alignment(a, b, VisualOptions(gate=gate))
    back = visual_alignment(b, a, VisualOptions(gate=gate))
    assert there.pose is not None and back.pose is not None, (there.reason, back.reason)
    metres, radians = distance(there.pose, inverse(back.pose))
    assert metres < 0.01 and np.degrees(radians) < 0.1

    # An independent estimate: about 0.30 m and 0.75 degrees. Depths of this kind of camera are good to a few cm here.
    assert np.linalg.norm(there.pose[:3, 3]) == pytest.approx(0.30, abs=0.06)
    assert np.degrees(rotation_angle(there.pose)) == pytest.approx(0.75, abs=0.5)

    assert there.gate == gate and len(there.pairs) == 3
    assert there.agreeing >= 80 and there.rmse < 0.08
    # The rig hardly turned: a right pair of pictures is of the same camera.
    assert all(pair.view_a == pair.view_b for pair in there.pairs)
