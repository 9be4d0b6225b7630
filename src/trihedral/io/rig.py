"""The raw data of a rotating rig: a TOML that names profiles and pictures; docs/rig.md.

Points are made from ranges and angles by Eq. (1) of Kim, Chen and Cho (2017).
"""

import math
import struct
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import replacing, write_atomically
from trihedral.errors import InputError
from trihedral.fusion.kinematics import profile_points, station_from_body
from trihedral.fusion.rig import LineScanner, Profiles, RigCamera, same_grid
from trihedral.geometry.se3 import Matrix, motion
from trihedral.io.camera import (
    Table,
    camera_lines,
    camera_model,
    camera_place,
    matrix_text,
    quoted,
    read_camera,
    read_toml,
)
from trihedral.io.options import ReadOptions
from trihedral.io.pictures import read_picture
from trihedral.io.scan_builder import unit_intensity
from trihedral.scan import CameraModel, Photo, Scan, ScanHeader

FORMAT = "trihedral-rig/1"
#: First cell of a CSV file of profiles.
CSV_MARK = "body_angle_deg"
#: Deflated data grow by this at the most: what claims to grow more is refused unread.
_LARGEST_GROWTH = 1100
_JPEG_QUALITY = 92
#: Profiles turned into points at a time: what so many need on the way stays in the processor's cache.
_TOGETHER = 64


@dataclass(frozen=True)
class _Line:
    """A line scanner and where its profiles are."""

    scanner: LineScanner
    profiles: Path
    table: Table


@dataclass(frozen=True)
class _Picture:
    path: Path
    camera: RigCamera
    body_angle: float
    name: str


@dataclass(frozen=True)
class _Rig:
    name: str
    lines: list[_Line]
    pictures: list[_Picture]
    project_from_station: Matrix | None


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read what a rig file says, and the angles of its profiles; not the ranges.

    Raises
    ------
    InputError
        If a field is missing or makes no sense, or a file that it names is absent, cut short or does not fit.
    """
    rig = _read(path)
    shapes = [_open_profiles(line).shape for line in rig.lines]
    return [_header(path, rig, shapes, options)]


def _header(path: Path, rig: _Rig, shapes: Sequence[tuple[int, int]], options: ReadOptions) -> ScanHeader:
    notes = []
    if options.units not in (None, "m"):
        notes.append(f"profiles of a rig are in metres; {options.units} was asked for and is not used")
    centres = np.array([line.scanner.centre for line in rig.lines])
    # The body's axis is the station's z axis: on it, at their mean height, the scanners' beams begin on average.
    origin = np.array([0.0, 0.0, centres[:, 2].mean()])
    if options.scanner_origin is not None:
        origin = np.array(options.scanner_origin, dtype=np.float64)
    offset = float(np.hypot(centres[:, 0], centres[:, 1]).max())
    if offset > 0:
        notes.append(f"beams begin up to {offset:.3f} m from the axis; the scanner is taken to be on it")
    return ScanHeader(
        source=path,
        scan_index=0,
        name=rig.name,
        format="rig",
        points=sum(profiles * beams for profiles, beams in shapes),
        grid=(max(beams for _, beams in shapes), sum(profiles for profiles, _ in shapes)),
        has_color=False,
        has_intensity=all(_has_intensity(line) for line in rig.lines),
        photos=len(rig.pictures),
        file_pose=rig.project_from_station,
        scanner_origin=origin,
        origin_stated=True,
        units="m",
        units_stated=True,
        notes=tuple(notes),
    )


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Turn ranges and angles into points. Rows of the grid are beams, from the highest; columns are body angles.

    Raises
    ------
    InputError
        See `read_headers`; and if a range is negative or no number.
    """
    if scan_index != 0:
        raise InputError(path, f"it holds one scan; there is no scan {scan_index}")
    rig = _read(path)
    profiles = read_profiles(rig)
    header = _header(path, rig, [one.ranges.shape for one in profiles], options)
    count = sum(int(np.count_nonzero(one.ranges)) for one in profiles)
    if not count:
        raise InputError(path, "none of its beams had a return", place="range_m")
    xyz = np.empty((count, 3), np.float32)
    row, column = np.empty(count, np.int32), np.empty(count, np.int32)
    intensity = np.empty(count, np.float32) if header.has_intensity else None
    end = 0
    for one, columns in zip(profiles, _columns(profiles), strict=True):
        rows = np.empty(len(one.beam_angles), np.int32)
        rows[np.argsort(-one.beam_angles, kind="stable")] = np.arange(len(rows), dtype=np.int32)
        for first in range(0, len(one.body_angles), _TOGETHER):
            turned = slice(first, first + _TOGETHER)
            ranges = one.ranges[turned]
            returned = ranges > 0
            begin, end = end, end + int(np.count_nonzero(returned))
            points = profile_points(one.scanner, one.body_angles[turned], one.beam_angles, ranges)
            xyz[begin:end] = points[returned]
            row[begin:end] = np.broadcast_to(rows, ranges.shape)[returned]
            column[begin:end] = np.repeat(columns[turned], np.count_nonzero(returned, axis=1))
            if intensity is not None and one.intensity is not None:
                intensity[begin:end] = one.intensity[turned][returned]
    return Scan(
        header=header,
        xyz=xyz,
        local_origin=np.zeros(3),
        intensity=None if intensity is None else unit_intensity(intensity, "rig"),
        row=row,
        column=column,
    )


