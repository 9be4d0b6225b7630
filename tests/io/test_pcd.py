import json
from pathlib import Path

import numpy as np
import pytest
from pypcd4 import Encoding, PointCloud

from trihedral.errors import InputError
from trihedral.io import ReadOptions, detect, read_headers, read_scan

FIELDS = ("x", "y", "z", "intensity", "rgb")


def cloud(count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(4)
    # Few different bytes, since pypcd4 stores uncompressed what LZF cannot shrink.
    xyz = rng.normal(0.0, 5.0, (count, 3)).round().astype(np.float32)
    intensity = rng.integers(0, 256, (count, 1)).astype(np.float32)
    rgb = PointCloud.encode_rgb(rng.integers(0, 256, (count, 3), dtype=np.uint8))
    return np.hstack([xyz, intensity, rgb.reshape(-1, 1)])


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_each_encoding_of_another_writer_reads_back(tmp_path: Path, encoding: str) -> None:
    points = cloud()
    path = tmp_path / "scan.dat"
    written = PointCloud.from_points(points, FIELDS, (np.float32,) * 5)
    written.save(path, encoding=Encoding(encoding))
    assert f"DATA {encoding}\n".encode() in path.read_bytes()
    [header] = read_headers(path)
    assert (header.format, header.points, header.grid) == ("pcd", 500, None)
    assert header.has_color and header.has_intensity
    scan = read_scan(header)
    np.testing.assert_allclose(scan.xyz, points[:, :3], rtol=1e-6)
    if encoding != "ascii":  # pypcd4 rounds packed colours to zero in ASCII
        np.testing.assert_array_equal(scan.color, PointCloud.decode_rgb(points[:, 4]))
    np.testing.assert_allclose(scan.intensity, points[:, 3] / 255.0, atol=1e-6)


def test_real_scans_agree_with_pypcd4(shared: Path) -> None:
    for name in ("s0", "s3"):
        path = shared / "data" / "eth-facade" / f"{name}.pcd"
        [header] = read_headers(path)
        assert not header.origin_stated and not header.units_stated
        scan = read_scan(header)
        np.testing.assert_array_equal(scan.xyz, PointCloud.from_path(path).numpy(("x", "y", "z")))
        assert len(scan) == header.points


def test_georeferenced_points_ask_for_the_scanner(shared: Path) -> None:
    path = shared / "data" / "formats" / "pcd" / "autzen-utm.pcd"
    with pytest.raises(InputError, match="--scanner-origin"):
        read_scan(read_headers(path)[0])
    truth = PointCloud.from_path(path).numpy(("X", "Y", "Z", "Red", "Green", "Blue"))
    middle = tuple(truth[:, :3].mean(axis=0))
    options = ReadOptions(units="m", scanner_origin=middle)
    [header] = read_headers(path, options)
    scan = read_scan(header, options)
    np.testing.assert_allclose(scan.xyz + scan.local_origin, truth[:, :3], atol=2e-4)
    np.testing.assert_array_equal(scan.color, truth[:, 3:])


@pytest.mark.parametrize("separator", ["comma", "space", "tab"])
def test_separators_of_ascii(shared: Path, separator: str) -> None:
    path = shared / "data" / "formats" / "pcd" / f"utm17_{separator}.pcd"
    options = ReadOptions(scanner_origin=(289816.0, 4320979.0, 172.0))
    scan = read_scan(read_headers(path, options)[0], options)
    np.testing.assert_allclose(scan.xyz[-1] + scan.local_origin, [289818.50, 4320980.59, 170.58], atol=1e-3)


def test_rows_without_a_header_are_no_pcd(shared: Path) -> None:
    path = shared / "data" / "formats" / "pcd" / "missingheader.pcd"
    assert detect(path) == "xyz"


def test_viewpoint_is_the_scanner(tmp_path: Path) -> None:
    path = tmp_path / "scan.pcd"
    text = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 3\nHEIGHT 2\n"
        "VIEWPOINT 1 2 3 1 0 0 0\nPOINTS 6\nDATA ascii\n"
        "0 0 1\nnan nan nan\n0 0 3\n1 1 1\n5 5 5\n7 7 7\n"
    )
    path.write_text(text)
    [header] = read_headers(path)
    assert header.origin_stated and header.scanner_origin.tolist() == [1, 2, 3]
    assert header.grid == (2, 3)
    scan = read_scan(header)
    assert scan.row.tolist() == [0, 0, 1, 1, 1] and scan.column.tolist() == [0, 2, 0, 1, 2]
    assert any("NaN" in note for note in scan.header.notes)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_a_cut_file_is_refused(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "scan.pcd"
    PointCloud.from_points(cloud(), FIELDS, (np.float32,) * 5).save(path, encoding=Encoding(encoding))
    whole = path.read_bytes()
    for keep in (len(whole) - 60, len(whole) // 2, 250, 100):
        path.write_bytes(whole[:keep])
        with pytest.raises(InputError, match=r"scan\.pcd"):
            read_scan(read_headers(path)[0])


def test_truth_of_the_facade_names_these_files(shared: Path) -> None:
    folder = shared / "data" / "eth-facade"
    stations = json.loads((folder / "truth.json").read_text())["stations"]
    assert all(read_headers(folder / station["file"])[0].points > 40_000 for station in stations)
