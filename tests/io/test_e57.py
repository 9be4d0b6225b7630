import time
from pathlib import Path

import numpy as np
import pye57
import pytest

from support.e57_files import by_pye57, pictures_by_pye57
from support.e57_pages import content, header, logical, seal, with_xml, xml
from trihedral.errors import InputError
from trihedral.io import ReadOptions, read_headers, read_photos, read_scan
from trihedral.io.e57 import E57Scan, write_e57

E57 = "data/formats/e57"
WITH_SCANS = [
    *("A4", "A4_moved", "A_B", "A_B_different_dims", "A_merged_B", "A_moved_B", "B2"),
    *("ColouredCubeDouble", "ColouredCubeFloat", "bunnyDouble", "bunnyFloat", "bunnyInt19", "bunnyInt32"),
    *("cartesian_invalid_state_single", "float_intensity_without_min_max", "integer_intensity"),
    *("las2e57_no_images_tag", "no_ext_namespace", "original_guids", "scaled_integer_intensity"),
    *("testWithNormals", "testWithUnsupportedField", "tinyCartesianFloatRgb", "tiny_pc_and_images"),
    *("tiny_pc_with_extension", "tiny_spherical", "translationWithoutRotation"),
]


@pytest.mark.parametrize("name", WITH_SCANS)
def test_points_and_colours_agree_with_the_independent_reader(shared: Path, name: str) -> None:
    path = shared / E57 / f"{name}.e57"
    headers = read_headers(path)
    assert len(headers) == pye57.E57(str(path)).scan_count
    for found in headers:
        scan = read_scan(found)
        other = by_pye57(path, found.scan_index)
        assert len(scan) == len(other["xyz"]) > 0
        np.testing.assert_allclose(scan.xyz + scan.local_origin, other["xyz"], rtol=1e-7, atol=1e-7)
        assert (scan.color is not None) == ("colorRed" in other)
        if scan.color is not None:
            expected = np.column_stack([other[f"color{channel}"] for channel in ("Red", "Green", "Blue")])
            depth = 257.0 if expected.max() > 255.0 else 1.0  # one file has 16 bits
            np.testing.assert_allclose(scan.color, expected / depth, atol=0.5 if depth > 1.0 else 0.0)
            assert (depth > 1.0) == (name == "las2e57_no_images_tag")


def test_the_cube_is_a_cube(shared: Path) -> None:
    for name in ("ColouredCubeFloat", "ColouredCubeDouble"):
        scan = read_scan(read_headers(shared / E57 / f"{name}.e57")[0])
        assert len(scan) == 7680
        np.testing.assert_allclose(np.abs(scan.xyz).max(axis=1), 0.5, rtol=1e-6)
        # Faces across x are blue, across y green, across z red: 1280 points each.
        face = np.abs(scan.xyz).argmax(axis=1)
        np.testing.assert_array_equal(scan.color, 255 * np.eye(3, dtype=np.uint8)[2 - face])
        assert np.bincount(face).tolist() == [2560, 2560, 2560]


def test_every_storage_of_the_bunny_agrees(shared: Path) -> None:
    exact = read_scan(read_headers(shared / E57 / "bunnyDouble.e57")[0]).xyz
    for name, tolerance in (("bunnyFloat", 1e-7), ("bunnyInt32", 1e-7), ("bunnyInt19", 1e-6)):
        other = read_scan(read_headers(shared / E57 / f"{name}.e57")[0]).xyz
        np.testing.assert_allclose(other, exact, atol=tolerance)


def test_intensity_is_scaled_by_the_stated_limits(shared: Path) -> None:
    for name in ("integer_intensity", "scaled_integer_intensity"):
        scan = read_scan(read_headers(shared / E57 / f"{name}.e57")[0])
        assert scan.intensity.tolist() == [0.0, 1.0]
    path = shared / "data/pump-room/pumpAVisualReferenceImage.e57"
    other = by_pye57(path, 0)["intensity"]  # pye57 applies the scale that makes 32767 one
    np.testing.assert_allclose(read_scan(read_headers(path)[0]).intensity, other, atol=1e-6)


