"""Variants of a scan as people's exports have them, against closed forms and through the product's readers."""

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from typer.testing import CliRunner

from trihedral.cli import app
from trihedral.errors import InputError, OptionError
from trihedral.io import ReadOptions, read_headers, read_scan
from trihedral.simulate import ScannerOptions, make_site, parse_variant, write_exports, write_site
from trihedral.simulate.export_formats import FORMATS
from trihedral.simulate.exports import (
    NATIONAL,
    NUMBERED,
    PLAIN,
    FileScan,
    as_measured,
    merged,
    window,
)
from trihedral.simulate.trajectory import trajectory

SMALL = ScannerOptions().with_beams(20_000)


@pytest.fixture(scope="module")
def site():
    return make_site("office", 3, 2, SMALL)


@pytest.fixture(scope="module")
def simulated(site):
    return list(site)


@pytest.fixture
def scans(simulated) -> list[FileScan]:
    return [as_measured(one, (3, k)) for k, one in enumerate(simulated)]


@pytest.fixture
def scan(scans) -> FileScan:
    return scans[0]


def in_project(scan: FileScan) -> np.ndarray:
    pose = scan.project_from_file
    return scan.xyz.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]


def places(scan: FileScan) -> set[tuple[float, ...]]:
    return {tuple(point) for point in scan.xyz.tolist()}


