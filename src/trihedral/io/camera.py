"""Camera files: TOML of a camera's intrinsics, distortion and place; docs/cameras.md."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from trihedral import guarded
from trihedral.atomic import write_new
from trihedral.errors import InputError
from trihedral.fusion.calibration import mounting_pose
from trihedral.fusion.kinematics import station_from_body
from trihedral.geometry.se3 import Matrix
from trihedral.guarded import is_finite_number
from trihedral.scan import CameraModel

FORMAT = "trihedral-camera/1"
_KINDS = ("pinhole", "spherical", "cylindrical")
# A rotation further from orthonormal than this was not meant as one.
_RIGID = 1e-4
_LARGEST_SIDE = 100_000
# No length, angle or coordinate of a rig or camera is larger (metres, degrees, pixels).
_LARGEST = 1e9


@dataclass(frozen=True)
class CameraFile:
    """What a camera file says.

    Attributes
    ----------
    name
        Of the camera.
    model
        Complete.
    body_from_camera
        4x4: its place on the rig's body, or at the station; None where the file does not say.
    pictures
        Path of each picture that the file lists, and its station_from_camera (4x4).
    """

    name: str
    model: CameraModel
    body_from_camera: Matrix | None
    pictures: tuple[tuple[Path, Matrix], ...] = ()


def _is_usable(value: Any) -> bool:
    return is_finite_number(value) and abs(value) <= _LARGEST


def _shown(value: object) -> str:
    """A value for a message, which numbers of hundreds of digits would drown."""
    try:
        return repr(value)[:80]
    except (ValueError, RecursionError):
        return "a number of thousands of digits"


class Table:
    """A table of a TOML file, whose values are checked as they are taken."""

    def __init__(self, path: Path, values: Mapping[str, Any], place: str) -> None:
        self.path, self.values, self.place = path, values, place

    def error(self, key: str, reason: str, advice: str = "") -> InputError:
        """Name the file and the field."""
        return InputError(self.path, reason, place=f"{self.place}{key}", advice=advice)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def needed(self, key: str, what: str) -> Any:
        """Take a value that must be there."""
        if key not in self.values:
            raise self.error(key, f"it is missing: {what}")
        return self.values[key]

    def text(self, key: str, what: str) -> str:
        """Take a string."""
        value = self.needed(key, what)
        if not isinstance(value, str) or not value:
            raise self.error(key, f"it is {_shown(value)}, not a text: {what}")
        return value

    def number(self, key: str, what: str, default: float | None = None) -> float:
        """Take a finite number."""
        value = self.values.get(key, default) if default is not None else self.needed(key, what)
        if not _is_usable(value):
            raise self.error(key, f"it is {_shown(value)}, not a finite number: {what}")
        return float(value)

    def whole(self, key: str, what: str) -> int:
        """Take a positive whole number."""
        value = self.needed(key, what)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= _LARGEST_SIDE:
            raise self.error(
                key, f"it is {_shown(value)}, not a whole number from 1 to {_LARGEST_SIDE}: {what}"
            )
        return value

    def numbers(self, key: str, count: int | range, what: str) -> tuple[float, ...]:
        """Take so many finite numbers."""
        value = self.needed(key, what)
        counts = range(count, count + 1) if isinstance(count, int) else count
        good = isinstance(value, list) and all(map(_is_usable, value))
        if not good or len(value) not in counts:
            wanted = str(count) if isinstance(count, int) else f"{counts[0]} to {counts[-1]}"
            raise self.error(key, f"it is not a list of {wanted} finite numbers: {what}")
        return tuple(float(v) for v in value)

    def motion(self, key: str) -> Matrix:
        """Take a rigid motion, four rows of four."""
        value = self.values[key]
        try:
            matrix = np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            matrix = np.zeros(0)
        if matrix.shape != (4, 4) or not (np.abs(matrix) <= _LARGEST).all():
            raise self.error(key, "it is not four rows of four finite numbers")
        rotation = matrix[:3, :3]
        if (
            np.abs(rotation @ rotation.T - np.eye(3)).max() > _RIGID
            or np.linalg.det(rotation) < 0
            or not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0])
        ):
            raise self.error(key, "it is no rigid motion: rotation and shift above a last row of 0, 0, 0, 1")
        # Printed with few digits, a rotation is not quite one.
        left, _, right = np.linalg.svd(rotation)
        matrix[:3, :3] = left @ right
        return matrix

    def table(self, key: str) -> "Table":
        """Take a table."""
        value = self.values[key]
        if not isinstance(value, dict):
            raise self.error(key, "it is not a table")
        return Table(self.path, value, f"{self.place}{key}.")

    def tables(self, key: str) -> list["Table"]:
        """Take a list of tables; none if it is not there."""
        value = self.values.get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise self.error(key, f"it is not a list of tables: write [[{key}]]")
        return [Table(self.path, v, f"{self.place}{key} {n}, ") for n, v in enumerate(value, 1)]


def read_toml(path: Path, expected: str) -> Table:
    """Read a TOML file of ours; `InputError` if it is no TOML or has another `format`."""
    values = guarded.read_toml(path)
    found = values.get("format")
    if found != expected:
        said = "it has no format" if found is None else f"it is {found!r}"
        raise InputError(path, f"{said}; {expected!r} is needed", place="format")
    return Table(path, values, "")


def read_camera(path: Path | str) -> CameraFile:
    """Read a camera file; an `InputError` names the field that is missing or makes no sense."""
    path = Path(path)
    table = read_toml(path, FORMAT)
    name = table.text("name", "the camera's name") if "name" in table else path.stem
    place = camera_place(table)
    pictures = tuple(_picture(path, one, place) for one in table.tables("picture"))
    return CameraFile(name, camera_model(table), place, pictures)


def _picture(path: Path, table: Table, place: Matrix | None) -> tuple[Path, Matrix]:
    file = path.parent / table.text("file", "a JPEG or PNG file")
    if "station_from_camera" in table:
        return file, table.motion("station_from_camera")
    angle = table.number("body_angle_deg", "angle of the body, or station_from_camera, when it was taken")
    if place is None:
        raise InputError(
            path, "it is missing: body_angle_deg of a picture needs it", place="body_from_camera"
        )
    return file, station_from_body(math.radians(angle)) @ place


def camera_model(table: Table) -> CameraModel:
    """Take a camera's model from a table."""
    kind = table.text("kind", f"one of {', '.join(_KINDS)}") if "kind" in table else "pinhole"
    if kind not in _KINDS:
        raise table.error("kind", f"it is {kind!r}, not one of {', '.join(_KINDS)}")
    assert kind in get_args(CameraModel.__annotations__["kind"])
    width = table.whole("width", "columns of the pictures, pixels")
    height = table.whole("height", "rows of the pictures, pixels")
    focal = centre = pixel_angle = None
    distortion: tuple[float, ...] = ()
    if kind == "pinhole":
        focal = _two(table, "focal_px", "focal lengths fx and fy, pixels")
        if min(focal) <= 0:
            raise table.error(
                "focal_px", f"focal lengths must be positive, not {focal[0]:g} and {focal[1]:g}"
            )
        if "centre_px" in table:
            centre = _two(table, "centre_px", "principal point, column and row, pixels")
        else:
            centre = ((width - 1) / 2.0, (height - 1) / 2.0)
        if "distortion" in table:
            distortion = table.numbers("distortion", range(0, 6), "Brown's k1, k2, p1, p2, k3")
            distortion = (*distortion, *(0.0,) * 5)[:5] if any(distortion) else ()
    else:
        turn = 2.0 * math.pi / width
        across = math.radians(table.number("column_deg", "degrees a column", math.degrees(turn)))
        if not 0 < across * width <= 2.0 * math.pi * 1.001:
            raise table.error(
                "column_deg", "the columns together must cover more than 0 and at most 360 degrees"
            )
        if kind == "spherical":
            down = math.radians(table.number("row_deg", "degrees a row", 180.0 / height))
            if not 0 < down * height <= math.pi * 1.001:
                raise table.error(
                    "row_deg", "the rows together must cover more than 0 and at most 180 degrees"
                )
            pixel_angle = (across, down)
        else:
            tall = table.number("focal_px", "pixels that one radius of the cylinder is high", 1.0 / across)
            if tall <= 0:
                raise table.error("focal_px", "it must be positive")
            middle = table.number("centre_row_px", "row of the horizon", (height - 1) / 2.0)
            focal, centre = (1.0 / across, tall), ((width - 1) / 2.0, middle)
            pixel_angle = (across, 1.0 / tall)
    return CameraModel(
        kind,  # type: ignore[arg-type]
        width,
        height,
        focal=focal,
        centre=centre,
        distortion=distortion,
        pixel_angle=pixel_angle,
    )


