"""Points without a colour, intensities without limits, pictures that name no scan."""

import re
from pathlib import Path

import numpy as np
import pye57
import pytest

from support.e57_files import JPEG
from support.e57_pages import with_xml, xml
from trihedral.export.e57 import e57_scan
from trihedral.io import las, ply, ptx, read_headers, read_photos, read_scan
from trihedral.io.e57 import E57Scan, copy_with_poses, write_e57
from trihedral.io.writers import Content, PlacedScan
from trihedral.scan import CameraModel, Photo
from trihedral.scan.appearance import telling

RNG = np.random.default_rng(2)
POINTS = RNG.uniform(-9, 9, (5000, 3)).astype(np.float32)
COLORS = RNG.integers(1, 256, (5000, 3), dtype=np.uint8)
KNOWN = RNG.random(5000) < 0.4


def test_e57_says_which_points_have_no_colour(tmp_path: Path) -> None:
    """The colours of the others are stored, and not used."""
    path = tmp_path / "a.e57"
    write_e57(path, [E57Scan("a", POINTS, color=COLORS, colored=KNOWN)])
    reader = pye57.E57(str(path))
    invalid = np.zeros(5000)
    buffers = pye57.libe57.VectorSourceDestBuffer()
    buffers.append(
        pye57.libe57.SourceDestBuffer(reader.image_file, "isColorInvalid", invalid, 5000, True, True)
    )
    reader.get_header(0).points.reader(buffers).read()
    np.testing.assert_array_equal(invalid == 0, KNOWN)
    scan = read_scan(read_headers(path)[0])
    np.testing.assert_array_equal(scan.colored, KNOWN)
    np.testing.assert_array_equal(scan.color[KNOWN], COLORS[KNOWN])
    assert not scan.color[~KNOWN].any()
    share = f"{(~KNOWN).sum():,} points ({(~KNOWN).mean():.1%}) have no colour"
    assert any(share in note for note in scan.header.notes)


@pytest.mark.parametrize("kind", ["e57", "ptx", "ply", "laz"])
def test_no_colour_stays_no_colour_in_every_format(tmp_path: Path, kind: str) -> None:
    source, path = tmp_path / "a.e57", tmp_path / f"b.{kind}"
    write_e57(source, [E57Scan("a", POINTS, color=COLORS, colored=KNOWN)])
    scan = read_scan(read_headers(source)[0])
    if kind == "e57":
        write_e57(path, [e57_scan("a", scan, None, [])])
    else:
        write = {"ptx": ptx.write, "ply": ply.write, "laz": las.write}[kind]
        content = Content(len(scan), color=True, intensity=False, scanners=(np.zeros(3),))
        write(path, [PlacedScan("a", scan, np.eye(4))], content)
    back = read_scan(read_headers(path)[0])
    np.testing.assert_array_equal(back.colored, KNOWN)
    np.testing.assert_array_equal(back.color[KNOWN], COLORS[KNOWN])


@pytest.mark.parametrize(
    ("low", "span"), [(0, 40_000), (0, 255), (2**31, 2000), (2**31 - 5_000_000, 10_000_000)]
)
@pytest.mark.parametrize("stated", [True, False])
def test_full_range_intensities_are_scaled_by_what_the_data_hold(
    tmp_path: Path, low: int, span: int, stated: bool
) -> None:
    """32-bit integers, with limits of all that they could be: the float's bytes under another description."""
    true = RNG.uniform(0, 1, 5000)
    raw = (low + np.round(true * span)).astype(np.uint32)
    write_e57(tmp_path / "a.e57", [E57Scan("a", POINTS, intensity=raw.view(np.float32))])
    text = xml(tmp_path / "a.e57").replace(
        '<intensity type="Float" precision="single" minimum="0" maximum="1">0</intensity>',
        '<intensity type="Integer" minimum="0" maximum="4294967295"/>',
    )
    limits = (
        '<intensityLimits type="Structure"><intensityMinimum type="Integer">0</intensityMinimum>'
        '<intensityMaximum type="Integer">4294967295</intensityMaximum></intensityLimits>'
    )
    text = re.sub("<intensityLimits.*</intensityLimits>", limits if stated else "", text, flags=re.DOTALL)
    scan = telling(read_scan(read_headers(with_xml(tmp_path / "a.e57", text, tmp_path / "b.e57"))[0]))
    assert scan.intensity is not None
    assert np.corrcoef(scan.intensity, true)[0, 1] > 0.999
    # Spread over the whole range.
    assert np.percentile(scan.intensity, 99) - np.percentile(scan.intensity, 1) > 0.5


def pose(x: float) -> np.ndarray:
    made = np.eye(4)
    made[:3, 3] = [x, 2.0, 0.5]
    return made


def two_scans(path: Path, apart: float, offset: float = 0.0) -> Path:
    """Two scans with a panorama each; what names the scan is taken out of the file."""
    camera = CameraModel("spherical", 64, 32, pixel_angle=(2 * np.pi / 64, np.pi / 32))
    station = np.eye(4)
    station[2, 3] = offset
    scans = [
        E57Scan(
            f"s{k}", POINTS, pose=pose(apart * k), photos=[Photo(f"pano {k}", "jpeg", JPEG, camera, station)]
        )
        for k in range(2)
    ]
    whole = path.with_suffix(".whole")
    write_e57(whole, scans)
    text, count = re.subn("<associatedData3DGuid.*?</associatedData3DGuid>", "", xml(whole), flags=re.DOTALL)
    assert count == 2
    return with_xml(whole, text, path)


def test_pictures_that_name_no_scan_belong_to_the_one_they_were_taken_at(tmp_path: Path) -> None:
    path = two_scans(tmp_path / "a.e57", apart=3.0, offset=0.2)
    for k, header in enumerate(read_headers(path)):
        assert header.photos == 1 and any("names no scan: taken for this one" in n for n in header.notes)
        [photo] = read_photos(header)
        assert photo.name == f"pano {k}"
        np.testing.assert_allclose(photo.station_from_camera[:3, 3], [0.0, 0.0, 0.2], atol=1e-9)
    # They move with their scans.
    copy_with_poses(path, tmp_path / "b.e57", {1: pose(50.0)})
    [photo] = read_photos(read_headers(tmp_path / "b.e57")[1])
    np.testing.assert_allclose(photo.station_from_camera[:3, 3], [0.0, 0.0, 0.2], atol=1e-9)


@pytest.mark.parametrize(("apart", "offset"), [(0.0, 0.0), (3.0, 2.0)])
def test_pictures_of_no_scan_or_of_either_are_said(tmp_path: Path, apart: float, offset: float) -> None:
    for header in read_headers(two_scans(tmp_path / "a.e57", apart, offset)):
        assert header.photos == 0
        assert any("2 pictures name no scan" in note and "not used" in note for note in header.notes)