@pytest.mark.parametrize("kind", ["hanging", "lying", "y-up", "project", "national"])
def test_another_frame_has_the_same_points_poses_and_scanner(scan, kind) -> None:
    turned = PLAIN[kind](scan)
    shift = np.array(NATIONAL) if kind == "national" else 0.0
    true = turned.project_from_file
    assert true[:3, :3] @ true[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(true[:3, :3]) == pytest.approx(1.0)
    assert in_project(turned) == pytest.approx(in_project(scan), abs=1e-5)
    assert turned.scanners @ true[:3, :3].T + true[:3, 3] == pytest.approx(
        scan.project_from_file[None, :3, 3]
    )
    own = np.linalg.norm(turned.xyz - turned.scanners[0], axis=1)
    assert own == pytest.approx(np.linalg.norm(scan.xyz.astype(float), axis=1), abs=1e-5)
    if kind in ("project", "national"):
        assert turned.scanners[0] == pytest.approx(scan.project_from_file[:3, 3] + shift)
    # Where the floor is, which is below every scanner.
    down = true[:3, :3].T @ [0.0, 0.0, -1.0]
    expected = {"hanging": [0, 0, 1], "y-up": [0, -1, 0], "project": [0, 0, -1], "national": [0, 0, -1]}
    if kind in expected:
        assert down == pytest.approx(expected[kind], abs=0.002)
    else:
        assert abs(down[2]) < 0.002


def test_thinning_keeps_one_measured_point_of_each_cube(scan) -> None:
    thin = PLAIN["nogrid"](NUMBERED["thinned"][0](scan, 0.05))
    cubes = np.floor(thin.xyz.astype(np.float64) / 0.05).astype(int)
    every = np.floor(scan.xyz.astype(np.float64) / 0.05).astype(int)
    assert len(np.unique(cubes, axis=0)) == len(cubes) == len(np.unique(every, axis=0))
    assert places(thin) <= places(scan)
    assert thin.grid is None and thin.row is None


def test_a_random_share_is_of_that_size_and_another_at_each_station(scans) -> None:
    some = [NUMBERED["random"][0](scan, 0.2) for scan in scans]
    for part, scan in zip(some, scans, strict=True):
        n = len(scan)
        assert abs(len(part) - 0.2 * n) < 4.0 * np.sqrt(n * 0.2 * 0.8)
        assert places(part) <= places(scan)
    assert len(some[0]) != len(some[1])


@pytest.mark.parametrize("degrees", [60.0, 180.0, 360.0])
def test_a_window_is_as_wide_as_it_says_and_looks_the_same_way_from_each_station(scans, degrees) -> None:
    headings = []
    for scan in scans:
        seen = window(scan, degrees)
        rays = seen.xyz.astype(np.float64) @ scan.project_from_file[:3, :3].T
        turn = np.arctan2(rays[:, 1], rays[:, 0])
        spread = np.sort(np.degrees(turn) % 360.0)
        widest_gap = np.diff(np.append(spread, spread[0] + 360.0)).max()
        assert widest_gap == pytest.approx(360.0 - degrees, abs=4.0)
        headings.append(np.angle(np.exp(1j * turn).sum()))
        assert places(scan.of(seen.keeps(in_project(scan)))) == places(seen)
    if degrees < 360.0:
        assert np.degrees(np.abs(np.angle(np.exp(1j * (headings[0] - headings[1]))))) < 90.0


def test_cuts_leave_what_is_near_and_what_is_clear_of_floor_and_ceiling(scan) -> None:
    near = NUMBERED["cut"][0](scan, 4.0)
    lengths = np.linalg.norm(scan.xyz.astype(np.float64), axis=1)
    assert len(near) == (lengths <= 4.0).sum()
    height = in_project(scan)[:, 2]
    low = scan.xyz[:, 2] < -0.8 * lengths
    high = scan.xyz[:, 2] > 0.8 * lengths
    floor, ceiling = np.median(height[low]), np.median(height[high])
    assert in_project(PLAIN["nofloor"](scan))[:, 2].min() > floor + 0.1
    assert in_project(PLAIN["noceiling"](scan))[:, 2].max() < ceiling - 0.1
    # Also of a scan that hangs, where the floor is up.
    upside_down = PLAIN["nofloor"](PLAIN["hanging"](scan))
    assert in_project(upside_down) == pytest.approx(in_project(PLAIN["nofloor"](scan)), abs=1e-5)


def test_colours_and_intensities_that_tell_nothing(scan) -> None:
    assert PLAIN["bare"](scan).color is None and PLAIN["bare"](scan).intensity is None
    assert PLAIN["colorless"](scan).intensity is not None
    assert not PLAIN["black"](scan).color.any()
    assert np.ptp(PLAIN["flat"](scan).intensity) == 0.0
    by_height = PLAIN["false-colors"](scan)
    order = np.argsort(in_project(scan)[:, 2])
    assert (np.diff(by_height.color[order, 0].astype(int)) >= 0).all()
    band = PLAIN["color-band"](scan)
    elevation = np.degrees(np.arcsin(scan.xyz[:, 2] / np.linalg.norm(scan.xyz, axis=1)))
    assert not band.color[elevation > 25.0].any()
    level = np.abs(elevation) < 10.0
    assert np.array_equal(band.color[level], scan.color[level])


def test_a_body_moves_with_the_scanner_and_has_its_share(scans) -> None:
    bodies = []
    for scan in scans:
        carried = NUMBERED["body"][0](scan, 0.18)
        near = np.linalg.norm(carried.xyz, axis=1) < 0.39
        assert near.mean() == pytest.approx(0.18, abs=0.001)
        bodies.append(carried.xyz[near][:1000])
    assert np.linalg.norm(bodies[0].mean(axis=0) - bodies[1].mean(axis=0)) < 0.02


def test_merged_scans_lie_in_the_frame_of_the_first(scans) -> None:
    both = merged(scans)
    assert len(both) == sum(map(len, scans))
    assert in_project(both) == pytest.approx(np.concatenate([in_project(one) for one in scans]), abs=1e-5)
    assert both.scanners[0] == pytest.approx(np.zeros(3), abs=1e-12)
    apart = scans[1].project_from_file[:3, 3] - scans[0].project_from_file[:3, 3]
    assert both.scanners[1] == pytest.approx(scans[0].project_from_file[:3, :3].T @ apart)


def test_a_moving_scanner_sees_its_surfaces_from_many_places(site) -> None:
    exact = ScannerOptions(range_noise_m=0.0, signal_noise_m=0.0, angular_noise_arcsec=0.0).with_beams(20_000)
    way = trajectory(make_site("office", 3, 2, exact), 0, 2.0)
    steps = np.linalg.norm(np.diff(way.scanners, axis=0), axis=1)
    assert len(way.scanners) >= 3 and np.ptp(steps) < 0.005
    assert steps.sum() <= 2.0 + 0.01
    assert 0.5 * 20_000 < len(way) < 1.2 * 20_000
    # No regular directions from any one place: azimuths from the first do not repeat as those of one scan do.
    one = as_measured(make_site("office", 3, 2, exact).scan(0), (3, 0))
    distinct = [
        len(np.unique(np.round(np.degrees(np.arctan2(s.xyz[:, 1], s.xyz[:, 0])), 2))) / len(s)
        for s in (way, one)
    ]
    assert distinct[0] > 5 * distinct[1]


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_reads_as_what_was_written(scan, kind, tmp_path: Path) -> None:
    path = tmp_path / f"one.{kind}"
    scan = PLAIN["nogrid"](scan)
    FORMATS[kind](path, scan)
    header = read_headers(path)[0]
    read = read_scan(header)
    assert header.format == kind and (header.grid is None or kind == "ptx")
    assert len(read) == len(scan)
    assert read.xyz + read.local_origin == pytest.approx(scan.xyz, abs=1.1e-4)
    assert np.array_equal(read.color, scan.color)
    assert np.corrcoef(read.intensity, scan.intensity)[0, 1] > 0.999
    if kind in ("las", "laz"):
        assert laspy.open(path).header.point_count == len(scan)


@pytest.mark.parametrize("kind", ["e57", "las", "laz", "ply", "pts", "ptx", "xyz"])
def test_large_coordinates_keep_their_last_millimetre(scan, kind, tmp_path: Path) -> None:
    path = tmp_path / f"one.{kind}"
    far = PLAIN["national"](PLAIN["bare"](scan))
    FORMATS[kind](path, PLAIN["nogrid"](far))
    options = ReadOptions(scanner_origin=tuple(far.scanners[0]))
    read = read_scan(read_headers(path, options)[0], options)
    assert read.xyz + read.local_origin == pytest.approx(far.xyz, abs=3e-4)


@pytest.mark.parametrize("kind", ["e57", "ptx"])
def test_a_grid_that_is_kept_is_the_scanners(scan, kind, tmp_path: Path) -> None:
    path = tmp_path / f"one.{kind}"
    FORMATS[kind](path, window(scan, 200.0))
    read = read_scan(read_headers(path)[0])
    kept = window(scan, 200.0)
    order = np.lexsort((read.row, read.column))
    assert np.array_equal(read.row[order], kept.row)
    assert read.xyz[order] == pytest.approx(kept.xyz, abs=1e-4)


def test_folders_have_their_own_truth_and_the_scans_as_measured_stay_the_same(site, tmp_path: Path) -> None:
    texts = ["nogrid", "window=120,lying,laz", "merged,xyz", "project,pcd"]
    list(write_site(site, tmp_path / "plain"))
    list(write_exports(site, tmp_path / "both", [parse_variant(text) for text in texts]))
    for path in (tmp_path / "plain").glob("*.*"):
        assert path.read_bytes() == (tmp_path / "both" / path.name).read_bytes()
    whole = json.loads((tmp_path / "plain" / "truth.json").read_text())
    for text, folder in zip(
        texts, ["nogrid", "window-120_lying_laz", "merged_xyz", "project_pcd"], strict=True
    ):
        truth = json.loads((tmp_path / "both" / folder / "truth.json").read_text())
        assert truth["export"] == text
        for entry in truth["stations"]:
            [header] = read_headers(tmp_path / "both" / folder / entry["file"])
            if text.startswith("merged"):
                with pytest.raises(InputError, match="several"):
                    read_scan(header)
                points = np.loadtxt(header.source, usecols=(0, 1, 2), comments=("#", "//"))
            else:
                read = read_scan(header)
                points = read.xyz + read.local_origin
            assert len(points) == entry["points"]
            pose = np.array(entry["project_from_station"])
            turned = points @ pose[:3, :3].T + pose[:3, 3]
            scanner = np.array(entry["scanners"]) @ pose[:3, :3].T + pose[:3, 3]
            stations = [
                s for s in whole["stations"] if text.startswith("merged") or s["name"] == entry["name"]
            ]
            true = np.array([np.array(s["project_from_station"])[:3, 3] for s in stations])
            assert scanner == pytest.approx(true, abs=1e-9)
            # Everything is inside the building.
            assert np.abs(turned).max() < 100.0
        if text == "nogrid":
            assert truth["pairs"] == whole["pairs"]
    seen = json.loads((tmp_path / "both" / "window-120_lying_laz" / "truth.json").read_text())["pairs"][0]
    assert seen["overlap_a"] <= 1.0 and {seen["a"], seen["b"]} == {s["name"] for s in whole["stations"]}


def test_a_run_without_exports_removes_those_of_the_run_before(site, tmp_path: Path) -> None:
    list(write_exports(site, tmp_path, [parse_variant("nogrid")]))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("mine")
    list(write_exports(site, tmp_path, []))
    assert not (tmp_path / "nogrid").exists() and (tmp_path / "mine" / "thesis.txt").exists()


@pytest.mark.parametrize(
    "text", ["nonsense", "thinned", "thinned=x", "thinned=0", "window=400", "laz,xyz", "nogrid=3", ""]
)
def test_what_makes_no_sense_is_refused_with_what_there_is(text) -> None:
    with pytest.raises(OptionError, match=r"choose from|lies between"):
        parse_variant(text)


def test_the_command_writes_exports(tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["simulate", "office", "-o", str(out), "--stations", "1", "--points", "20000", "--quiet"]
    done = CliRunner().invoke(app, [*arguments, "--export", "nogrid,ply", "--export", "random=0.5"])
    assert done.exit_code == 0, done.output
    assert len(list((out / "nogrid_ply").glob("*.ply"))) == 1 and (out / "random-0.5" / "truth.json").exists()
