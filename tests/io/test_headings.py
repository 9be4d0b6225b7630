"""What headings say of columns, and files whose first lines are not like the rest."""

from pathlib import Path

import numpy as np
import pytest

from trihedral.errors import InputError
from trihedral.io import ReadOptions, detect, read_headers, read_scan
from trihedral.scan import Scan

POINTS = np.random.default_rng(3).uniform(-9, 9, (300, 3)).round(4)
COLORS = np.random.default_rng(4).integers(1, 256, (300, 3))
NORMALS = np.random.default_rng(5).normal(size=(300, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1)[:, None]
INTENSITY = np.random.default_rng(6).uniform(0, 1, 300).round(4)


def read(path: Path, options: ReadOptions | None = None) -> Scan:
    options = options or ReadOptions()
    return read_scan(read_headers(path, options)[0], options)


def rows(*columns: np.ndarray, separator: str = " ", comma: bool = False) -> list[str]:
    table = np.column_stack(columns)
    lines = [separator.join(f"{value:.6g}" for value in row) for row in table]
    return [line.replace(".", ",") for line in lines] if comma else lines


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("heading", "order", "separator"),
    [
        ("N,E,Z", (1, 0, 2), ","),
        ("E N H", (0, 1, 2), " "),
        ("Hochwert;Rechtswert;Höhe", (1, 0, 2), ";"),
        ("Y (Rechtswert)\tX (Hochwert)\tH", (0, 1, 2), "\t"),
        ("X [m] Y [m] Z [m]", (0, 1, 2), " "),
        ("X(m),Y(m),Z(m)", (0, 1, 2), ","),
        ('"Z","Y","X"', (2, 1, 0), ","),
        ("# columns: z x y", (2, 0, 1), " "),
        ("; Ost Nord Höhe", (0, 1, 2), " "),
        ("% x, y, z", (0, 1, 2), ","),
        ("Northing (US ft);Easting (US ft);Elevation (US ft)", (1, 0, 2), ";"),
        ('"Points:0","Points:1","Points:2"', (0, 1, 2), ","),
    ],
)
def test_a_heading_says_which_column_is_which(
    tmp_path: Path, heading: str, order: tuple[int, ...], separator: str
) -> None:
    path = write(tmp_path / "points.csv", heading, *rows(POINTS[:, order], separator=separator))
    np.testing.assert_allclose(read(path).xyz, POINTS, atol=1e-5)
    assert any("by the heading" in note for note in read_headers(path)[0].notes)


@pytest.mark.parametrize("count", [True, False])
@pytest.mark.parametrize("normals", [True, False])
def test_cloudcompare_names_columns_and_may_count_points(tmp_path: Path, count: bool, normals: bool) -> None:
    heading = "//X Y Z R G B Intensity" + " Nx Ny Nz" * normals
    lines = rows(POINTS, COLORS, INTENSITY, *[NORMALS] * normals)
    path = write(tmp_path / "a.asc", heading, *["300"] * count, *lines)
    scan = read(path)
    np.testing.assert_allclose(scan.xyz, POINTS, atol=1e-5)
    np.testing.assert_array_equal(scan.color, COLORS)
    np.testing.assert_allclose(scan.intensity, INTENSITY, atol=1e-6)
    if count:
        assert read_headers(path)[0].points == 300
        cut = write(tmp_path / "cut.asc", heading, "300", *lines[:200])
        with pytest.raises(InputError, match="ends after 200 of 300 points"):
            read(cut)


@pytest.mark.parametrize("full", [1.0, 255.0, 65535.0])
def test_colours_of_any_depth(tmp_path: Path, full: float) -> None:
    stored = COLORS / 255 if full == 1.0 else COLORS * (full / 255)
    path = write(tmp_path / "a.csv", "X;Y;Z;Rf;Gf;Bf", *rows(POINTS, stored, separator=";"))
    np.testing.assert_array_equal(read(path).color, COLORS)
    bare = write(tmp_path / "b.xyz", *rows(POINTS, stored))
    np.testing.assert_array_equal(read(bare).color, COLORS)


