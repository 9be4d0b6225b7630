"""PTS and rows of numbers, against numpy.loadtxt."""

from pathlib import Path

import numpy as np
import pytest

from trihedral.errors import InputError
from trihedral.io import ReadOptions, read_headers, read_scan


def test_pts_agrees_with_loadtxt(shared: Path) -> None:
    path = shared / "data/formats/pts/test.pts"
    [header] = read_headers(path)
    assert (header.points, header.has_color, header.has_intensity) == (19, True, True)
    scan = read_scan(header)
    table = np.loadtxt(path, skiprows=1)
    np.testing.assert_allclose(scan.xyz, table[:, :3], rtol=1e-6)
    np.testing.assert_array_equal(scan.color, table[:, 4:])
    np.testing.assert_allclose(scan.intensity, (table[:, 3] + 2048) / 4095, atol=1e-6)


def test_pts_of_a_map_asks_for_the_scanner(shared: Path) -> None:
    for name in ("autzen", "site_56_8"):
        path = shared / f"data/formats/pts/{name}.pts"
        with pytest.raises(InputError, match="--scanner-origin"):
            read_scan(read_headers(path)[0])
        table = np.loadtxt(path, skiprows=1)
        options = ReadOptions(units="m", scanner_origin=tuple(table[:, :3].mean(axis=0)))
        scan = read_scan(read_headers(path, options)[0], options)
        np.testing.assert_allclose(scan.xyz + scan.local_origin, table[:, :3], atol=2e-4)


def test_pts_with_one_row_too_many_keeps_it_and_says_so(shared: Path) -> None:
    path = shared / "data/formats/pts/bunny_8.pts"
    [header] = read_headers(path)
    assert header.points == 9 and any("says 8 points, there are 9" in note for note in header.notes)
    np.testing.assert_allclose(read_scan(header).xyz, np.loadtxt(path, skiprows=1), rtol=1e-6)


def test_pts_blocks_are_scans(tmp_path: Path) -> None:
    path = tmp_path / "two.pts"
    path.write_text("2\n1 2 3 10\n-1 -2 -3 255\n1\n5 6 7 1 2 3\n")
    headers = read_headers(path)
    assert [header.points for header in headers] == [2, 1]
    options = ReadOptions(scanner_origin=(0, 0, 0))
    assert read_scan(headers[1], options).color.tolist() == [[1, 2, 3]]
    np.testing.assert_allclose(read_scan(headers[0]).intensity, [10 / 255, 1.0])


@pytest.mark.parametrize(
    "text", ["5\n1 2 3\n", "2\n1 2 3\n4 5 x\n", "2\n1 2 3 4\n5 6 7\n", "888888888888888\n1 2 3\n4 5 6\n"]
)
def test_bad_pts_names_file_and_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.pts"
    path.write_text(text)
    with pytest.raises(InputError, match=r"bad\.pts, line \d"):
        read_scan(read_headers(path)[0], ReadOptions(scanner_origin=(0, 0, 0)))


@pytest.mark.parametrize("delimiter", [" ", ",", ";", "\t", ", "])
@pytest.mark.parametrize("header_line", ["", "# exported\n", "x{0}y{0}z{0}Intensity{0}R{0}G{0}B{0}nx\n"])
def test_rows_in_every_dress(tmp_path: Path, delimiter: str, header_line: str) -> None:
    rng = np.random.default_rng(2)
    table = np.hstack(
        [
            rng.normal(0, 4, (50, 3)),
            rng.uniform(0, 1, (50, 1)),
            rng.integers(0, 256, (50, 3)),
            np.ones((50, 1)),
        ]
    )
    path = tmp_path / "points.txt"
    np.savetxt(path, table, fmt=["%.6f"] * 4 + ["%d"] * 3 + ["%.1f"], delimiter=delimiter)
    path.write_text(header_line.format(delimiter) + path.read_text())
    [header] = read_headers(path)
    assert header.format == "xyz" and header.points is None
    assert any("nx" in note or "columns not used: 8" in note for note in header.notes)
    scan = read_scan(header)
    truth = np.loadtxt(
        path, delimiter=delimiter.strip(" ") or None, skiprows=1 if header_line.startswith("x") else 0
    )
    np.testing.assert_allclose(scan.xyz, truth[:, :3], rtol=1e-6)
    np.testing.assert_array_equal(scan.color, truth[:, 4:7])
    np.testing.assert_allclose(scan.intensity, truth[:, 3], atol=1e-6)


def test_decimal_commas_of_a_german_export(tmp_path: Path) -> None:
    path = tmp_path / "punkte.csv"
    path.write_bytes("\ufeffX;Y;Z\r\n1,25;-2,5;0,125\r\n-4,0;8,5;1,0\r\n".encode())
    [header] = read_headers(path)
    assert "commas are decimal signs" in header.notes
    assert read_scan(header).xyz.tolist() == [[1.25, -2.5, 0.125], [-4.0, 8.5, 1.0]]


def test_a_broken_row_is_named(tmp_path: Path) -> None:
    path = tmp_path / "rows.xyz"
    path.write_text("1 2 3\n" * 5000 + "-1 -2\n")
    with pytest.raises(InputError, match=r"rows\.xyz, line 5001: there are 2 numbers"):
        read_scan(read_headers(path)[0])
