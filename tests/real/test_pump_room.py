"""A real scan of a pump room: its colours and its photograph yield features."""

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from trihedral.fusion.rendering import RenderingOptions, rendered_views
from trihedral.initial.visual.features import FeatureOptions, detect, find_features
from trihedral.io.readers import read_headers, read_photos, read_scan


@pytest.fixture(scope="module")
def header(shared):
    return read_headers(shared / "data" / "pump-room" / "pumpAVisualReferenceImage.e57")[0]


@pytest.fixture(scope="module")
def scan(header):
    return read_scan(header)


@pytest.mark.parametrize("paint", ["color", "intensity"])
def test_rendered_views_have_features_on_the_scanned_surface(scan, paint):
    views = rendered_views(scan, RenderingOptions(paint=paint))
    # The scan covers 86 degrees about azimuth -105.
    assert [view.name for view in views] == ["225 deg", "270 deg", "315 deg"]
    found = [find_features(view, FeatureOptions("surf")) for view in views]
    points = np.concatenate([features.points for features in found])
    assert len(points) >= 150
    nearest, _ = cKDTree(scan.xyz).query(points)
    assert np.percentile(nearest, 95) < 0.02


def test_the_photograph_has_features_but_its_file_gives_no_pose_to_lift_them_with(header):
    photo = read_photos(header)[0]
    assert photo.station_from_camera is None and photo.camera.kind == "visual-reference"
    image = cv2.imdecode(np.frombuffer(photo.data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (2304, 3072)
    found = detect(image, None, FeatureOptions("surf", most=20_000))
    assert len(found.pixels) >= 3000