@pytest.mark.parametrize("separator", [";", "\t", " "])
@pytest.mark.parametrize("quote", ["", '"'])
def test_decimal_commas(tmp_path: Path, separator: str, quote: str) -> None:
    heading = separator.join(f"{quote}{name}{quote}" for name in "XYZRGB")
    body = rows(POINTS, COLORS, separator=separator, comma=True)
    body = [separator.join(f"{quote}{word}{quote}" for word in line.split(separator)) for line in body]
    scan = read(write(tmp_path / "a.txt", heading, *body))
    np.testing.assert_allclose(scan.xyz, POINTS, atol=1e-5)
    np.testing.assert_array_equal(scan.color, COLORS)


def test_every_number_in_quotes(tmp_path: Path) -> None:
    body = ['"' + line.replace(",", '","') + '"' for line in rows(POINTS, separator=",")]
    np.testing.assert_allclose(read(write(tmp_path / "a.csv", '"X","Y","Z"', *body)).xyz, POINTS, atol=1e-5)


def test_commas_for_both_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "X,Y,Z", *["1,25,2,50,3,75"] * 9)
    with pytest.raises(InputError, match="decimal signs and separators at once"):
        read_headers(path)


def test_several_lines_of_heading(tmp_path: Path) -> None:
    lines = ("Project: site 7", "Date: 2021-03-04", "Z Y X", *rows(POINTS[:, ::-1]))
    np.testing.assert_allclose(read(write(tmp_path / "heading.txt", *lines)).xyz, POINTS, atol=1e-5)


@pytest.mark.parametrize(
    ("heading", "reason"),
    [
        ("Longitude,Latitude,Height", "names angles"),
        ("E,N,quality", "does not name all of"),
    ],
)
def test_a_heading_that_does_not_fit_is_refused(tmp_path: Path, heading: str, reason: str) -> None:
    path = write(tmp_path / "a.csv", heading, *rows(POINTS, separator=","))
    with pytest.raises(InputError, match=reason):
        read_headers(path)


def test_words_before_the_names_are_none(tmp_path: Path) -> None:
    path = write(tmp_path / "a.txt", "points of site 7: id E N H", *rows(INTENSITY, POINTS))
    np.testing.assert_allclose(read(path).xyz, POINTS, atol=1e-5)
    path = write(tmp_path / "b.txt", "my points id E N H", *rows(INTENSITY, POINTS))
    np.testing.assert_allclose(read(path).xyz, POINTS, atol=1e-5)


def test_y_before_x_is_pointed_at(tmp_path: Path) -> None:
    notes = read_headers(write(tmp_path / "a.csv", "Y,X,H", *rows(POINTS, separator=",")))[0].notes
    assert any("mirror image" in note for note in notes)


def test_normals_are_no_colour_and_no_intensity(tmp_path: Path) -> None:
    scan = read(write(tmp_path / "e.xyz", *rows(POINTS, COLORS, NORMALS)))
    np.testing.assert_array_equal(scan.color, COLORS)
    assert scan.intensity is None
    scan = read(write(tmp_path / "n.xyz", *rows(POINTS, NORMALS)))
    assert scan.color is None and scan.intensity is None


def test_points_with_numbers(tmp_path: Path) -> None:
    number = np.arange(1, 301)
    scan = read(write(tmp_path / "a.txt", *rows(number, POINTS, INTENSITY)))
    np.testing.assert_allclose(scan.xyz, POINTS, atol=1e-5)
    np.testing.assert_allclose(scan.intensity, INTENSITY, atol=1e-6)


def test_columns_are_those_of_the_whole_file(tmp_path: Path) -> None:
    """The first 20,000 rows are of a black wall whose intensities look like a colour's bytes."""
    dark = ["1 2 3 0 0 0"] * 20_000
    scan = read(write(tmp_path / "a.xyz", *dark, *rows(POINTS, NORMALS)))
    assert scan.color is None
    scan = read(write(tmp_path / "b.txt", "x y z r g b", *dark, *rows(POINTS, COLORS)))
    np.testing.assert_array_equal(scan.color[-300:], COLORS)


