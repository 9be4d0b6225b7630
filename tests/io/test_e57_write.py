from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pye57
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.e57_files import JPEG, cameras, motion
from support.e57_pages import check_checksums
from trihedral import atomic
from trihedral.errors import OutputError
from trihedral.io import read_headers, read_photos, read_scan
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.scan import CameraModel, Photo


@st.composite
def scans(draw: st.DrawFn) -> E57Scan:
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    count = draw(st.sampled_from([0, 1, 2, 7, 100, 5000]))
    structured = draw(st.booleans())
    rows = draw(st.integers(1, 400))
    return E57Scan(
        name=draw(st.text(max_size=20)),
        xyz=rng.uniform(-50.0, 50.0, (count, 3)).astype(draw(st.sampled_from([np.float32, np.float64]))),
        pose=motion(rng) if draw(st.booleans()) else None,
        intensity=rng.random(count, dtype=np.float32) if draw(st.booleans()) else None,
        color=rng.integers(0, 256, (count, 3), dtype=np.uint8) if draw(st.booleans()) else None,
        row=(np.arange(count) % rows).astype(np.int32) if structured else None,
        column=(np.arange(count) // rows).astype(np.int32) if structured else None,
        invalid=rng.random(count) < draw(st.sampled_from([0.0, 0.3, 1.0])) if draw(st.booleans()) else None,
    )


TOLERANCE = {"single": 4e-6, "double": 4e-6, "auto": 4e-6, "scaled": 9e-6}  # read back as float32


@settings(max_examples=60, deadline=None)
@given(written=st.lists(scans(), min_size=1, max_size=3), precision=st.sampled_from(list(TOLERANCE)))
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, written: list, precision: str
) -> None:
    path = tmp_path_factory.mktemp("e57") / "scans.e57"
    write_e57(path, written, precision=precision)
    check_checksums(path) if path.stat().st_size < 200_000 else None
    headers = read_headers(path)
    assert len(headers) == len(written)
    for found, scan in zip(headers, written, strict=True):
        back = read_scan(found)
        keep = np.ones(len(scan.xyz), bool) if scan.invalid is None else ~scan.invalid
        assert found.points == len(scan.xyz)
        np.testing.assert_allclose(back.xyz, scan.xyz[keep], atol=TOLERANCE[precision])
        if scan.pose is None:
            assert found.file_pose is None
        else:
            np.testing.assert_allclose(found.file_pose, scan.pose, atol=1e-12)
        for field, tolerance in (("intensity", 1e-7), ("color", 0), ("row", 0), ("column", 0)):
            expected, actual = getattr(scan, field), getattr(back, field)
            if expected is None or (field in ("intensity", "color") and not expected[keep].any()):
                assert actual is None
            else:
                np.testing.assert_allclose(actual, expected[keep], atol=tolerance)