def _two(table: Table, key: str, what: str) -> tuple[float, float]:
    first, second = table.numbers(key, 2, what)
    return first, second


def camera_place(table: Table) -> Matrix | None:
    """Take `body_from_camera`, or what it follows from: the table `mounting`."""
    if "body_from_camera" in table:
        return table.motion("body_from_camera")
    if "mounting" not in table:
        return None
    mounting = table.table("mounting")
    return mounting_pose(
        mounting.numbers("position_m", 3, "the camera's centre on the body, metres"),
        math.radians(mounting.number("heading_deg", "direction of the view, from x towards y")),
        math.radians(mounting.number("pitch_deg", "of the view above the level", 0.0)),
        math.radians(mounting.number("roll_deg", "about the view", 0.0)),
    )


def read_pairs(path: Path | str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read pairs picked in a scan and in a picture: (N, 3) points and (N, 2) pixels.

    Rows are x, y, z (metres), column, row (pixels); a first line that holds no number is taken for a header. A row
    without five finite numbers is an `InputError`.
    """
    path = Path(path)
    lines = guarded.read_text(path).splitlines()
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        cells = [cell for cell in line.replace(";", ",").replace("\t", ",").split(",") if cell.strip()]
        if not cells or cells[0].lstrip().startswith("#"):
            continue
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            if not rows and number == 1:
                continue
            values = []
        if len(values) != 5 or not all(math.isfinite(value) for value in values):
            raise InputError(
                path, "it is not five finite numbers: x, y, z, column, row", place=f"line {number}"
            )
        rows.append(values)
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return table[:, :3], table[:, 3:]


def camera_lines(name: str, model: CameraModel, place: Matrix | None) -> list[str]:
    """Give the lines of a camera's table."""
    lines = [
        f"name = {quoted(name)}",
        f"kind = {quoted(model.kind)}",
        f"width = {model.width}",
        f"height = {model.height}",
    ]
    if model.kind == "pinhole":
        assert model.focal is not None and model.centre is not None
        lines += [f"focal_px = {listed(model.focal)}", f"centre_px = {listed(model.centre)}"]
        if model.distortion:
            lines.append(f"distortion = {listed(model.distortion)}  # k1, k2, p1, p2, k3")
    else:
        assert model.pixel_angle is not None
        lines.append(f"column_deg = {math.degrees(model.pixel_angle[0])!r}")
        if model.kind == "spherical":
            lines.append(f"row_deg = {math.degrees(model.pixel_angle[1])!r}")
        else:
            assert model.focal is not None and model.centre is not None
            lines += [f"focal_px = {model.focal[1]!r}", f"centre_row_px = {model.centre[1]!r}"]
    if place is not None:
        lines.append(f"body_from_camera = {matrix_text(place)}")
    return lines


def write_camera(
    path: Path | str, name: str, model: CameraModel, place: Matrix | None = None, notes: Sequence[str] = ()
) -> None:
    """Write a camera file; `notes` become comments.

    Raises
    ------
    OutputError
        If it cannot be written; what was there before is untouched.
    """
    lines = [f"# {note}" for note in notes] + [
        f"format = {quoted(FORMAT)}",
        *camera_lines(name, model, place),
    ]
    write_new(path, ("\n".join(lines) + "\n").encode())


def quoted(text: str) -> str:
    """A basic string of TOML."""
    escaped = "".join(f"\\{c}" if c in '"\\' else c if c.isprintable() else f"\\U{ord(c):08X}" for c in text)
    return f'"{escaped}"'


def listed(values: Sequence[float]) -> str:
    """A list of numbers, exact."""
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"


def matrix_text(matrix: Matrix) -> str:
    """Rows of a matrix, exact."""
    return "[\n" + "".join(f"  {listed(row)},\n" for row in matrix) + "]"
