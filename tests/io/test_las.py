import struct
import sys
import types
from pathlib import Path

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr

from trihedral.errors import InputError
from trihedral.io import ReadOptions, read_headers, read_scan
from trihedral.io import las as las_io
from trihedral.io.writers import Content, PlacedScan


def write(path: Path, points: np.ndarray, *, wkt: str = "", color: int = 0) -> None:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [1e-4] * 3, points.mean(axis=0).round()
    if wkt:
        header.vlrs.append(WktCoordinateSystemVlr(wkt))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.intensity = np.arange(len(points)) * 3
    las.red = las.green = np.full(len(points), color, dtype=np.uint16)
    las.blue = np.zeros(len(points), dtype=np.uint16)
    las.write(path)


def test_a_real_laz_agrees_with_laspy(shared: Path) -> None:
    path = shared / "data/formats/las/indoor.laz"
    [header] = read_headers(path)
    assert (header.format, header.points) == ("laz", 808_042)
    assert not header.units_stated and not header.origin_stated
    # By the reader of the format: `read_scan` asks where the scanner stood.
    scan = las_io.read_scan(path, 0, ReadOptions())
    truth = laspy.read(path)
    np.testing.assert_allclose(scan.xyz, truth.xyz, atol=1e-5)
    assert scan.color is None and any("black" in note for note in scan.header.notes)


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize(("color", "expected"), [(200, 200), (51_400, 200)])
def test_colours_of_8_and_16_bits(tmp_path: Path, suffix: str, color: int, expected: int) -> None:
    path = tmp_path / f"scan.{suffix}"
    points = np.random.default_rng(1).normal(0, 5, (1000, 3))
    write(path, points, color=color)
    scan = read_scan(read_headers(path)[0])
    np.testing.assert_allclose(scan.xyz, points, atol=6e-5)
    assert (scan.color == [expected, expected, 0]).all()
    np.testing.assert_allclose(scan.intensity, np.arange(1000) * 3 / 65535, atol=1e-7)


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        ('UNIT["metre",1]', 1.0),
        ('UNIT["foot",0.3048]', 0.3048),
        ('UNIT["US survey foot",0.30480060960121924]', 1200 / 3937),
    ],
)
def test_units_of_the_coordinate_system(tmp_path: Path, unit: str, metres: float) -> None:
    path = tmp_path / "map.las"
    points = np.random.default_rng(1).normal(0, 5, (100, 3)) + np.array([600_000, 800_000, 400])
    gcs = (
        'GEOGCS["g",DATUM["d",SPHEROID["s",6378137,298.25]],PRIMEM["p",0],UNIT["degree",0.0174532925199433]]'
    )
    write(path, points, wkt=f'PROJCS["p",{gcs},PROJECTION["x"],{unit}]')
    options = ReadOptions(scanner_origin=tuple(np.array([600_000, 800_000, 400]) * metres))
    [header] = read_headers(path, options)
    assert header.units_stated
    scan = read_scan(header, options)
    np.testing.assert_allclose(scan.xyz + scan.local_origin, points * metres, atol=2e-4)
    with pytest.raises(InputError, match="--scanner-origin"):
        read_scan(read_headers(path)[0])


def test_longitude_and_latitude_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "degrees.las"
    write(path, np.ones((3, 3)), wkt='GEOGCS["g",DATUM["d",SPHEROID["s",1,2]],UNIT["degree",0.017]]')
    with pytest.raises(InputError, match="longitude and latitude"):
        read_headers(path)


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("keep", [0.98, 0.5, 0.02])
def test_a_cut_file_is_refused(tmp_path: Path, suffix: str, keep: float) -> None:
    path = tmp_path / f"cut.{suffix}"
    write(path, np.random.default_rng(1).normal(0, 5, (5000, 3)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * keep)])
    with pytest.raises(InputError, match=rf"cut\.{suffix}"):
        read_scan(read_headers(path)[0])


def with_system(path: Path, points: np.ndarray, code: int) -> Path:
    """A LAS file that names its coordinate system by GeoTIFF keys alone."""
    keys = [(1024, 0, 1, 1), (3072, 0, 1, code)]
    data = struct.pack("<4H", 1, 1, 0, len(keys)) + b"".join(struct.pack("<4H", *key) for key in keys)
    header = laspy.LasHeader(version="1.2", point_format=0)
    header.scales = np.full(3, 1e-4)
    header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", data))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(path)
    return path


def test_a_system_named_by_its_code_is_pointed_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """EPSG:2263 is in US feet, which takes a table of systems to know."""
    path = with_system(tmp_path / "feet.las", np.random.default_rng(1).normal(0, 15, (100, 3)), 2263)
    monkeypatch.setitem(sys.modules, "pyproj", None)
    [header] = read_headers(path)
    assert (header.units, header.units_stated) == ("m", False)
    assert any("EPSG:2263" in note and "trihedral[crs]" in note for note in header.notes)
    [header] = read_headers(path, ReadOptions(units="us-ft"))
    assert not any("EPSG" in note for note in header.notes)


def test_units_of_a_system_by_its_code(tmp_path: Path) -> None:
    pytest.importorskip("pyproj", reason="pyproj, which is optional, is not installed")
    points = np.random.default_rng(1).normal(0, 15, (100, 3))
    for code, units in ((2263, "us-ft"), (32632, "m"), (2222, "ft")):
        [header] = read_headers(with_system(tmp_path / f"{code}.las", points, code))
        assert (header.units, header.units_stated) == (units, True)
    with pytest.raises(InputError, match="longitude"):
        read_headers(with_system(tmp_path / "angles.las", points, 4326))


def test_a_table_of_systems_is_asked_for_the_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same with a stand-in for pyproj, which need not be there."""
    axis = types.SimpleNamespace(unit_conversion_factor=1200 / 3937)
    system = types.SimpleNamespace(is_geographic=False, axis_info=[axis, axis])
    table = types.ModuleType("pyproj")
    table.CRS = types.SimpleNamespace(from_epsg={2263: system}.__getitem__)  # type: ignore[attr-defined]
    errors = types.ModuleType("pyproj.exceptions")
    errors.CRSError = KeyError  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pyproj", table)
    monkeypatch.setitem(sys.modules, "pyproj.exceptions", errors)
    points = np.random.default_rng(1).normal(0, 15, (100, 3))
    path = with_system(tmp_path / "feet.las", points, 2263)
    [header] = read_headers(path)
    assert (header.units, header.units_stated) == ("us-ft", True)
    np.testing.assert_allclose(read_scan(header).xyz, points * 1200 / 3937, atol=1e-4)
    [header] = read_headers(with_system(tmp_path / "other.las", points, 9999))
    assert any("EPSG:9999, whose unit is not known" in note for note in header.notes)


@pytest.mark.parametrize("largest", [255, 45_000, 65_535])
def test_intensities_keep_one_scale_for_all_scans(tmp_path: Path, largest: int) -> None:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, 1e-4)
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.random.default_rng(1).normal(0, 5, (3, 1000))
    las.intensity = np.linspace(0, largest, 1000).astype(np.uint16)
    las.write(tmp_path / "a.las")
    scan = read_scan(read_headers(tmp_path / "a.las")[0])
    content = Content(1000, color=False, intensity=True, scanners=(np.zeros(3),))
    las_io.write(tmp_path / "b.laz", [PlacedScan("a", scan, np.eye(4))], content)
    np.testing.assert_array_equal(laspy.read(tmp_path / "b.laz").intensity, las.intensity)