@pytest.mark.parametrize("precision", ["single", "double", "scaled"])
def test_the_independent_reader_reads_what_is_written(tmp_path: Path, precision: str) -> None:
    rng = np.random.default_rng(1)
    count = 40_000
    written = E57Scan(
        name="Zimmer <3> & ]]> Ende",
        xyz=rng.uniform(-30.0, 30.0, (count, 3)),
        pose=motion(rng),
        intensity=rng.random(count, dtype=np.float32),
        color=rng.integers(0, 256, (count, 3), dtype=np.uint8),
        row=np.arange(count, dtype=np.int32) % 200,
        column=np.arange(count, dtype=np.int32) // 200,
        invalid=rng.random(count) < 0.2,
    )
    path = tmp_path / "scan.e57"
    write_e57(path, [written, written], precision=precision)
    check_checksums(path)
    other = pye57.E57(str(path))
    assert other.scan_count == 2
    assert len({other.get_header(index).guid for index in range(2)}) == 2
    found = other.get_header(1)
    assert found["name"].value() == written.name
    np.testing.assert_allclose(found.rotation_matrix, written.pose[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(found.translation, written.pose[:3, 3])
    fields = other.read_scan_raw(1)
    np.testing.assert_array_equal(fields["cartesianInvalidState"] != 0, written.invalid)
    keep = ~written.invalid
    xyz = np.column_stack([fields[f"cartesian{axis}"] for axis in "XYZ"])
    step = {"single": 2e-6, "double": 0.0, "scaled": 5.1e-6}[precision]
    np.testing.assert_allclose(xyz[keep], written.xyz[keep], rtol=0, atol=step)
    np.testing.assert_array_equal(fields["intensity"], written.intensity)
    np.testing.assert_array_equal(fields["rowIndex"], written.row)
    np.testing.assert_array_equal(fields["columnIndex"], written.column)
    color = np.column_stack([fields[f"color{name}"] for name in ("Red", "Green", "Blue")])
    np.testing.assert_array_equal(color, written.color)
    assert (found.xMinimum, found.zMaximum) == (
        pytest.approx(written.xyz[keep, 0].min(), abs=1e-5),
        pytest.approx(written.xyz[keep, 2].max(), abs=1e-5),
    )
    assert (found["indexBounds"]["rowMaximum"].value(), found["indexBounds"]["columnMaximum"].value()) == (
        199,
        199,
    )


def test_large_coordinates_are_stored_in_double_precision_by_themselves(tmp_path: Path) -> None:
    xyz = np.random.default_rng(2).uniform(-30.0, 30.0, (100, 3)) + np.array([4e5, 5e6, 300.0])
    path = tmp_path / "large.e57"
    write_e57(path, [E57Scan("large", xyz)])
    fields = pye57.E57(str(path)).read_scan_raw(0)
    np.testing.assert_array_equal(np.column_stack([fields[f"cartesian{axis}"] for axis in "XYZ"]), xyz)


def test_rounding_does_not_shift_the_mean_of_many_points(tmp_path: Path) -> None:
    """2 mm of noise on a plane at 20.00005 m, averaged over 10^5 points, stays where it was."""
    noise = np.random.default_rng(3).normal(0.0, 0.002, 100_000)
    xyz = np.column_stack([20.00005 + noise, np.zeros_like(noise), np.ones_like(noise)])
    path = tmp_path / "plane.e57"
    write_e57(path, [E57Scan("plane", xyz)])
    back = read_scan(read_headers(path)[0])
    assert back.xyz[:, 0].astype(np.float64).mean() == pytest.approx(xyz[:, 0].mean(), abs=1e-7)


def test_pictures_come_back_with_their_cameras(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    photos = [
        Photo(
            f"{kind} photo",
            "png" if kind == "spherical" else "jpeg",
            JPEG + kind.encode(),
            camera,
            motion(rng),
        )
        for kind, camera in cameras().items()
    ]
    loose = Photo("no pose", "jpeg", JPEG, cameras()["pinhole"], None)
    xyz = rng.normal(size=(10, 3)).astype(np.float32)
    path = tmp_path / "photos.e57"
    write_e57(
        path,
        [
            E57Scan("without", xyz),
            E57Scan("with", xyz, pose=motion(rng), photos=photos),
            E57Scan("loose", xyz, pose=motion(rng), photos=[loose]),
        ],
    )
    check_checksums(path)
    headers = read_headers(path)
    assert [found.photos for found in headers] == [0, 4, 1]
    for back, photo in zip(read_photos(headers[1]), photos, strict=True):
        assert (back.name, back.encoding, back.data) == (photo.name, photo.encoding, photo.data)
        np.testing.assert_allclose(back.station_from_camera, photo.station_from_camera, atol=1e-11)
        assert (back.camera.kind, back.camera.width, back.camera.height) == (photo.camera.kind, 640, 480)
        for field in ("focal", "centre", "pixel_angle"):
            expected = getattr(photo.camera, field)
            actual = getattr(back.camera, field)
            assert actual == (expected and pytest.approx(expected, rel=1e-12))
    [back] = read_photos(headers[2])
    assert back.station_from_camera is None


def test_camera_frames_are_those_of_the_standard(tmp_path: Path) -> None:
    """What a pinhole camera sees to its lower right, and a panorama's middle, land where E57 readers look."""
    rng = np.random.default_rng(5)
    project_from_station = motion(rng)
    camera = motion(rng)
    kinds = cameras()
    photos = [Photo(kind, "jpeg", JPEG, kinds[kind], camera) for kind in ("pinhole", "spherical")]
    path = tmp_path / "frames.e57"
    xyz = np.ones((1, 3), np.float32)
    write_e57(path, [E57Scan("scan", xyz, pose=project_from_station, photos=photos)])
    reader = pye57.E57(str(path))
    pinhole, panorama = reader.image_file.root()["images2D"]
    seen = project_from_station @ camera @ [1.0, 2.0, 4.0, 1.0]

    def in_image_frame(image: object) -> np.ndarray:
        pose = image["pose"]
        w, x, y, z = (pose["rotation"][name].value() for name in "wxyz")
        axis = np.array([x, y, z])
        shifted = seen[:3] - [pose["translation"][name].value() for name in "xyz"]
        # The inverse rotation of the unit quaternion, by its vector formula.
        return shifted + 2.0 * np.cross(-axis, np.cross(-axis, shifted) + w * shifted)

    x, y, z = in_image_frame(pinhole)
    model = {name: pinhole["pinholeRepresentation"][name].value() for name in ("focalLength", "pixelWidth")}
    # E57: x to the right, y up, the view along -z; columns grow to the right and rows downwards.
    column = 321.0 + model["focalLength"] / model["pixelWidth"] * x / -z
    assert (column, y / -z) == (pytest.approx(321.0 + 500.0 * 1.0 / 4.0), pytest.approx(-2.0 / 4.0))
    x, y, z = in_image_frame(panorama)
    # E57: the middle of a panorama is on +x, z is up, azimuth grows to the left.
    assert np.arctan2(y, x) == pytest.approx(-np.arctan2(1.0, 4.0))
    assert z == pytest.approx(-2.0)


def test_a_lens_distortion_is_not_lost_in_silence(tmp_path: Path) -> None:
    camera = CameraModel("pinhole", 10, 10, focal=(9.0, 9.0), centre=(4.5, 4.5), distortion=(0.1,))
    scan = E57Scan("scan", np.ones((1, 3)), photos=[Photo("bent", "jpeg", JPEG, camera, None)])
    with pytest.raises(ValueError, match="distortion"):
        write_e57(tmp_path / "bent.e57", [scan])
    assert list(tmp_path.iterdir()) == []


def test_the_same_scans_give_the_same_bytes(tmp_path: Path) -> None:
    xyz = np.random.default_rng(6).normal(size=(1000, 3))
    for name in ("a", "b"):
        write_e57(tmp_path / name, [E57Scan("x", xyz)])
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    write_e57(tmp_path / "c", [E57Scan("x", xyz + 1.0)])
    identities = set()
    for name in ("a", "c"):
        reader = pye57.E57(str(tmp_path / name))
        identities |= {reader.root["guid"].value(), reader.get_header(0).guid}
    assert len(identities) == 4


def test_scans_are_taken_one_at_a_time_and_a_failure_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "out.e57"
    taken = []

    def failing() -> Iterator[E57Scan]:
        for index in range(3):
            # The partial file grows between scans: the one before is written before the next is asked for.
            taken.append(sum(partial.stat().st_size for partial in tmp_path.glob(".*.part")))
            yield E57Scan(str(index), np.full((50_000, 3), 1.0 + index))
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_e57(path, failing())
    assert taken[0] < 2000 < 500_000 < taken[1] < taken[2]
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    path = tmp_path / "missing" / "out.e57"
    with pytest.raises(OutputError, match="No such file or directory") as caught:
        write_e57(path, [E57Scan("x", np.ones((1, 3)))])
    assert str(path) in str(caught.value)


def test_a_full_disk_is_said_to_be_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While the points are written, the unfinished file is a device that is always full."""
    path = tmp_path / "out.e57"
    monkeypatch.setattr(atomic, "part_in", lambda folder: nullcontext(Path("/dev/full")))
    with pytest.raises(OutputError, match="the disk is full"):
        write_e57(path, [E57Scan("x", np.ones((100_000, 3)))])
    assert list(tmp_path.iterdir()) == []


def test_nonsense_is_refused_before_it_is_written() -> None:
    xyz = np.ones((5, 3))
    skewed = np.eye(4)
    skewed[0, 1] = 0.1
    mirrored = np.diag([1.0, 1.0, -1.0, 1.0])
    for fields in (
        {"xyz": np.ones((5, 2))},
        {"xyz": xyz, "intensity": np.ones(4, np.float32)},
        {"xyz": xyz, "color": np.ones((5, 4), np.uint8)},
        {"xyz": xyz, "row": np.zeros(5, np.int32)},
        {"xyz": xyz, "row": np.full(5, -1, np.int32), "column": np.zeros(5, np.int32)},
        {"xyz": xyz, "pose": skewed},
        {"xyz": xyz, "pose": mirrored},
    ):
        with pytest.raises(ValueError, match="scan 'bad'"):
            E57Scan(name="bad", **fields)


def test_points_that_are_no_numbers_are_refused_unless_invalid(tmp_path: Path) -> None:
    xyz = np.ones((3, 3))
    xyz[1, 1] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        write_e57(tmp_path / "nan.e57", [E57Scan("nan", xyz)])
    write_e57(tmp_path / "nan.e57", [E57Scan("nan", xyz, invalid=np.array([False, True, False]))])
    assert len(read_scan(read_headers(tmp_path / "nan.e57")[0])) == 2