def _columns(profiles: Sequence[Profiles]) -> list[NDArray[np.int32]]:
    """Give each profile its column: by the direction of its arm where scanners share a grid, else one by one."""
    counts = [len(one.body_angles) for one in profiles]
    starts = np.cumsum([0, *counts])
    first = profiles[0].beam_angles
    alike = all(
        len(one.beam_angles) == len(first) and np.abs(one.beam_angles - first).max() < 1e-9
        for one in profiles
    )
    step = float(np.median(np.abs(np.diff(first)))) if len(first) > 1 else math.inf
    whole_turn = max(float(np.ptp(one.body_angles)) for one in profiles) < 2.0 * math.pi
    if alike and whole_turn and same_grid([one.scanner for one in profiles], step):
        directions = np.concatenate([one.body_angles + one.scanner.arm for one in profiles])
        order = np.argsort(np.mod(directions, 2.0 * math.pi), kind="stable")
        column = np.empty(len(order), np.int32)
        column[order] = np.arange(len(order), dtype=np.int32)
    else:
        column = np.concatenate(
            [
                start + np.argsort(np.argsort(one.body_angles, kind="stable"), kind="stable")
                for one, start in zip(profiles, starts, strict=False)
            ]
        ).astype(np.int32)
    return [column[a:b] for a, b in pairwise(starts)]


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """Read the pictures; each camera is where the body's angle put it.

    Raises
    ------
    InputError
        If one is absent, is no JPEG or PNG, or has another size than its camera is calibrated for.
    """
    photos = []
    for picture in _read(path).pictures:
        photos.append(
            loose_photo(
                picture.path,
                picture.camera.model,
                station_from_body(picture.body_angle) @ picture.camera.body_from_camera,
                picture.name,
            )
        )
    return photos


def loose_photo(
    path: Path, camera: CameraModel, station_from_camera: Matrix | None, name: str | None = None
) -> Photo:
    """Read a JPEG or PNG file as a picture of a camera.

    Raises
    ------
    InputError
        If it cannot be read, is of another format, or of another size than the camera is calibrated for.
    """
    data, size, kind = read_picture(path)
    if size != (camera.width, camera.height):
        raise InputError(
            path,
            f"the picture has {size[0]} x {size[1]} pixels, its camera is calibrated for "
            f"{camera.width} x {camera.height}",
            place="width, height",
            advice="Use the picture as it was taken, or calibrate at its size",
        )
    return Photo(name or path.stem, "jpeg" if kind == "jpeg" else "png", data, camera, station_from_camera)


def read_cameras(path: Path, scan_index: int) -> list[tuple[str, CameraModel]]:
    """Tell name and camera of each picture of `read_photos`, without reading the pictures.

    Raises
    ------
    InputError
        If the rig file is damaged.
    """
    return [(picture.name, picture.camera.model) for picture in _read(path).pictures]


def parts(path: Path) -> list[Path]:
    """Name the files whose content belongs to the scan, beside the rig file itself.

    Raises
    ------
    InputError
        If the rig file is damaged.
    """
    table = read_toml(path, FORMAT)
    named = [line.text("profiles", "file of the profiles") for line in table.tables("scanner")]
    named += [camera.text("file", "a camera file") for camera in table.tables("camera") if "file" in camera]
    named += [picture.text("file", "a JPEG or PNG file") for picture in table.tables("picture")]
    return [path.parent / name for name in dict.fromkeys(named)]


