"""Counts and sizes that files state: held against what the file can hold, and nothing is left out without a word."""

import io
import re
import struct
import zipfile
from pathlib import Path

import laspy
import numpy as np
import pytest
from PIL import Image
from pypcd4 import Encoding, PointCloud

from support.e57_pages import with_xml, xml
from trihedral.errors import InputError
from trihedral.fusion.pixels import decoded, picture_size
from trihedral.fusion.rig import LineScanner, Profiles
from trihedral.io import ReadOptions, detect, read_headers, read_photos, read_scan
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.io.rig import write_rig
from trihedral.scan import CameraModel, Photo, Scan

OPTIONS = ReadOptions(units="m", scanner_origin=(0.0, 0.0, 0.0))
POINTS = np.random.default_rng(4).normal(0.0, 5.0, (1000, 3)).round(3)


def first(path: Path) -> Scan:
    return read_scan(read_headers(path, OPTIONS)[0], OPTIONS)


def notes(path: Path) -> str:
    return " ".join(first(path).header.notes)


def las(path: Path, points: np.ndarray = POINTS, *, form: int = 6, version: str = "1.4") -> Path:
    header = laspy.LasHeader(point_format=form, version=version)
    header.scales = [0.001] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.return_number[:] = 1
    data.write(path)
    return path


def patched(path: Path, *values: tuple[int, str, int]) -> Path:
    data = bytearray(path.read_bytes())
    for at, kind, value in values:
        struct.pack_into(kind, data, at, value)
    path.write_bytes(data)
    return path


def e57(path: Path, scans: int = 1, points: np.ndarray = POINTS) -> Path:
    write_e57(path, [E57Scan(name=f"scan {k}", xyz=points.astype(np.float32)) for k in range(scans)])
    return path


@pytest.mark.parametrize(
    ("suffix", "form", "version"),
    [("las", 0, "1.2"), ("las", 6, "1.4"), ("laz", 0, "1.2"), ("laz", 6, "1.4")],
)
def test_las_with_more_points_than_its_header_says(
    tmp_path: Path, suffix: str, form: int, version: str
) -> None:
    path = las(tmp_path / f"a.{suffix}", form=form, version=version)
    assert "header says" not in notes(path)
    counts = [(107, "<I", 500)] if version == "1.2" else [(247, "<Q", 500)]
    patched(path, *counts)
    assert len(first(path)) == 500
    assert "holds 1,000 points, its header says 500" in notes(path)


def test_e57_with_more_points_than_its_description_says(tmp_path: Path) -> None:
    # Larger than a packet: points are counted in those behind, too.
    many = np.tile(POINTS, (30, 1))
    path = e57(tmp_path / "a.e57", points=many)
    assert "more than its header says" not in notes(path)
    for said in (500, 29_999):
        text = xml(path).replace('recordCount="30000"', f'recordCount="{said}"')
        less = with_xml(path, text, tmp_path / "less.e57")
        assert len(first(less)) == said
        expected = "" if said == 29_999 else f"{30_000 - said:,} points more than its header says"
        assert expected in notes(less)


@pytest.mark.parametrize("kind", ["ascii", "binary", "pcd-ascii", "pcd-binary"])
def test_ply_and_pcd_with_more_points_than_their_header_says(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "cloud"
    if kind.startswith("pcd"):
        PointCloud.from_xyz_points(POINTS.astype(np.float32)).save(path, encoding=Encoding(kind[4:]))
        data = path.read_bytes().replace(b"WIDTH 1000", b"WIDTH 500").replace(b"POINTS 1000", b"POINTS 500")
    else:
        head = (
            f"ply\nformat {'ascii' if kind == 'ascii' else 'binary_little_endian'} 1.0\nelement vertex 500\n"
        )
        head += "property float x\nproperty float y\nproperty float z\nend_header\n"
        rows = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS).encode()
        data = head.encode() + (rows if kind == "ascii" else POINTS.astype("<f4").tobytes())
    path.write_bytes(data)
    assert len(first(path)) == 500
    assert "500 points more than its header says" in notes(path)


@pytest.mark.parametrize("kind", ["xyz", "pts", "ptx", "ply"])
def test_text_that_is_cut_within_its_last_number_is_doubted(tmp_path: Path, kind: str) -> None:
    rows = "".join(f"{x:.3f} {y:.3f} {z:.3f}\n" for x, y, z in POINTS)
    unit = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    heads = {"xyz": "", "pts": "1000\n", "ptx": f"10\n100\n{unit}"}
    heads["ply"] = "ply\nformat ascii 1.0\nelement vertex 1000\n" + "property float x\n" * 1
    heads["ply"] += "property float y\nproperty float z\nend_header\n"
    if kind == "ptx":
        rows = rows.replace("\n", " 0.5\n")
    path = tmp_path / f"a.{kind}"
    path.write_text(heads[kind] + rows)
    assert "last line has no end" not in notes(path)
    path.write_text((heads[kind] + rows)[:-2])
    assert "last line has no end" in notes(path)


