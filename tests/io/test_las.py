from pathlib import Path

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr

from trihedral.errors import InputError
from trihedral.io import ReadOptions, read_headers, read_scan


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
    scan = read_scan(header)
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
    np.testing.assert_allclose(scan.intensity, np.arange(1000) / 999, atol=1e-6)


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