def _read(path: Path) -> _Rig:
    table = read_toml(path, FORMAT)
    lines = [_line(path, one) for one in table.tables("scanner")]
    if not lines:
        raise table.error("scanner", "it is missing: at least one [[scanner]] with its profiles")
    cameras: dict[str, RigCamera] = {}
    for one in table.tables("camera"):
        camera = _camera(path, one)
        if camera.name in cameras:
            raise one.error("name", f"there are two cameras {camera.name!r}")
        cameras[camera.name] = camera
    pictures = [_picture(path, one, cameras) for one in table.tables("picture")]
    return _Rig(
        name=table.text("name", "the scan's name") if "name" in table else path.stem,
        lines=lines,
        pictures=pictures,
        project_from_station=table.motion("project_from_station")
        if "project_from_station" in table
        else None,
    )


def _line(path: Path, table: Table) -> _Line:
    mounting = np.eye(4)
    if "body_from_mounting" in table:
        mounting = table.motion("body_from_mounting")
    elif "mounting" in table:
        inner = table.table("mounting")
        turn = inner.numbers("turn_deg", 3, "turns about x, y and z") if "turn_deg" in inner else (0.0,) * 3
        shift = inner.numbers("shift_m", 3, "shift, metres") if "shift_m" in inner else (0.0,) * 3
        x, y, z = np.radians(turn)
        rotation = cv2.Rodrigues(np.array([0.0, 0.0, z]))[0]
        rotation = (
            rotation @ cv2.Rodrigues(np.array([0.0, y, 0.0]))[0] @ cv2.Rodrigues(np.array([x, 0.0, 0.0]))[0]
        )
        mounting = motion(rotation, np.array(shift))
    scanner = LineScanner(
        name=table.text("name", "the scanner's name") if "name" in table else "",
        d=table.number("d_m", "distance of the scanner's centre from the axis, metres"),
        h=table.number("h_m", "height of the scanner's centre, metres"),
        body_from_mounting=mounting,
    )
    return _Line(scanner, path.parent / table.text("profiles", "file of its profiles"), table)


def _camera(path: Path, table: Table) -> RigCamera:
    name = table.text("name", "the name that pictures call it by")
    if "file" in table:
        file = path.parent / table.text("file", "a camera file")
        found = read_camera(file)
        model, place = found.model, camera_place(table)
        place = found.body_from_camera if place is None else place
    else:
        file, model, place = path, camera_model(table), camera_place(table)
    if place is None:
        raise InputError(
            file,
            "it is missing: where the camera sits on the body",
            place="body_from_camera" if file != path else f"{table.place}body_from_camera",
            advice="Give body_from_camera, or a table mounting with position_m and heading_deg",
        )
    return RigCamera(name, model, place)


def _picture(path: Path, table: Table, cameras: dict[str, RigCamera]) -> _Picture:
    file = table.text("file", "a JPEG or PNG file")
    if "camera" in table or len(cameras) != 1:
        name = table.text("camera", "name of the [[camera]] that took it")
    else:
        name = next(iter(cameras))
    if name not in cameras:
        known = ", ".join(cameras) or "none"
        raise table.error("camera", f"there is no camera {name!r}; the file describes {known}")
    angle = table.number("body_angle_deg", "angle of the body when it was taken")
    return _Picture(path.parent / file, cameras[name], math.radians(angle), Path(file).stem)


def _open_profiles(line: _Line) -> "_Npz | _Csv":
    path = line.profiles
    try:
        with path.open("rb") as stream:
            head = stream.read(4)
    except FileNotFoundError:
        raise InputError(
            path,
            f"there is no such file; {line.table.path.name} names it",
            place=f"{line.table.place}profiles",
        ) from None
    except OSError as error:
        raise InputError(path, f"it cannot be read: {(error.strerror or '').lower()}") from error
    if not head:
        raise InputError(path, "the file is empty")
    return _Npz(path) if head.startswith(b"PK") else _Csv(path)


def _has_intensity(line: _Line) -> bool:
    return _open_profiles(line).intensity


def read_profiles(rig: _Rig) -> list[Profiles]:
    """Read and check the profiles of all line scanners."""
    out = []
    for line in rig.lines:
        source = _open_profiles(line)
        ranges, intensity = source.read()
        _check_ranges(line.profiles, ranges)
        out.append(Profiles(line.scanner, source.body_angles, source.beam_angles, ranges, intensity))
    return out