@pytest.mark.parametrize("stray", ["0 0 0", "0 0 0 0 0 0 0 0 0 0 0 0"])
@pytest.mark.parametrize("kind", ["xyz", "pts"])
def test_a_first_row_of_another_width_is_left_out(tmp_path: Path, stray: str, kind: str) -> None:
    count = ["301"] * (kind == "pts")
    path = write(tmp_path / "a.txt", *count, stray, *rows(POINTS, INTENSITY, COLORS))
    assert detect(path) == kind
    scan = read(path)
    np.testing.assert_allclose(scan.xyz, POINTS, atol=1e-5)
    np.testing.assert_array_equal(scan.color, COLORS)
    assert any("left out: it has another number" in note for note in scan.header.notes)


@pytest.mark.parametrize("comma", [True, False])
def test_pts_with_normals_and_decimal_commas(tmp_path: Path, comma: bool) -> None:
    raw = np.round(INTENSITY * 4095) - 2048
    lines = rows(POINTS, raw, COLORS, NORMALS, comma=comma)
    counted = read(write(tmp_path / "a.pts", "300", *lines))
    assert counted.header.format == "pts"
    for scan in (counted, read(write(tmp_path / "b.pts", *lines))):
        np.testing.assert_allclose(scan.xyz, POINTS, atol=1e-5)
        np.testing.assert_array_equal(scan.color, COLORS)
        np.testing.assert_allclose(scan.intensity, (raw + 2048) / 4095, atol=1e-6)


def ptx(columns: int, points: np.ndarray) -> list[str]:
    header = [str(columns), str(len(points) // columns), "0.0 0.0 0.0"]
    identity = np.eye(4)
    return header + rows(identity[:3, :3]) + rows(identity) + rows(points, np.full(len(points), 0.25))


def test_ptx_with_decimal_commas_and_with_too_many_rows(tmp_path: Path) -> None:
    lines = ptx(10, POINTS)
    scan = read(write(tmp_path / "a.ptx", *[line.replace(".", ",") for line in lines]))
    assert (scan.header.format, scan.header.grid) == ("ptx", (30, 10))
    np.testing.assert_allclose(scan.xyz, POINTS, atol=1e-5)
    np.testing.assert_array_equal(scan.intensity, np.float32(0.25))
    with pytest.raises(InputError, match="line 311: there are more points than the 10 columns of 30"):
        read_headers(write(tmp_path / "b.ptx", *lines, *lines[10:50]))


def test_hundreds_of_columns_take_a_short_note(tmp_path: Path) -> None:
    [header] = read_headers(write(tmp_path / "wide.xyz", *[line + " 0.5" * 697 for line in rows(POINTS)]))
    assert any("5 to 700" in note for note in header.notes)
    assert max(map(len, header.notes)) < 120


def test_centimetres(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xyz", *rows(POINTS * 100))
    np.testing.assert_allclose(read(path, ReadOptions(units="cm")).xyz, POINTS, atol=1e-4)


MAP = np.array([512345.0, 5401234.0, 420.0])


@pytest.mark.parametrize("kind", ["xyz", "pts", "ply", "pcd", "las"])
@pytest.mark.parametrize("base", [np.zeros(3), MAP])
def test_one_stray_record_at_the_head_costs_no_precision(tmp_path: Path, kind: str, base: np.ndarray) -> None:
    points = np.vstack([[0.0, 0.0, 8e6] if kind != "las" else [0.0, 0.0, 1.7], POINTS + base])
    path = tmp_path / f"a.{kind}"
    text = [" ".join(f"{value:.4f}" for value in row) for row in points]
    if kind in ("xyz", "pts"):
        write(path, *["301"] * (kind == "pts"), *text)
    elif kind == "ply":
        head = "".join(f"property double {name}\n" for name in "xyz")
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex 301\n{head}end_header\n"
        path.write_bytes(head.encode() + points.tobytes())
    elif kind == "pcd":
        head = (
            "VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 301\nHEIGHT 1\nPOINTS 301\n"
        )
        path.write_bytes((head + "DATA binary\n").encode() + points.tobytes())
    else:
        import laspy

        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = np.full(3, 0.01)
        las = laspy.LasData(header)
        las.x, las.y, las.z = points.T
        las.write(path)
        points = np.column_stack([las.x, las.y, las.z])
    options = ReadOptions(units="m", scanner_origin=tuple(base))
    scan = read(path, options)
    back = scan.xyz.astype(np.float64) + scan.local_origin
    np.testing.assert_allclose(back[1:], points[1:], atol=1e-4)