def test_a_real_structured_scan(shared: Path) -> None:
    path = shared / "data/pump-room/pumpAVisualReferenceImage.e57"
    [found] = read_headers(path)
    assert (found.points, found.grid, found.photos, found.name) == (155_201, (1074, 345), 1, "pumpA")
    assert found.has_color and found.has_intensity and found.origin_stated and found.units == "m"
    assert found.file_pose is None
    scan = read_scan(found)
    other = by_pye57(path, 0)
    np.testing.assert_allclose(scan.xyz, other["xyz"], atol=5e-7)
    np.testing.assert_array_equal(scan.row, other["rowIndex"])
    np.testing.assert_array_equal(scan.column, other["columnIndex"])
    [photo] = read_photos(found)
    assert (photo.camera.kind, photo.camera.width, photo.camera.height) == ("visual-reference", 3072, 2304)
    assert photo.data[:3] == b"\xff\xd8\xff" and photo.data.rstrip(b"\0")[-2:] == b"\xff\xd9"
    assert photo.station_from_camera is None


def test_poses_are_those_of_the_file(shared: Path) -> None:
    [found] = read_headers(shared / E57 / "translationWithoutRotation.e57")
    expected = np.eye(4)
    expected[:3, 3] = [4.0, 5.0, 6.0]
    np.testing.assert_array_equal(found.file_pose, expected)
    assert read_headers(shared / E57 / "A4.e57")[0].file_pose is None


def test_pictures_of_all_four_kinds(shared: Path) -> None:
    path = shared / E57 / "tiny_pc_and_images.e57"
    [found] = read_headers(path)
    assert [photo.data for photo in read_photos(found)] == pictures_by_pye57(path)
    photos = {photo.camera.kind: photo for photo in read_photos(found)}
    assert found.photos == len(photos) == 4
    assert photos["visual-reference"].encoding == "jpeg"
    assert all(photos[kind].encoding == "png" for kind in ("spherical", "pinhole", "cylindrical"))
    for photo in photos.values():
        assert (photo.camera.width, photo.camera.height) == (100, 100)
    pinhole = photos["pinhole"].camera
    assert pinhole.focal == pytest.approx((123.0 / 0.044, 123.0 / 0.033))
    assert pinhole.centre == (23.0, 42.0)
    assert photos["spherical"].camera.pixel_angle == (0.0314, 0.0314)
    cylindrical = photos["cylindrical"].camera
    assert cylindrical.pixel_angle == pytest.approx((0.044, 0.033 / 666.0))
    assert cylindrical.focal[1] == pytest.approx(666.0 / 0.033)
    assert cylindrical.centre[1] == 42.0
    # The spherical picture has the quaternion (0.5, 1, 0, 0), which is not of unit length, and (1, 2, 3).
    # Its frame has x along the view and z up; ours has z along the view and y down.
    angle = 2.0 * np.arctan2(1.0, 0.5)
    up = [0.0, -np.sin(angle), np.cos(angle)]
    pose = photos["spherical"].station_from_camera
    np.testing.assert_allclose(pose[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 1], np.negative(up), atol=1e-12)
    np.testing.assert_array_equal(pose[:3, 3], [1.0, 2.0, 3.0])
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


def test_extensions_are_named_and_do_no_harm(shared: Path) -> None:
    [found] = read_headers(shared / E57 / "tiny_pc_with_extension.e57")
    assert "fields not used: nor:normalX, nor:normalY, nor:normalZ" in found.notes
    [found] = read_headers(shared / E57 / "las2e57_no_images_tag.e57")
    assert any("las:fileSourceId" in note for note in found.notes)