def _check_angles(path: Path, body: NDArray[np.float64], beam: NDArray[np.float64]) -> None:
    for name, angles in (("body_angle_deg", body), ("beam_angle_deg", beam)):
        if angles.ndim != 1 or not len(angles):
            raise InputError(path, f"it has the shape {angles.shape}, not (N,)", place=name)
        if not np.isfinite(angles).all():
            at = int(np.flatnonzero(~np.isfinite(angles))[0])
            raise InputError(path, f"angle {at + 1} is {angles[at]}", place=name)
    if np.abs(beam).max() > 360.0:
        raise InputError(path, "an angle of a beam is beyond 360 degrees", place="beam_angle_deg")
    if len(np.unique(beam)) != len(beam):
        raise InputError(path, "two beams have the same angle", place="beam_angle_deg")
    if np.ptp(body) > 720.0:
        raise InputError(path, "the body turns by more than two whole turns", place="body_angle_deg")


def _check_shape(path: Path, name: str, shape: tuple[int, ...], profiles: int, beams: int) -> None:
    if len(shape) != 2:
        raise InputError(path, f"it has the shape {shape}, not (profiles, beams)", place=name)
    if shape[0] != profiles:
        raise InputError(
            path, f"there are {shape[0]} profiles and {profiles} body angles", place=f"{name}, body_angle_deg"
        )
    if shape[1] != beams:
        raise InputError(
            path,
            f"profiles have {shape[1]} beams, there are {beams} beam angles",
            place=f"{name}, beam_angle_deg",
        )


def _check_ranges(path: Path, ranges: NDArray[np.float32]) -> None:
    with np.errstate(invalid="ignore"):
        bad = ~(np.isfinite(ranges) & (ranges >= 0))
    if bad.any():
        profile, beam = (int(i) for i in np.argwhere(bad)[0])
        count = int(np.count_nonzero(bad))
        others = f"; so are {count - 1} others" if count > 1 else ""
        raise InputError(
            path,
            f"the range is {ranges[profile, beam]}{others}",
            place=f"range_m, profile {profile + 1}, beam {beam + 1}",
            advice="Write 0 where there was no return",
        )


