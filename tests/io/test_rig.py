"""Rig files: what was written is read, Eq. (1) makes the points, and what is wrong is named."""

import io
import json
import math
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from trihedral.errors import InputError
from trihedral.fusion.rig import LineScanner, Profiles, RigCamera
from trihedral.io import (
    ReadOptions,
    detect,
    find_inputs,
    parts,
    read_cameras,
    read_headers,
    read_photos,
    read_scan,
)
from trihedral.io.camera import read_camera, read_pairs, write_camera
from trihedral.io.rig import write_rig
from trihedral.job.inputs import SourceFile
from trihedral.scan import CameraModel

CAMERA = CameraModel("pinhole", 64, 48, (50.0, 51.0), (31.0, 24.5), (-0.1, 0.02, 0.001, 0.0, 0.0))
TURNS = np.radians(np.arange(0.0, 360.0, 10.0))
BEAMS = np.radians(np.linspace(-90, 90, 19))


def mounting(yaw: float, lean: float = 0.0, shift: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("zx", [yaw, lean]).as_matrix()
    pose[0, 3] = shift
    return pose


def profiles(yaw: float = 0.0, name: str = "line-1", seed: int = 1, lean: float = 0.0) -> Profiles:
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(1, 30, (len(TURNS), len(BEAMS))).astype(np.float32)
    ranges[rng.random(ranges.shape) < 0.1] = 0.0
    scanner = LineScanner(name, 0.2, 1.3, mounting(yaw, lean))
    return Profiles(scanner, TURNS + 0.01 * seed, BEAMS, ranges, rng.random(ranges.shape).astype(np.float32))


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    picture = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    camera = RigCamera("front", CAMERA, mounting(0.0, shift=0.1))
    path = tmp_path / "site" / "one.toml"
    path.parent.mkdir()
    write_rig(path, "one", [profiles()], camera, [(picture, 0.0), (picture, math.pi / 2)])
    return path


def test_points_are_those_of_equation_1(rig: Path) -> None:
    (header,) = read_headers(rig)
    scan = read_scan(header)
    assert (header.format, header.name, header.grid) == ("rig", "one", (19, 36))
    assert header.points == 19 * 36
    assert header.scanner_origin == pytest.approx([0.0, 0.0, 1.3])
    assert any("0.200 m from the axis" in note for note in header.notes)
    data = profiles()
    expected = {}
    for i, turn in enumerate(data.body_angles):
        for j, beam in enumerate(BEAMS):
            r = float(data.ranges[i, j])
            if r:
                c1, s1, c2, s2 = math.cos(turn), math.sin(turn), math.cos(beam), math.sin(beam)
                expected[(18 - j, i)] = (r * c1 * c2 + 0.2 * c1, r * s1 * c2 + 0.2 * s1, r * s2 + 1.3)
    assert len(scan) == len(expected)
    for xyz, row, column in zip(scan.xyz, scan.row, scan.column, strict=True):
        assert xyz == pytest.approx(expected[(int(row), int(column))], abs=1e-4)
    assert scan.intensity is not None
    assert 0.0 <= scan.intensity.min() <= scan.intensity.max() <= 1.0


def test_pictures_are_where_the_body_was(rig: Path) -> None:
    (header,) = read_headers(rig)
    first, second = read_photos(header)
    assert header.photos == 2
    assert [name for name, _ in read_cameras(header)] == ["one-00", "one-01"]
    assert first.camera == CAMERA
    assert first.station_from_camera == pytest.approx(mounting(0.0, shift=0.1))
    turned = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    assert second.station_from_camera[:3, 3] == pytest.approx(turned @ [0.1, 0, 0], abs=1e-12)
    assert second.station_from_camera[:3, :3] == pytest.approx(turned, abs=1e-12)


def test_scanners_on_four_arms_interleave(tmp_path: Path) -> None:
    step = TURNS[1]
    four = []
    for k in range(4):
        one = profiles(k * math.pi / 2, f"line-{k}", seed=k)
        four.append(Profiles(one.scanner, TURNS + k * step / 4, BEAMS, one.ranges + 1.0))
    write_rig(tmp_path / "four.toml", "four", four)
    scan = read_scan(read_headers(tmp_path / "four.toml")[0])
    assert scan.header.grid == (19, 144)
    level = scan.row == 9
    azimuth = np.degrees(np.arctan2(scan.xyz[level, 1], scan.xyz[level, 0]))[np.argsort(scan.column[level])]
    steps = np.mod(np.diff(azimuth), 360.0)
    assert steps == pytest.approx(np.full(143, 2.5), abs=0.1)


def test_scanners_that_look_differently_stay_apart(tmp_path: Path) -> None:
    both = [profiles(0.0, "up", 1), profiles(0.0, "leaning", 2, lean=0.6)]
    write_rig(tmp_path / "two.toml", "two", both)
    scan = read_scan(read_headers(tmp_path / "two.toml")[0])
    counts = [int(np.count_nonzero(one.ranges)) for one in both]
    assert (scan.column[: counts[0]] < 36).all()
    assert (scan.column[counts[0] :] >= 36).all()


def test_a_csv_of_profiles_reads_like_an_archive(rig: Path) -> None:
    archive = read_scan(read_headers(rig)[0])
    data = profiles()
    rows = ["body_angle_deg," + ",".join(repr(float(b)) for b in np.degrees(BEAMS))]
    for turn, ranges in zip(np.degrees(data.body_angles), data.ranges, strict=True):
        rows.append(",".join([repr(float(turn)), *(repr(float(r)) for r in ranges)]))
    (rig.parent / "one-line-1.csv").write_text("\n".join(rows) + "\n")
    rig.write_text(
        rig.read_text(encoding="utf-8").replace("one-line-1.npz", "one-line-1.csv"), encoding="utf-8"
    )
    table = read_scan(read_headers(rig)[0])
    assert np.array_equal(table.xyz, archive.xyz)
    assert np.array_equal(table.column, archive.column)
    assert table.intensity is None


def test_a_folder_of_rigs_is_a_folder_of_scans(rig: Path) -> None:
    write_rig(rig.with_name("two.toml"), "two", [profiles(seed=2)])
    write_camera(rig.with_name("camera.toml"), "front", CAMERA)
    (rig.parent / "table.csv").write_text("body_angle_deg,-1,0,1\n0,1,1,1\n1,1,1,1\n2,1,1,1\n")
    (rig.parent / "truth.json").write_text("{}")
    assert [path.name for path in find_inputs([rig.parent])] == ["one.toml", "two.toml"]
    assert detect(rig) == "rig"


def test_a_hand_written_rig_with_mountings_in_degrees(rig: Path) -> None:
    write_camera(rig.with_name("camera.toml"), "front", CAMERA)
    rig.write_text(
        'format = "trihedral-rig/1"\n'
        "project_from_station = [[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]\n"
        "[[scanner]]\nd_m = 0.2\nh_m = 1.3\nprofiles = 'one-line-1.npz'\n"
        "mounting = {turn_deg = [10, 20, 30], shift_m = [0, 0, 0.1]}\n"
        "[[camera]]\nname = 'front'\nfile = 'camera.toml'\n"
        "mounting = {position_m = [0, 0, 1.6], heading_deg = 90}\n"
        "[[picture]]\nfile = 'one-00.jpg'\nbody_angle_deg = 0\n",
        encoding="utf-8",
    )
    (header,) = read_headers(rig)
    assert header.name == "one"
    assert header.file_pose[:3, 3] == pytest.approx([5, 6, 7])
    turn = Rotation.from_euler("ZYX", [30, 20, 10], degrees=True).as_matrix()
    data = profiles()
    first = int(np.flatnonzero(data.ranges.ravel())[0])
    i, j = divmod(first, len(BEAMS))
    r = data.ranges[i, j]
    own = np.array([r * math.cos(BEAMS[j]) + 0.2, 0.0, r * math.sin(BEAMS[j]) + 1.3])
    point = Rotation.from_euler("z", data.body_angles[i]).apply(turn @ own + [0, 0, 0.1])
    assert read_scan(header).xyz[0] == pytest.approx(point, abs=1e-4)
    (photo,) = read_photos(header)
    assert photo.station_from_camera[:3, 2] == pytest.approx([0, 1, 0], abs=1e-12)


def test_units_are_metres_whatever_is_asked(rig: Path) -> None:
    asked = read_headers(rig, ReadOptions(units="mm"))[0]
    assert (asked.units, asked.units_stated) == ("m", True)
    assert any("mm was asked for" in note for note in asked.notes)
    assert np.array_equal(read_scan(asked, ReadOptions(units="mm")).xyz, read_scan(read_headers(rig)[0]).xyz)


def test_the_hash_of_a_rig_covers_what_it_names(rig: Path) -> None:
    assert [path.name for path in parts(rig)] == ["one-line-1.npz", "one-00.jpg", "one-01.jpg"]
    before = SourceFile.of(rig).sha256()
    data = bytearray((rig.parent / "one-01.jpg").read_bytes())
    data[-3] ^= 1
    (rig.parent / "one-01.jpg").write_bytes(bytes(data))
    assert SourceFile.of(rig).sha256() != before


def archive_with(rig: Path, **changes: object) -> None:
    data = profiles()
    arrays: dict[str, object] = {
        "body_angle_deg": np.degrees(data.body_angles),
        "beam_angle_deg": np.degrees(BEAMS),
        "range_m": data.ranges.copy(),
    }
    arrays |= changes
    np.savez(
        rig.parent / "one-line-1.npz", **{key: value for key, value in arrays.items() if value is not None}
    )


def ranges_with(value: float) -> np.ndarray:
    ranges = profiles().ranges.copy()
    ranges[4, 7] = value
    return ranges


@pytest.mark.parametrize(
    "changes, place, reason",
    [
        (
            {"body_angle_deg": np.arange(35.0)},
            "range_m, body_angle_deg",
            "there are 36 profiles and 35 body angles",
        ),
        (
            {"beam_angle_deg": np.arange(20.0)},
            "range_m, beam_angle_deg",
            "have 19 beams, there are 20 beam angles",
        ),
        ({"range_m": ranges_with(math.nan)}, "range_m, profile 5, beam 8", "the range is nan"),
        ({"range_m": ranges_with(-2.5)}, "range_m, profile 5, beam 8", "the range is -2.5"),
        ({"range_m": ranges_with(math.inf)}, "range_m, profile 5, beam 8", "the range is inf"),
        ({"range_m": np.zeros(12)}, "range_m", "it has the shape (12,)"),
        ({"range_m": None}, "range_m", "it is missing"),
        ({"beam_angle_deg": np.full(19, math.nan)}, "beam_angle_deg", "angle 1 is nan"),
        ({"beam_angle_deg": np.zeros(19)}, "beam_angle_deg", "two beams have the same angle"),
        ({"intensity": np.zeros((3, 3))}, "intensity, body_angle_deg", "there are 3 profiles"),
        ({"range_m": np.array([["a", "b"]])}, "", "not numbers"),
        ({"range_m": np.zeros((36, 19))}, "range_m", "none of its beams had a return"),
    ],
)
def test_profiles_that_cannot_be(rig: Path, changes: dict[str, object], place: str, reason: str) -> None:
    archive_with(rig, **changes)
    with pytest.raises(InputError) as error:
        read_scan(read_headers(rig)[0])
    assert error.value.path.name in ("one-line-1.npz", "one.toml")
    assert place in error.value.place
    assert reason in str(error.value)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.9, 0.99])
