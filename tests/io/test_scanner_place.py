"""Files in project coordinates: the scanner is placed where the points were seen from, or asked for."""

from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest

from support.stations import in_project, one_a_cell, scanner_of, stations
from trihedral.errors import InputError
from trihedral.io import ReadOptions, read_headers, read_scan
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.scan.place import hidden_from

SHIFT = (712_345.678, 5_312_987.654, 431.5)


def las(path: Path, points: np.ndarray) -> Path:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [1e-3] * 3, points.mean(axis=0).round()
    content = laspy.LasData(header)
    content.x, content.y, content.z = points.T
    content.write(path)
    return path


def read(path: Path, options: ReadOptions | None = None):
    options = options or ReadOptions()
    return read_scan(read_headers(path, options)[0], options)


def test_las_far_from_zero_says_where_its_scanner_stood(tmp_path):
    scan = stations("office", 7)[0]
    found = read(las(tmp_path / "a.las", in_project(scan, SHIFT)))
    assert np.abs(found.header.scanner_origin - scanner_of(scan, SHIFT)).max() < 0.002
    assert found.header.origin_sigma is not None and max(found.header.origin_sigma) < 0.005
    assert any("found from the points" in note and "sigma" in note for note in found.header.notes)
    assert not any("(0, 0, 0) assumed" in note for note in found.header.notes)


@pytest.mark.parametrize("shift", [(0, 0, 0), SHIFT])
def test_e57_without_a_pose_is_treated_alike(tmp_path, shift):
    scan = stations("office", 7)[1]
    write_e57(tmp_path / "a.e57", [E57Scan("a", in_project(scan, shift))])
    found = read(tmp_path / "a.e57")
    assert np.abs(found.header.scanner_origin - scanner_of(scan, shift)).max() < 0.002


def test_a_scanner_that_is_at_zero_stays_there_to_the_bit(tmp_path):
    scan = stations("office", 7)[0]
    found = read(las(tmp_path / "a.las", scan.xyz.astype(np.float64)))
    assert (found.header.scanner_origin == 0).all()
    write_e57(tmp_path / "a.e57", [E57Scan("a", scan.xyz, row=scan.row, column=scan.column)])
    assert read(tmp_path / "a.e57").header.origin_sigma is None


def test_what_points_do_not_tell_is_asked_for(tmp_path):
    scan = stations("office", 7)[0]
    cells = one_a_cell(in_project(scan, SHIFT), 0.05)
    path = las(tmp_path / "a.las", (np.floor(cells / 0.05) + 0.5) * 0.05)
    with pytest.raises(InputError, match=r"pattern of their directions were tried.*--scanner-origin.*table"):
        read(path)
    place = tuple(scanner_of(scan, SHIFT))
    assert read(path, ReadOptions(scanner_origins=(("a", place),))).header.scanner_origin.tolist() == list(
        place
    )


@pytest.mark.parametrize("scene", ["facade", "warehouse"])
def test_merged_stations_are_no_scan(tmp_path, scene):
    points = np.concatenate([in_project(scan, SHIFT) for scan in stations(scene, 7)])
    with pytest.raises(InputError, match=r"no single scan but several|do not tell where it stood"):
        read(las(tmp_path / "a.las", points))


def test_merged_and_thinned_stations_are_no_scan_from_the_first_of_them(tmp_path):
    scans = stations("office", 11, 150_000, count=3)
    back = np.linalg.inv(scans[0].project_from_station)
    points = np.concatenate([in_project(scan) for scan in scans]) @ back[:3, :3].T + back[:3, 3]
    with pytest.raises(InputError, match=r"behind|several in one"):
        read(las(tmp_path / "a.las", one_a_cell(points, 0.03)))


@pytest.mark.parametrize(("scene", "count"), [("facade", 3), ("building", 4)])
def test_merged_stations_in_the_frame_of_the_first_are_no_scan(tmp_path, scene, count):
    scans = stations(scene, 21, 150_000, count=count)
    back = np.linalg.inv(scans[0].project_from_station)
    points = np.concatenate([in_project(scan) for scan in scans]) @ back[:3, :3].T + back[:3, 3]
    with pytest.raises(InputError, match=r"behind|several in one"):
        read(las(tmp_path / "a.las", one_a_cell(points, 0.03)))


@pytest.mark.parametrize(("seed", "station"), [(1, 1), (3, 2)])
def test_what_is_seen_through_a_glass_wall_is_of_one_scan_where_thinning_makes_the_wall_dense(
    tmp_path, seed, station
):
    scan = stations("office", seed, 300_000, count=4)[station]
    points = one_a_cell(scan.xyz.astype(np.float64), 0.05)
    assert hidden_from(points, np.zeros(3), np.random.default_rng(0)).share > 0.05
    write_e57(tmp_path / "a.e57", [E57Scan("a", points)])
    assert np.abs(read(tmp_path / "a.e57").header.scanner_origin).max() < 0.01


def test_a_wrong_position_of_the_user_is_contradicted(tmp_path):
    scan = stations("office", 7)[0]
    path = las(tmp_path / "a.las", scan.xyz.astype(np.float64))
    with pytest.raises(InputError, match="lie behind surfaces of the same scan"):
        read(path, ReadOptions(scanner_origin=(6.0, -4.0, 0.5)))


def test_a_table_is_of_single_scans():
    options = ReadOptions(
        scanner_origin=(9, 9, 9),
        scanner_origins=(("a.las", (1, 2, 3)), ("b", (4, 5, 6)), ("c.pts/2", (7, 8, 9))),
    )
    assert options.origin_of(Path("x/a.las"), 0) == (1, 2, 3)
    assert options.origin_of(Path("b.xyz"), 0) == (4, 5, 6)
    assert options.origin_of(Path("c.pts"), 1) == (7, 8, 9)
    assert options.origin_of(Path("c.pts"), 0) == (9, 9, 9)


def test_real_scans_are_single_ones(shared):
    """Tripod scans thinned to centimetres, tilting and spinning scanners, a scan with a grid."""
    data = shared / "data"
    files = [*(data / "eth-facade").glob("*.pcd"), *(data / "lpm-tutorial").glob("*.pcd")]
    files += [*(data / "norlab").glob("*.pcd"), *(data / "pcl-room").glob("*.pcd")]
    files += [data / "rooms-tilting-sick/A601.pcd", data / "pump-room/pumpAVisualReferenceImage.e57"]
    for file in sorted(files):
        scan = read(file)
        assert np.abs(scan.header.scanner_origin).max() == 0, file
    with pytest.raises(InputError, match="several scans in one, was taken by a moving scanner, or"):
        read(data / "formats/las/indoor.laz")


def test_found_place_survives_being_prepared(tmp_path):
    from trihedral.scan.preparation import prepare
    from trihedral.scan.prepared import Prepared

    scan = stations("office", 7)[0]
    path = las(tmp_path / "a.las", in_project(scan, SHIFT))
    made = prepare(read(path))
    made.save(tmp_path / "made.npz")
    header = Prepared.load(tmp_path / "made.npz").placed(replace(read_headers(path)[0]))
    assert np.abs(header.scanner_origin - scanner_of(scan, SHIFT)).max() < 0.002
    assert any("found from the points" in note for note in header.notes)