class _Npz:
    """Arrays in a NumPy archive."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with zipfile.ZipFile(path) as archive:
                self.members = {
                    info.filename.removesuffix(".npy"): info
                    for info in archive.infolist()
                    if info.filename.endswith(".npy")
                }
                self.shapes = {name: self._shape(archive, info) for name, info in self.members.items()}
        except (zipfile.BadZipFile, OSError, ValueError, struct.error, zlib.error, EOFError) as error:
            raise self._damaged(error) from error
        for name in ("body_angle_deg", "beam_angle_deg", "range_m"):
            if name not in self.members:
                held = ", ".join(self.members) or "nothing"
                raise InputError(path, f"it is missing; the file holds {held}", place=name)
        body, beam = (self._array(name) for name in ("body_angle_deg", "beam_angle_deg"))
        _check_angles(path, body, beam)
        self.shape = (len(body), len(beam))
        _check_shape(path, "range_m", self.shapes["range_m"], *self.shape)
        self.intensity = "intensity" in self.members
        if self.intensity:
            _check_shape(path, "intensity", self.shapes["intensity"], *self.shape)
        self.body_angles, self.beam_angles = np.radians(body), np.radians(beam)

    def read(self) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Ranges and intensities (P, B)."""
        ranges = self._array("range_m").astype(np.float32, copy=False)
        if not self.intensity:
            return ranges, None
        return ranges, self._array("intensity").astype(np.float32, copy=False)

    def _damaged(self, error: Exception) -> InputError:
        return InputError(
            self.path,
            f"the archive is cut short or damaged ({str(error) or type(error).__name__})",
            advice="Copy the file again from where it came",
        )

    def _shape(self, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> tuple[int, ...]:
        """Shape of a member by its header, held against its size and that of the archive."""
        if info.file_size > _LARGEST_GROWTH * max(info.compress_size, 1):
            raise ValueError(f"{info.filename} cannot be as large as it says")
        with archive.open(info) as stream:
            version = np.lib.format.read_magic(stream)
            if version not in ((1, 0), (2, 0)):
                raise ValueError(f"{info.filename} has version {version}")
            read = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            shape, _, kind = read(stream)
            begin = stream.tell()
        if kind.kind not in "fiu":
            raise ValueError(f"{info.filename} holds {kind}, not numbers")
        if math.prod(shape) * kind.itemsize != info.file_size - begin:
            raise ValueError(f"{info.filename} is not as large as its shape {shape}")
        return tuple(int(n) for n in shape)

    def _array(self, name: str) -> NDArray[np.float64]:
        try:
            with zipfile.ZipFile(self.path) as archive, archive.open(self.members[name]) as stream:
                values = np.lib.format.read_array(stream, allow_pickle=False)
        except (zipfile.BadZipFile, OSError, ValueError, struct.error, zlib.error, EOFError) as error:
            raise self._damaged(error) from error
        return np.asarray(values) if name in ("range_m", "intensity") else np.asarray(values, np.float64)


class _Csv:
    """A table: beam angles in the first line, a profile in each other, its body angle first."""

    intensity = False

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except UnicodeDecodeError:
            raise InputError(
                path, "it is neither a NumPy archive (.npz) nor a CSV table of profiles"
            ) from None
        except OSError as error:
            raise InputError(path, f"it cannot be read: {(error.strerror or '').lower()}") from error
        cells = lines[0].split(",") if lines else [""]
        if cells[0].strip() != CSV_MARK:
            raise InputError(
                path,
                f"it is neither a NumPy archive (.npz) nor a CSV table that begins with {CSV_MARK}",
                place="line 1",
            )
        beam = self._numbers(cells[1:], 1)
        rows = []
        for number, line in enumerate(lines[1:], 2):
            if not line.strip():
                continue
            values = line.split(",")
            if len(values) != len(cells):
                raise InputError(
                    path,
                    f"it has {len(values) - 1} ranges, there are {len(cells) - 1} beam angles",
                    place=f"line {number}",
                )
            rows.append(self._numbers(values, number))
        if not rows:
            raise InputError(path, "it holds no profiles", place="line 2")
        table = np.array(rows)
        body = table[:, 0]
        _check_angles(path, body, beam)
        self._ranges = table[:, 1:].astype(np.float32)
        self.shape = (len(body), len(beam))
        self.body_angles, self.beam_angles = np.radians(body), np.radians(beam)

    def _numbers(self, cells: Sequence[str], line: int) -> NDArray[np.float64]:
        try:
            return np.array([float(cell) for cell in cells])
        except ValueError as error:
            raise InputError(self.path, f"a cell is no number ({error})", place=f"line {line}") from None

    def read(self) -> tuple[NDArray[np.float32], None]:
        """Ranges (P, B)."""
        return self._ranges, None


def write_rig(
    path: Path | str,
    name: str,
    profiles: Sequence[Profiles],
    camera: RigCamera | None = None,
    pictures: Sequence[tuple[NDArray[np.uint8], float]] = (),
) -> None:
    """Write a rig file with its profiles and pictures beside it.

    Parameters
    ----------
    path
        The TOML; other files are named after it and written first.
    name
        Of the scan.
    profiles
        Of each line scanner.
    camera
        That took the pictures.
    pictures
        (H, W, 3) red, green, blue, and the body's angle (rad), each; written as JPEG.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    path = Path(path)
    lines = [f"format = {quoted(FORMAT)}", f"name = {quoted(name)}"]
    for one in profiles:
        file = path.with_name(f"{path.stem}-{one.scanner.name}.npz")
        arrays: dict[str, NDArray[Any]] = {
            "body_angle_deg": np.degrees(one.body_angles),
            "beam_angle_deg": np.degrees(one.beam_angles),
            "range_m": one.ranges,
        }
        if one.intensity is not None:
            arrays["intensity"] = one.intensity
        with replacing(file) as temporary, temporary.open("wb") as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]
        lines += [
            "",
            "[[scanner]]",
            f"name = {quoted(one.scanner.name)}",
            f"d_m = {one.scanner.d!r}",
            f"h_m = {one.scanner.h!r}",
            f"body_from_mounting = {matrix_text(one.scanner.body_from_mounting)}",
            f"profiles = {quoted(file.name)}",
        ]
    if camera is not None:
        lines += ["", "[[camera]]", *camera_lines(camera.name, camera.model, camera.body_from_camera)]
        for number, (image, angle) in enumerate(pictures):
            file = path.with_name(f"{path.stem}-{number:02d}.jpg")
            _, data = cv2.imencode(
                ".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
            )
            write_atomically(file, data.tobytes())
            lines += [
                "",
                "[[picture]]",
                f"file = {quoted(file.name)}",
                f"camera = {quoted(camera.name)}",
                f"body_angle_deg = {math.degrees(angle)!r}",
            ]
    write_atomically(path, ("\n".join(lines) + "\n").encode())