def test_an_archive_cut_short(rig: Path, share: float) -> None:
    path = rig.parent / "one-line-1.npz"
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError, match=r"one-line-1.npz: the archive is cut short or damaged"):
        read_headers(rig)


def test_an_archive_with_flipped_bytes(rig: Path) -> None:
    path = rig.parent / "one-line-1.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match="cut short or damaged"):
        read_scan(read_headers(rig)[0])


def test_an_archive_that_claims_to_be_huge_is_refused_unread(rig: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**7, 10**7)}
    )
    with zipfile.ZipFile(rig.parent / "one-line-1.npz", "w") as archive:
        for name in ("body_angle_deg", "beam_angle_deg", "range_m"):
            archive.writestr(f"{name}.npy", header.getvalue() + b"\0" * 800)
    with pytest.raises(InputError, match="not as large as its shape"):
        read_headers(rig)


@pytest.mark.parametrize(
    "text, place, reason",
    [
        ("", "", "the file is empty"),
        ("hello,1,2\n", "line 1", "begins with body_angle_deg"),
        ("body_angle_deg,0,1\n1,2\n", "line 2", "it has 1 ranges, there are 2 beam angles"),
        ("body_angle_deg,0,1\n1,2,x\n", "line 2", "a cell is no number"),
        ("body_angle_deg,0,1\n", "line 2", "it holds no profiles"),
        ("body_angle_deg,0,1\n1,2,-3\n", "range_m, profile 1, beam 2", "the range is -3.0"),
    ],
)
def test_tables_that_cannot_be(rig: Path, text: str, place: str, reason: str) -> None:
    (rig.parent / "one-line-1.npz").write_text(text)
    with pytest.raises(InputError) as error:
        read_scan(read_headers(rig)[0])
    assert error.value.path.name == "one-line-1.npz"
    assert error.value.place == place
    assert reason in error.value.reason


