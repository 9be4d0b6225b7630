"""The README's picture: size, what is drawn where, the same every time."""

import numpy as np
import pytest
from PIL import Image

from trihedral.report import to_document
from trihedral.report.overview import write_overview


@pytest.fixture(scope="module")
def picture(site, tmp_path_factory):
    path = tmp_path_factory.mktemp("picture") / "plan.png"
    write_overview(path, to_document(site.registration, site.inputs), site.samples)
    return path


def test_it_is_wide_and_small_enough_for_a_readme(picture):
    with Image.open(picture) as image:
        assert image.width >= 1.5 * image.height
        assert image.width >= 800
    assert picture.stat().st_size < 300_000


def test_most_walls_run_along_the_sides_whatever_the_frame(site, picture, tmp_path):
    """Turned by 30 degrees, the site looks the same, or turned half way round."""
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(0.5236), -np.sin(0.5236)], [np.sin(0.5236), np.cos(0.5236)]]
    document = to_document(site.registration, site.inputs)
    for station in document["stations"]:
        station["pose"] = (turn @ np.array(station["pose"])).tolist()
    write_overview(tmp_path / "plan.png", document, site.samples)
    for path in (picture, tmp_path / "plan.png"):
        with Image.open(path) as image:
            bright = np.asarray(image.convert("RGB")).max(axis=2) > 140
        # Outer walls: some rows and columns of pixels that are bright for a large part of their length.
        assert bright.mean(axis=1).max() > 0.4
        assert bright.mean(axis=0).max() > 0.2


def test_dense_clouds_still_make_a_small_file(site, tmp_path):
    rng = np.random.default_rng(3)
    noise = {name: rng.uniform(-20, 20, (60_000, 3)).astype(np.float32) for name in site.samples}
    write_overview(tmp_path / "plan.png", to_document(site.registration, site.inputs), noise)
    assert (tmp_path / "plan.png").stat().st_size < 300_000


def test_same_result_same_picture_and_no_samples_is_no_error(site, picture, tmp_path):
    document = to_document(site.registration, site.inputs)
    write_overview(tmp_path / "again.png", document, site.samples)
    assert (tmp_path / "again.png").read_bytes() == picture.read_bytes()
    write_overview(tmp_path / "none.png", document, {})
    assert (tmp_path / "none.png").exists()