@pytest.mark.parametrize(
    ("folder", "name", "words"),
    [
        ("e57-bad", "bad-crc", "checksum"),
        ("e57-bad", "corrupt_crc", "checksum"),
        ("e57-bad", "empty", "no scans"),
        ("e57-bad", "read_error", "none of its 2651 points is a measurement"),
        ("e57", "PinholeImageWithDistortionParameters", "no scans"),
        ("e57", "test filename äöü", "no scans"),
    ],
)
def test_files_without_a_usable_scan_say_why(shared: Path, folder: str, name: str, words: str) -> None:
    path = shared / "data/formats" / folder / f"{name}.e57"
    with pytest.raises(InputError, match=words) as caught:
        read_scan(read_headers(path)[0])
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "name", ["e57/ZeroPoints", "e57-bad/ZeroPointsInvalid", "e57-bad/InvalidCVHeader", "e57-bad/empty_pc"]
)
def test_scans_that_promise_no_points_are_empty(shared: Path, name: str) -> None:
    [found] = read_headers(shared / f"data/formats/{name}.e57")
    assert found.points == 0 and len(read_scan(found)) == 0


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Two scans of 3,000 points on a grid, with colour and intensity."""
    rng = np.random.default_rng(1)

    def scan(name: str) -> E57Scan:
        return E57Scan(
            name=name,
            xyz=rng.normal(0.0, 10.0, (3000, 3)).astype(np.float32),
            intensity=rng.random(3000, dtype=np.float32),
            color=rng.integers(0, 256, (3000, 3), dtype=np.uint8),
            row=np.arange(3000, dtype=np.int32) % 50,
            column=np.arange(3000, dtype=np.int32) // 50,
        )

    path = tmp_path / "small.e57"
    write_e57(path, [scan("one"), scan("two")])
    return path


def read_all(path: Path) -> list[np.ndarray]:
    return [read_scan(found).xyz for found in read_headers(path)]


def test_a_file_cut_short_anywhere_is_refused(small: Path, tmp_path: Path) -> None:
    data = small.read_bytes()
    rng = np.random.default_rng(2)
    for size in [*range(0, len(data), 1024), *rng.integers(1, len(data), 40)]:
        cut = tmp_path / "cut.e57"
        cut.write_bytes(data[:size])
        with pytest.raises(InputError):
            read_all(cut)


def test_a_changed_byte_anywhere_is_noticed_or_harmless(small: Path, tmp_path: Path) -> None:
    data = small.read_bytes()
    good = read_all(small)
    rng = np.random.default_rng(3)
    noticed = 0
    for at in rng.integers(0, len(data), 200):
        changed = bytearray(data)
        changed[at] ^= 1 << int(rng.integers(8))
        broken = tmp_path / "broken.e57"
        broken.write_bytes(changed)
        try:
            points = read_all(broken)
        except InputError:
            noticed += 1
            continue
        for one, other in zip(points, good, strict=True):
            np.testing.assert_array_equal(one, other)
    assert noticed > 180


@pytest.mark.parametrize("promised", [3001, 4000, 10**6, 10**12, 2**63, 2**64 - 1])
def test_a_lying_record_count_is_refused_at_once(small: Path, tmp_path: Path, promised: int) -> None:
    text = xml(small).replace('recordCount="3000"', f'recordCount="{promised}"')
    lying = with_xml(small, text, tmp_path / "lying.e57")
    headers = read_headers(lying)
    started = time.process_time()
    for found in headers:
        with pytest.raises(InputError, match="promises"):
            read_scan(found)
    assert time.process_time() - started < 1.0


def test_fields_that_lie_about_their_width_are_refused(small: Path, tmp_path: Path) -> None:
    text = xml(small).replace(
        '<colorRed type="Integer" minimum="0" maximum="255"', '<colorRed type="Integer" minimum="0"'
    )
    assert text != xml(small)
    with pytest.raises(InputError, match="points"):
        read_all(with_xml(small, text, tmp_path / "wide.e57"))


def test_points_beyond_the_end_are_refused(small: Path, tmp_path: Path) -> None:
    for offset in (2**63, 2**64 - 1, 1020, 50 * 1024 * 1024, 49):
        text = xml(small).replace('fileOffset="48"', f'fileOffset="{offset}"')
        assert text != xml(small)
        with pytest.raises(InputError):
            read_all(with_xml(small, text, tmp_path / "beyond.e57"))


def test_one_damaged_description_does_not_cost_the_other_scan(small: Path, tmp_path: Path) -> None:
    text = xml(small).replace('<cartesianX type="Float" precision="single"', '<cartesianX type="Complex"', 1)
    first, second = read_headers(with_xml(small, text, tmp_path / "half.e57"))
    assert first.points is None and any("Complex" in note for note in first.notes)
    with pytest.raises(InputError, match="Complex"):
        read_scan(first)
    np.testing.assert_array_equal(read_scan(second).xyz, read_all(small)[1])


def test_numbers_may_have_space_around_them_and_poses_be_rough(small: Path, tmp_path: Path) -> None:
    pose = (
        '<pose type="Structure"><rotation type="Structure"><w type="Float"> 2 </w><x type="Float"/>'
        '<y type="Float"/><z type="Float">\n2.0e0</z></rotation><translation type="Structure">'
        '<x type="Float">+1.5</x><y type="Float">-2</y><z type="Float"/></translation></pose>'
    )
    zero = pose.replace(" 2 ", "0").replace("\n2.0e0", "0")
    text = xml(small).replace("<points ", pose + "<points ", 1)
    first, second = read_headers(with_xml(small, text, tmp_path / "rough.e57"))
    expected = np.array([[0.0, -1, 0, 1.5], [1, 0, 0, -2], [0, 0, 1, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(first.file_pose, expected, atol=1e-12)
    assert any("quaternion" in note for note in first.notes)
    assert second.file_pose is None
    text = xml(small).replace("<points ", zero + "<points ", 1)
    first, _ = read_headers(with_xml(small, text, tmp_path / "zero.e57"))
    assert first.file_pose is None and any("no rigid motion" in note for note in first.notes)


def test_large_coordinates_keep_their_tenth_of_a_millimetre(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    xyz = rng.uniform(-30.0, 30.0, (2000, 3)) + np.array([512_345.6, 5_412_345.6, 310.0])
    path = tmp_path / "large.e57"
    write_e57(path, [E57Scan("large", xyz)])
    options = ReadOptions(scanner_origin=(512_345.6, 5_412_345.6, 310.0))
    [found] = read_headers(path, options)
    scan = read_scan(found, options)
    np.testing.assert_allclose(scan.xyz.astype(np.float64) + scan.local_origin, xyz, atol=1e-5)
    with pytest.raises(InputError, match="scanner-origin"):
        read_scan(read_headers(path)[0])


def test_not_a_number_infinity_and_the_origin_are_no_points(tmp_path: Path) -> None:
    holes = {101.5: np.nan, 102.5: np.inf, 103.5: -np.inf}
    xyz = np.ones((10, 3), np.float32)
    xyz[2] = 0.0
    for place, stand_in in enumerate(holes):
        xyz[3 + place, place] = stand_in
    path = tmp_path / "holes.e57"
    write_e57(path, [E57Scan("holes", xyz)])
    data = content(path)
    for stand_in, hole in holes.items():
        assert data.count(np.float32(stand_in).tobytes()) == 1
        data = data.replace(np.float32(stand_in).tobytes(), np.float32(hole).tobytes())
    path.write_bytes(seal(data))
    scan = read_scan(read_headers(path)[0])
    np.testing.assert_array_equal(scan.xyz, np.ones((6, 3), np.float32))
    assert any("3 points with NaN" in note for note in scan.header.notes)
    assert any("1 records at (0, 0, 0)" in note for note in scan.header.notes)


def test_what_the_other_writer_writes_reads_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    count = 20_000
    rows, columns = np.divmod(np.arange(count), 200)
    fields = {
        **{f"cartesian{axis}": rng.normal(0.0, 20.0, count) for axis in "XYZ"},
        **{f"color{name}": rng.integers(0, 256, count, dtype=np.uint8) for name in ("Red", "Green", "Blue")},
        "intensity": rng.uniform(10.0, 2000.0, count).astype(np.float32),
        "rowIndex": (rows + 7).astype(np.uint16),
        "columnIndex": (columns + 3).astype(np.uint16),
        "cartesianInvalidState": (rng.random(count) < 0.3).astype(np.int8) * 2,
    }
    path = tmp_path / "other.e57"
    rotation = np.array([0.5, 0.5, 0.5, 0.5])
    with pye57.E57(str(path), mode="w") as other:
        other.write_scan_raw(fields, name="Büro 3", rotation=rotation, translation=np.array([1.0, 2.0, 3.0]))
    [found] = read_headers(path)
    assert (found.name, found.grid) == ("Büro 3", (100, 200))
    np.testing.assert_allclose(found.file_pose @ [1, 0, 0, 1], [1, 3, 3, 1])
    scan = read_scan(found)
    keep = fields["cartesianInvalidState"] == 0
    np.testing.assert_allclose(
        scan.xyz, np.column_stack([fields[f"cartesian{axis}"] for axis in "XYZ"])[keep], rtol=1e-6
    )
    raw = fields["intensity"]
    np.testing.assert_allclose(scan.intensity, ((raw - raw.min()) / np.ptp(raw))[keep], atol=1e-6)
    np.testing.assert_array_equal(scan.row, rows[keep])
    np.testing.assert_array_equal(scan.column, columns[keep])


def test_headers_do_not_read_the_points(small: Path, tmp_path: Path) -> None:
    """Checksums of the points are broken: the headers come all the same, the points do not."""
    data = bytearray(small.read_bytes())
    _, offset, _ = header(small)
    for page in range(1, offset // 1024):
        data[page * 1024 + 100] ^= 0xFF
    broken = tmp_path / "broken.e57"
    broken.write_bytes(data)
    assert [found.points for found in read_headers(broken)] == [3000, 3000]
    with pytest.raises(InputError, match="checksum"):
        read_all(broken)


def test_a_stream_that_spans_packets_is_whole(small: Path, tmp_path: Path) -> None:
    """Cut the first scan's packet in two at a place where no field ends at a whole value."""
    data = content(small)
    at = 48 + 32
    assert data[at] == 1
    count = int.from_bytes(data[at + 4 : at + 6], "little")
    sizes = [int.from_bytes(data[at + 6 + 2 * i : at + 8 + 2 * i], "little") for i in range(count)]
    length = int.from_bytes(data[at + 2 : at + 4], "little") + 1
    streams, start = [], at + 6 + 2 * count
    for size in sizes:
        streams.append(data[start : start + size])
        start += size
    cuts = [size // 3 + 1 for size in sizes]
    packets = b""
    for parts in (
        [stream[:cut] for stream, cut in zip(streams, cuts, strict=True)],
        [stream[cut:] for stream, cut in zip(streams, cuts, strict=True)],
    ):
        body = b"".join(len(part).to_bytes(2, "little") for part in parts) + b"".join(parts)
        body += bytes(-(len(body) + 6) % 4)
        packets += bytes([1, 0]) + (len(body) + 5).to_bytes(2, "little") + count.to_bytes(2, "little") + body
        packets += bytes([2, 0, 3, 0])  # an ignored packet between them
    # The first section alone, at its old place; only its length changes.
    rest = int.from_bytes(data[56:64], "little") - 32 - length
    assert rest >= 0
    section = bytearray(data[48:80])
    section[8:16] = (32 + len(packets) + rest).to_bytes(8, "little")
    body = data[:48] + bytes(section) + packets + data[at + length : at + length + rest]
    text = xml(small)
    second = text.index("<vectorChild", text.index("<vectorChild") + 1)
    text = text[:second] + text[text.index("</data3D>") :]
    start = len(body)
    head = bytearray(body + text.encode())
    total = -(-len(head) // 1020) * 1024
    for place, value in ((16, total), (24, start // 1020 * 1024 + start % 1020), (32, len(text.encode()))):
        head[place : place + 8] = value.to_bytes(8, "little")
    path = tmp_path / "cut.e57"
    path.write_bytes(seal(bytes(head)))
    assert logical(48) == 48
    [found] = read_headers(path)
    scan, whole = read_scan(found), read_scan(read_headers(small)[0])
    np.testing.assert_array_equal(scan.xyz, whole.xyz)
    np.testing.assert_array_equal(scan.row, whole.row)
    np.testing.assert_array_equal(scan.color, whole.color)