def test_points_flagged_as_invalid_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.e57"
    invalid = np.arange(1000) < 300
    write_e57(path, [E57Scan(name="one", xyz=POINTS.astype(np.float32), invalid=invalid)])
    assert len(first(path)) == 700
    assert "300 points flagged as invalid left out" in notes(path)


# --- LAS and LAZ


def laszip_at(path: Path) -> int:
    """Where LASzip's record of the compression begins."""
    return path.read_bytes().index(b"laszip encoded") + 52


@pytest.mark.parametrize("form", [0, 6])
def test_laz_chunks_that_no_memory_holds_are_refused(tmp_path: Path, form: int) -> None:
    for chunk in (0, 0x7FFF_FFFF, 0xFFFF_FFFE):
        path = las(tmp_path / "a.laz", form=form)
        patched(path, (laszip_at(path) + 12, "<I", chunk))
        with pytest.raises(InputError, match=r"a\.laz"):
            first(path)


def test_laz_chunks_and_layers_must_fill_the_file(tmp_path: Path) -> None:
    path = las(tmp_path / "a.laz")
    points_at = struct.unpack_from("<I", path.read_bytes(), 96)[0]
    record = struct.unpack_from("<H", path.read_bytes(), 105)[0]
    for layer in range(9):
        again = las(tmp_path / "a.laz")
        patched(again, (points_at + 8 + record + 4 + 4 * layer, "<I", 0xFFFF_FFF0))
        with pytest.raises(InputError, match="layers"):
            first(again)


