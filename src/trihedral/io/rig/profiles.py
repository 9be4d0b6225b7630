"""Files of a line scanner's profiles: a NumPy archive or a table of text."""

import math
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import InputError
from trihedral.fusion.rig import Profiles
from trihedral.guarded import allowed_memory, open_input, read_bytes
from trihedral.io.rig.description import RigFile, RigLine
from trihedral.parallel import ARRAY_HEADERS

# First cell of a CSV file of profiles.
_CSV_MARK = "body_angle_deg"
# Arrays that are read; others do no harm.
_MEMBERS = ("body_angle_deg", "beam_angle_deg", "range_m", "intensity")
# What reading takes of memory for each byte of the arrays: they, their points and grid.
_GROWTH = 5
# Deflated data grow by this at the most: what claims to grow more is refused unread.
_LARGEST_GROWTH = 1100


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
    """Arrays in a NumPy archive.

    Any exception of the decoders means that it is damaged: headers are parsed as Python, and fail in as many ways.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with zipfile.ZipFile(path) as archive:
                held = [info.filename for info in archive.infolist()]
                self.members = {
                    name: archive.getinfo(f"{name}.npy") for name in _MEMBERS if f"{name}.npy" in held
                }
                size = sum(info.file_size for info in self.members.values())
                if size * _GROWTH > allowed_memory(path.stat().st_size):
                    raise ValueError(f"{size:,} bytes of arrays are more than it can be worth")
                self.shapes = {name: self._shape(archive, info) for name, info in self.members.items()}
        except Exception as error:
            raise self._damaged(error) from error
        for name in ("body_angle_deg", "beam_angle_deg", "range_m"):
            if name not in self.members:
                said = ", ".join(name.removesuffix(".npy") for name in held[:8]) or "nothing"
                raise InputError(path, f"it is missing; the file holds {said}", place=name)
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
            f"the archive is cut short or damaged ({str(error)[:200] or type(error).__name__})",
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
            with ARRAY_HEADERS:
                shape, _, kind = read(stream)
            begin = stream.tell()
        if kind.kind not in "fiu":
            raise ValueError(f"{info.filename} holds {kind}, not numbers")
        if math.prod(shape) * kind.itemsize != info.file_size - begin:
            raise ValueError(f"{info.filename} is not as large as its shape {shape}")
        return tuple(int(n) for n in shape)

    def _array(self, name: str) -> NDArray[np.float64]:
        try:
            with (
                zipfile.ZipFile(self.path) as archive,
                archive.open(self.members[name]) as stream,
                ARRAY_HEADERS,
            ):
                values = np.lib.format.read_array(stream, allow_pickle=False)
        except Exception as error:
            raise self._damaged(error) from error
        return np.asarray(values) if name in ("range_m", "intensity") else np.asarray(values, np.float64)


class _Csv:
    """A table: beam angles in the first line, a profile in each other, its body angle first."""

    intensity = False

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            lines = read_bytes(path).decode("utf-8-sig").splitlines()
        except UnicodeDecodeError:
            raise InputError(
                path, "it is neither a NumPy archive (.npz) nor a CSV table of profiles"
            ) from None
        cells = lines[0].split(",") if lines else [""]
        if cells[0].strip() != _CSV_MARK:
            raise InputError(
                path,
                f"it is neither a NumPy archive (.npz) nor a CSV table that begins with {_CSV_MARK}",
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


def open_profiles(line: RigLine) -> _Npz | _Csv:
    """Open a line scanner's file and read its angles; `InputError` if it is absent, cut short or does not fit."""
    path = line.profiles
    try:
        with open_input(path) as stream:
            head = stream.read(4)
    except InputError as error:
        names = f"; {line.table.path.name} names it"
        raise InputError(path, error.reason + names, place=f"{line.table.place}profiles") from None
    if not head:
        raise InputError(path, "the file is empty")
    return _Npz(path) if head.startswith(b"PK") else _Csv(path)


def read_profiles(rig: RigFile) -> list[Profiles]:
    """Read and check the profiles of all line scanners."""
    out = []
    for line in rig.lines:
        source = open_profiles(line)
        ranges, intensity = source.read()
        _check_ranges(line.profiles, ranges)
        out.append(Profiles(line.scanner, source.body_angles, source.beam_angles, ranges, intensity))
    return out