def edited(rig: Path, pattern: str, replacement: str) -> None:
    text, count = re.subn(pattern, replacement, rig.read_text(encoding="utf-8"), count=1)
    assert count == 1
    rig.write_text(text, encoding="utf-8")


def remove(name: str) -> Callable[[Path], None]:
    return lambda rig: (rig.parent / name).unlink()


@pytest.mark.parametrize(
    "change, file, place, reason",
    [
        (lambda rig: edited(rig, r"focal_px.*\n", ""), "one.toml", "camera 1, focal_px", "missing"),
        (
            lambda rig: edited(rig, r"focal_px = \[50.0", "focal_px = [-1.0"),
            "one.toml",
            "camera 1, focal_px",
            "positive",
        ),
        (lambda rig: edited(rig, r"d_m = .*\n", ""), "one.toml", "scanner 1, d_m", "missing"),
        (
            lambda rig: edited(rig, r"h_m = .*\n", "h_m = nan\n"),
            "one.toml",
            "scanner 1, h_m",
            "not a finite number",
        ),
        (
            lambda rig: edited(rig, r"h_m = .*\n", "h_m = 'tall'\n"),
            "one.toml",
            "scanner 1, h_m",
            "not a finite",
        ),
        (
            lambda rig: edited(rig, r'camera = "front"', 'camera = "rear"'),
            "one.toml",
            "picture 1, camera",
            "no camera 'rear'",
        ),
        (
            lambda rig: edited(rig, r"width = 64", "width = 65"),
            "one-00.jpg",
            "width, height",
            "64 x 48 pixels, its camera is calibrated for 65 x 48",
        ),
        (lambda rig: edited(rig, r"\[\[picture\]\]", "[picture]"), "one.toml", "", "no valid TOML"),
        (
            lambda rig: edited(rig, r"trihedral-rig/1", "trihedral-rig/9"),
            "one.toml",
            "format",
            "'trihedral-rig/9'",
        ),
        (
            lambda rig: edited(rig, r"\[1.0, 0.0, 0.0, 0.0\]", "[2.0, 0.0, 0.0, 0.0]"),
            "one.toml",
            "scanner 1, body_from_mounting",
            "no rigid motion",
        ),
        (
            remove("one-line-1.npz"),
            "one-line-1.npz",
            "scanner 1, profiles",
            "no such file; one.toml names it",
        ),
        (remove("one-01.jpg"), "one-01.jpg", "", "no such file"),
    ],
)
def test_rig_files_that_cannot_be(
    rig: Path, change: Callable[[Path], None], file: str, place: str, reason: str
) -> None:
    change(rig)
    with pytest.raises(InputError) as error:
        (header,) = read_headers(rig)
        read_scan(header)
        read_photos(header)
    assert error.value.path.name == file
    assert error.value.place == place
    assert reason in str(error.value)