def test_extended_records_of_absurd_length_are_refused(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las")
    size = path.stat().st_size
    path.write_bytes(path.read_bytes() + struct.pack("<H16sHQ32s", 0, b"x", 1, 10**18, b""))
    patched(path, (235, "<Q", size), (243, "<I", 1))
    with pytest.raises(InputError, match="extended records"):
        read_headers(path, OPTIONS)


def test_laz_of_more_points_than_its_bytes_are_worth_is_refused(tmp_path: Path) -> None:
    path = las(tmp_path / "a.laz", np.ones((8_000_000, 3)))
    assert path.stat().st_size < 1_000_000
    with pytest.raises(InputError, match="no scan is so dense"):
        read_headers(path, OPTIONS)


# --- Pictures and archives


def test_pictures_of_more_pixels_than_their_bytes_are_worth_are_refused() -> None:
    data = io.BytesIO()
    Image.new("L", (9000, 9000)).save(data, "PNG")
    assert len(data.getvalue()) < 100_000
    with pytest.raises(ValueError, match="cannot be worth"):
        decoded(data.getvalue(), "RGB")


def test_only_jpeg_and_png_are_decoded() -> None:
    for kind in ("BMP", "GIF", "TIFF", "EPS"):
        data = io.BytesIO()
        Image.new("RGB", (8, 8)).save(data, kind)
        with pytest.raises(ValueError, match="identify"):
            picture_size(data.getvalue())


def rig(folder: Path) -> Path:
    turns, beams = np.radians(np.arange(0.0, 360.0, 10.0)), np.radians(np.linspace(-90, 90, 19))
    ranges = np.full((len(turns), len(beams)), 5.0, np.float32)
    path = folder / "one.toml"
    write_rig(path, "one", [Profiles(LineScanner("line", 0.2, 1.3, np.eye(4)), turns, beams, ranges, None)])
    return path


def npy(values: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, values)
    return stream.getvalue()


def archive(path: Path, **members: bytes) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(f"{name}.npy", data)


def test_archives_of_more_than_their_bytes_are_worth_are_refused(tmp_path: Path) -> None:
    path = rig(tmp_path)
    turns, beams = np.linspace(0, 359, 12_000), np.linspace(-90, 90, 1000)
    archive(
        tmp_path / "one-line.npz",
        body_angle_deg=npy(turns),
        beam_angle_deg=npy(beams),
        range_m=npy(np.ones((12_000, 1000), np.float32)),
    )
    assert (tmp_path / "one-line.npz").stat().st_size < 400_000
    with pytest.raises(InputError, match="more than it can be worth"):
        read_headers(path)


@pytest.mark.parametrize(
    "header",
    [
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (",
        b"{" * 900,
        b"\xff" * 40,
        b"{'descr': [], }",
        b"",
    ],
)
def test_a_damaged_header_of_an_array_is_named(tmp_path: Path, header: bytes) -> None:
    path = rig(tmp_path)
    damaged = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header
    archive(
        tmp_path / "one-line.npz",
        body_angle_deg=damaged,
        beam_angle_deg=npy(np.arange(3.0)),
        range_m=npy(np.ones((3, 3))),
    )
    with pytest.raises(InputError, match=r"one-line\.npz.*damaged"):
        read_headers(path)


@pytest.mark.parametrize("value", ["1e308", "-1e12"])
def test_a_rig_turned_beyond_sense_is_refused(tmp_path: Path, value: str) -> None:
    path = rig(tmp_path)
    text = path.read_text()
    begin = text.index("body_from_mounting")
    text = text[:begin] + f'mounting = {{turn_deg = [{value}, 0, 0]}}\nprofiles = "one-line.npz"\n'
    path.write_text(text)
    with pytest.raises(InputError, match="turn_deg"):
        read_scan(read_headers(path)[0])


# --- E57


def test_scans_and_pictures_cannot_share_their_bytes(tmp_path: Path) -> None:
    photo = Photo("p", "jpeg", b"\xff\xd8\xff" * 3000, CameraModel("visual-reference", 4, 3), np.eye(4))
    path = tmp_path / "a.e57"
    write_e57(path, [E57Scan(name="one", xyz=POINTS.astype(np.float32), photos=(photo,))])
    text = xml(path)
    for tag in ("data3D", "images2D"):
        begin = text.index("<vectorChild", text.index(f"<{tag}"))
        end = text.index("</vectorChild>", begin) + len("</vectorChild>")
        text = text[:end] + text[begin:end] * 400 + text[end:]
    shared = with_xml(path, text, tmp_path / "shared.e57")
    headers = read_headers(shared, OPTIONS)
    refused = [header for header in headers if header.points is None]
    assert len(headers) == 401 and len(refused) > 300
    with pytest.raises(InputError, match="room for in the file"):
        read_scan(refused[0], OPTIONS)
    assert sum(len(photo.data) for photo in read_photos(headers[0])) < shared.stat().st_size


def test_many_broken_entries_cost_a_note_each(tmp_path: Path) -> None:
    path = e57(tmp_path / "a.e57")
    text = xml(path)
    end = text.index("</vectorChild>") + len("</vectorChild>")
    broken = '<vectorChild type="Structure"/>' * 500
    text = re.sub(
        r"<images2D.*</images2D>|<images2D[^>]*/>", "", text[:end] + broken + text[end:], flags=re.DOTALL
    )
    text = text.replace("</e57Root>", f'<images2D type="Vector">{broken}</images2D></e57Root>')
    headers = read_headers(with_xml(path, text, tmp_path / "broken.e57"), OPTIONS)
    assert len(headers) == 501
    assert sum(len(note) for header in headers for note in header.notes) < 501 * 400


@pytest.mark.parametrize("attack", ["attributes", "namespaces", "nested"])
def test_xml_that_takes_the_parser_for_ever_is_refused(tmp_path: Path, attack: str) -> None:
    path = e57(tmp_path / "a.e57")
    extra = {
        "attributes": "<x " + " ".join(f'a{k}="1"' for k in range(50_000)) + "/>",
        "namespaces": "".join(f'<x xmlns:a{k}="u{k}">' for k in range(5000)) + "</x>" * 5000,
        "nested": "<x>" * 50_000 + "</x>" * 50_000,
    }[attack]
    text = xml(path).replace("</e57Root>", f"{extra}</e57Root>")
    attacked = with_xml(path, text, tmp_path / "attack.e57")
    if attack == "nested":
        assert len(first(attacked)) == 1000
    else:
        with pytest.raises(InputError, match=attack):
            first(attacked)


@pytest.mark.parametrize("bound", [-(10**12), 10**12, -(2**31), 2**63])
def test_bounds_of_a_grid_that_no_grid_has_are_not_used(tmp_path: Path, bound: int) -> None:
    path = tmp_path / "a.e57"
    row, column = np.arange(1000, dtype=np.int32) % 50, np.arange(1000, dtype=np.int32) // 50
    write_e57(path, [E57Scan(name="one", xyz=POINTS.astype(np.float32), row=row, column=column)])
    lowest = r'<rowMinimum type="Integer"(/>|>0?</rowMinimum>)'
    text, count = re.subn(lowest, f'<rowMinimum type="Integer">{bound}</rowMinimum>', xml(path))
    assert count == 1
    scan = first(with_xml(path, text, tmp_path / "odd.e57"))
    assert scan.row is not None and len(np.unique(scan.row)) in (1, 50)
    assert len(scan) == 1000


def test_names_of_any_length_are_cut(tmp_path: Path) -> None:
    path = e57(tmp_path / "a.e57")
    text = xml(path).replace("scan 0", "7" * 5000)
    [header] = read_headers(with_xml(path, text, tmp_path / "long.e57"), OPTIONS)
    assert header.name == "7" * 200


def test_line_ends_alone_are_no_format(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"\n" * 65_536)
    with pytest.raises(InputError):
        detect(path)