def test_a_picture_of_another_kind(rig: Path) -> None:
    Image.new("RGB", (64, 48)).save(rig.parent / "one-00.jpg", format="BMP")
    with pytest.raises(InputError, match=r"one-00.jpg: it is no JPEG or PNG picture .*Use JPEG or PNG"):
        read_photos(read_headers(rig)[0])
    (rig.parent / "one-00.jpg").write_bytes(b"\xff\xd8 no picture")
    with pytest.raises(InputError, match="no JPEG or PNG picture that can be read"):
        read_photos(read_headers(rig)[0])


@pytest.mark.parametrize(
    "camera",
    [
        CAMERA,
        CameraModel("spherical", 720, 360, pixel_angle=(math.radians(0.5), math.radians(0.5))),
        CameraModel(
            "cylindrical",
            720,
            300,
            (720 / (2 * math.pi), 110.0),
            (359.5, 140.0),
            (),
            (2 * math.pi / 720, 1 / 110.0),
        ),
    ],
    ids=lambda camera: camera.kind,
)
def test_camera_files_keep_what_they_are_given(tmp_path: Path, camera: CameraModel) -> None:
    path = tmp_path / "camera.toml"
    write_camera(path, 'a "camera"', camera, mounting(0.3, 0.1), ["a note"])
    found = read_camera(path)
    assert found.name == 'a "camera"'
    assert found.model.kind == camera.kind
    for field in ("width", "height", "focal", "centre", "distortion", "pixel_angle"):
        expected = getattr(camera, field)
        assert getattr(found.model, field) == (expected if expected is None else pytest.approx(expected))
    assert found.body_from_camera == pytest.approx(mounting(0.3, 0.1))


def test_a_camera_file_lists_pictures(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    write_camera(path, "front", CAMERA, mounting(0.0, shift=0.2))
    poses = json.dumps(mounting(1.0).tolist())
    with path.open("a") as stream:
        stream.write("[[picture]]\nfile = 'a.jpg'\nbody_angle_deg = 90\n")
        stream.write(f"[[picture]]\nfile = 'b.jpg'\nstation_from_camera = {poses}\n")
    (a, pose_a), (b, pose_b) = read_camera(path).pictures
    assert (a.name, b.name) == ("a.jpg", "b.jpg")
    assert pose_a[:3, 3] == pytest.approx([0, 0.2, 0], abs=1e-12)
    assert pose_b == pytest.approx(mounting(1.0))


def test_a_camera_file_is_no_scan(tmp_path: Path) -> None:
    write_camera(tmp_path / "camera.toml", "front", CAMERA)
    with pytest.raises(InputError, match="it is a camera file, not a scan"):
        detect(tmp_path / "camera.toml")


def test_pairs(tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text("x,y,z,column,row\n1,2,3,4,5\n# a comment\n6;7;8;9;10\n")
    points, pixels = read_pairs(path)
    assert points.tolist() == [[1, 2, 3], [6, 7, 8]]
    assert pixels.tolist() == [[4, 5], [9, 10]]
    path.write_text("1,2,3,4,5\n1,2,3,4\n")
    with pytest.raises(InputError, match=r"pairs.csv, line 2: it is not five finite numbers"):
        read_pairs(path)


def test_a_rig_is_moved_with_its_files(rig: Path, tmp_path: Path) -> None:
    shutil.copytree(rig.parent, tmp_path / "elsewhere")
    moved = read_scan(read_headers(tmp_path / "elsewhere" / "one.toml")[0])
    assert np.array_equal(moved.xyz, read_scan(read_headers(rig)[0]).xyz)
