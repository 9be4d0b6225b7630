"""What a person knows beside the scans, read from one TOML file: docs/network.md has all of it with an example."""

import csv
import difflib
import json
import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from trihedral.errors import InputError
from trihedral.scan.scan import METRES_PER_UNIT, Units

#: Names under which the file is found in a folder of scans.
FILE_NAMES = ("trihedral.toml", "constraints.toml")

Triple = tuple[float, float, float]
Rows = tuple[tuple[float, float, float, float], ...]

_ARCSEC = math.pi / 180 / 3600
_IDENTITY: Rows = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Level:
    """Scanners that stood level."""

    sigma: float  # radians
    stations: tuple[str, ...] | None = None  # all if None


@dataclass(frozen=True)
class Fixed:
    """A scan whose pose is known."""

    station: str
    pose: Rows  # project_from_station
    sigma_translation: float  # metres
    sigma_rotation: float  # radians
    needed: bool = True  # the job must hold it


@dataclass(frozen=True)
class Pair:
    """A pair that a person has decided on; `transform` is ``to_from_from`` where he gives it."""

    from_station: str
    to_station: str
    transform: Rows | None = None
    sigma_translation: float = 0.0  # metres, of the transform
    sigma_rotation: float = 0.0  # radians


@dataclass(frozen=True)
class ControlPoint:
    """A point with known coordinates, metres; a check takes no part in the adjustment."""

    name: str
    place: Triple
    sigma: Triple
    check: bool = False


@dataclass(frozen=True)
class Measurement:
    """A control point as one scan shows it, in the scan's own coordinates, metres."""

    station: str
    point: str
    place: Triple
    sigma: Triple


@dataclass(frozen=True)
class Control:
    """Control points and where scans show them."""

    source: str  # the file with the points, for messages
    points: tuple[ControlPoint, ...] = ()
    measurements: tuple[Measurement, ...] = ()


@dataclass(frozen=True)
class Constraints:
    """Everything that a constraints file may say."""

    source: str | None = None  # the file, for messages
    files: tuple[str, ...] = ()  # it and those that it names, none of them a scan
    crs: str | None = None  # name or WKT of the project's coordinate reference system
    # Whether the result keeps the coordinates that poses in the files are in; auto: where they agree with the result.
    coordinates: Literal["auto", "keep", "new"] = "auto"
    level: Level | None = None
    fixed: tuple[Fixed, ...] = ()
    forced: tuple[Pair, ...] = ()
    forbidden: tuple[Pair, ...] = ()
    locked: tuple[Pair, ...] = ()
    control: Control = field(default_factory=lambda: Control(""))


def find_constraints(paths: Iterable[Path | str]) -> Path | None:
    """Find the constraints file in the folders given, or beside the files given.

    Raises
    ------
    InputError
        There are several: nothing says which one counts.
    """
    folders = {path if path.is_dir() else path.parent for path in map(Path, paths)}
    found = sorted(folder / name for folder in folders for name in FILE_NAMES if (folder / name).is_file())
    if len({path.resolve() for path in found}) > 1:
        raise InputError(
            found[1], f"{found[0]} is there too, and only one can count", advice="Choose with --constraints"
        )
    return found[0] if found else None


def read_constraints(path: Path | str) -> Constraints:
    """Read a constraints file.

    Raises
    ------
    InputError
        It cannot be read, or says something that makes no sense; the message names the field.
    """
    path = Path(path)
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, "there is no such file") from None
    except OSError as error:
        raise InputError(path, f"it cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise InputError(path, "it is not UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(path, f"it is not TOML: {str(error)[:1].lower()}{str(error)[1:]}") from None
    top = _Table(path, "", values)
    coordinates = top.choice("coordinates", ("auto", "keep", "new"), "auto")
    constraints = Constraints(
        source=str(path),
        files=(str(path), *_named_files(path, values)),
        crs=top.text("crs", None),
        coordinates=cast(Literal["auto", "keep", "new"], coordinates),
        level=_level(top.table("level")),
        fixed=tuple(fixed for table in top.tables("fixed") for fixed in _fixed(table)),
        forced=tuple(_pair(table, "optional", 10.0, 180.0) for table in top.tables("forced")),
        forbidden=tuple(_pair(table, "none", 0.0, 0.0) for table in top.tables("forbidden")),
        locked=tuple(_pair(table, "needed", 0.1, 1.0) for table in top.tables("locked")),
        control=_control(top.table("control")),
    )
    top.done()
    _check_pairs(path, constraints)
    return constraints


def _named_files(path: Path, values: Mapping[str, Any]) -> list[str]:
    control = values.get("control")
    named = [control.get(key) for key in ("points", "measurements")] if isinstance(control, dict) else []
    return [str(path.parent / name) for name in named if isinstance(name, str)]


class _Table:
    """A table of the file; every key must be asked for before `done`."""

    def __init__(self, path: Path, place: str, values: Mapping[str, Any]) -> None:
        self.path, self.place, self.values = path, place, values
        self.known: list[str] = []

    def at(self, key: str) -> str:
        """Name a key in full."""
        return f"{self.place}.{key}" if self.place else key

    def error(self, key: str, reason: str, advice: str = "") -> InputError:
        """Say what is wrong with a value."""
        return InputError(self.path, reason, place=self.at(key), advice=advice)

    def get(self, key: str) -> Any:
        """Give a value or None."""
        self.known.append(key)
        return self.values.get(key)

    def text(self, key: str, default: str | None) -> str | None:
        """Give a text that is not empty."""
        value = self.get(key)
        if value is None:
            return default
        if not isinstance(value, str) or not value.strip():
            raise self.error(key, "must be a text in quotes")
        return value

    def name(self, key: str) -> str:
        """Give a text that must be there."""
        value = self.text(key, None)
        if value is None:
            raise self.error(key, "is missing")
        return value

    def names(self, key: str) -> tuple[str, ...] | None:
        """Give a list of texts."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
            raise self.error(key, "must be a list of names in quotes")
        return tuple(value)

    def choice(self, key: str, allowed: Sequence[str], default: str) -> str:
        """Give one of a few words."""
        value = self.get(key)
        if value is None:
            return default
        if value not in allowed:
            raise self.error(key, f"must be one of {', '.join(allowed)}, not {value!r}")
        return str(value)

    def positive(self, key: str, default: float | None) -> float:
        """Give a number above zero."""
        value = self.get(key)
        if value is None and default is not None:
            return default
        if not _is_number(value) or not value > 0:
            raise self.error(key, "is missing" if value is None else "must be a number above 0")
        return float(value)

    def flag(self, key: str) -> bool:
        """Give true or false."""
        value = self.get(key)
        if value not in (None, True, False):
            raise self.error(key, "must be true or false")
        return bool(value)

    def triple(self, key: str) -> Triple:
        """Give three numbers."""
        value = self.get(key)
        if not isinstance(value, list) or len(value) != 3 or not all(map(_is_number, value)):
            raise self.error(key, "is missing" if value is None else "must be three numbers, [x, y, z]")
        return float(value[0]), float(value[1]), float(value[2])

    def sigma(self, key: str, default: float) -> Triple:
        """Give one standard deviation or three, millimetres as metres."""
        value = self.get(key)
        values = [default] * 3 if value is None else value if isinstance(value, list) else [value] * 3
        if len(values) != 3 or not all(_is_number(v) and v > 0 for v in values):
            raise self.error(key, "must be a number above 0, or three of them for x, y and z")
        return values[0] * 1e-3, values[1] * 1e-3, values[2] * 1e-3

    def pose(self, key: str) -> Rows | None:
        """Give a rigid motion."""
        value = self.get(key)
        return None if value is None else _rigid(self.path, self.at(key), value)

    def table(self, key: str) -> "_Table | None":
        """Give a table inside it."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, dict):
            raise self.error(key, f"must be a table, [{self.at(key)}]")
        return _Table(self.path, self.at(key), value)

    def tables(self, key: str) -> list["_Table"]:
        """Give a list of tables; a single one counts as a list of it."""
        value = self.get(key)
        listed = [] if value is None else [value] if isinstance(value, dict) else value
        if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
            raise self.error(key, f"must be tables, [[{self.at(key)}]]")
        single = isinstance(value, dict)
        return [
            _Table(self.path, self.at(key) if single else f"{self.at(key)}[{number}]", entry)
            for number, entry in enumerate(listed, start=1)
        ]

    def done(self) -> None:
        """Refuse keys that mean nothing."""
        for key in self.values:
            if key not in self.known:
                near = difflib.get_close_matches(key, self.known, 1)
                known = f"Known here: {', '.join(self.known)}"
                raise self.error(key, "means nothing here", f"Is it {near[0]}?" if near else known)


def _level(table: _Table | None) -> Level | None:
    if table is None:
        return None
    level = Level(table.positive("sigma_arcsec", None) * _ARCSEC, table.names("stations"))
    table.done()
    return level


def _fixed(table: _Table) -> list[Fixed]:
    sigmas = table.positive("sigma_mm", 0.1) * 1e-3, table.positive("sigma_arcsec", 1.0) * _ARCSEC
    source, station, pose = table.text("from", None), table.text("station", None), table.pose("pose")
    wanted = table.names("stations")
    table.done()
    if (source is None) == (station is None):
        raise table.error("from", "give either `from`, a registration.json, or `station` and `pose`")
    if station is not None:
        if pose is None:
            raise table.error("pose", "is missing")
        return [Fixed(station, pose, *sigmas)]
    poses = _poses_of(table.path.parent / str(source))
    for name in wanted or ():
        if name not in poses:
            raise table.error(
                "stations", f"{source} places no scan {name!r}", _nearest(name, poses, "It places")
            )
    return [Fixed(name, poses[name], *sigmas, needed=wanted is not None) for name in wanted or poses]


def _poses_of(path: Path) -> dict[str, Rows]:
    """Poses of the placed stations of the main part of a registration.json."""
    try:
        stations = json.loads(path.read_bytes())["stations"]
        poses = {
            str(station["name"]): station["pose"]
            for station in stations
            if station.get("pose") is not None and station.get("component") in (0, None)
        }
    except OSError as error:
        raise InputError(path, f"it cannot be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(path, "it is not a registration.json") from None
    return {name: _rigid(path, f"pose of {name}", pose) for name, pose in poses.items()}


def _pair(table: _Table, transform: str, sigma_mm: float, sigma_arcsec: float) -> Pair:
    ends = table.name("from"), table.name("to")
    if ends[0] == ends[1]:
        raise table.error("to", "a pair needs two scans")
    if transform == "none":
        table.done()
        return Pair(*ends)
    pose = table.pose("transform")
    if pose is None and transform == "needed":
        raise table.error("transform", "is missing: the 4x4 that takes `from` coordinates into `to`")
    sigmas = (
        table.positive("sigma_mm", sigma_mm) * 1e-3,
        table.positive("sigma_arcsec", sigma_arcsec) * _ARCSEC,
    )
    table.done()
    return Pair(*ends, pose, *sigmas)


def _check_pairs(path: Path, constraints: Constraints) -> None:
    said: dict[frozenset[str], str] = {}
    for kind in ("forced", "forbidden", "locked"):
        for number, pair in enumerate(getattr(constraints, kind), start=1):
            ends = frozenset((pair.from_station, pair.to_station))
            if ends in said:
                names = f"{pair.from_station} - {pair.to_station}"
                raise InputError(path, f"{names} is {said[ends]} too", place=f"{kind}[{number}]")
            said[ends] = kind


def _control(table: _Table | None) -> Control:
    if table is None:
        return Control("")
    units = cast(Units, table.choice("units", tuple(METRES_PER_UNIT), "m"))
    scale = METRES_PER_UNIT[units]
    sigma, measured = table.sigma("sigma_mm", 2.0), table.sigma("measurement_sigma_mm", 2.0)
    points: list[ControlPoint] = []
    for row in [*_rows(table, "points", ("name",), ("check",)), *table.tables("point")]:
        name, place = row.name("name"), _scaled(row.triple("xyz"), scale)
        own = row.sigma("sigma_mm", 0.0) if row.values.get("sigma_mm") is not None else sigma
        row.known.append("sigma_mm")
        points.append(ControlPoint(name, place, own, row.flag("check")))
        row.done()
    measurements: list[Measurement] = []
    for row in [*_rows(table, "measurements", ("scan", "point"), ()), *table.tables("measurement")]:
        scan, point, place = row.name("scan"), row.name("point"), row.triple("xyz")
        own = row.sigma("sigma_mm", 0.0) if row.values.get("sigma_mm") is not None else measured
        row.known.append("sigma_mm")
        measurements.append(Measurement(scan, point, place, own))
        row.done()
    table.done()
    source = str(table.path.parent / table.values["points"]) if "points" in table.values else str(table.path)
    names = [point.name for point in points]
    for name in names:
        if names.count(name) > 1:
            raise InputError(source, f"point {name!r} is given twice", place="control")
    for measurement in measurements:
        if measurement.point not in names:
            raise InputError(
                table.path,
                f"scan {measurement.station} measures point {measurement.point!r}, which has no coordinates",
                place="control.measurements",
                advice=_nearest(measurement.point, names, "Points are"),
            )
    if points and not measurements:
        raise table.error("measurements", "are missing: nothing says where the scans show the points")
    return Control(source, tuple(points), tuple(measurements))


def _rows(table: _Table, key: str, names: Sequence[str], flags: Sequence[str]) -> list[_Table]:
    """Rows of a CSV file that the table names: names, x, y, z, sigma_mm; a heading may change their order."""
    file = table.text(key, None)
    if file is None:
        return []
    path = table.path.parent / file
    columns = [*names, "x", "y", "z", "sigma_mm", *flags]
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except FileNotFoundError:
        raise InputError(path, "there is no such file", advice=f"{table.path} names it") from None
    except OSError as error:
        raise InputError(path, f"it cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(path, "it is not a CSV file in UTF-8") from None
    result: list[_Table] = []
    for number, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in line]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if not result and {"x", "y", "z"} <= {cell.lower() for cell in cells}:
            columns = [cell.lower() for cell in cells]
            continue
        result.append(_row(path, number, dict(zip(columns, cells, strict=False)), names, flags))
    return result


def _row(
    path: Path, line: int, cells: Mapping[str, str], names: Sequence[str], flags: Sequence[str]
) -> _Table:
    place = f"line {line}"
    values: dict[str, Any] = {key: text for key, text in cells.items() if key not in ("x", "y", "z")}
    for name in names:
        if not values.get(name):
            raise InputError(path, f"lacks a {name}", place=place)
    try:
        values["xyz"] = [float(cells[axis]) for axis in "xyz"]
        if cells.get("sigma_mm"):
            values["sigma_mm"] = float(cells["sigma_mm"])
        else:
            values.pop("sigma_mm", None)
    except (KeyError, ValueError):
        raise InputError(
            path,
            "x, y, z and sigma must be numbers",
            place=place,
            advice="Points, not commas, before decimals",
        ) from None
    for flag in flags:
        word = str(values.pop(flag, "")).lower()
        if word not in ("", "0", "1", "no", "yes", "false", "true", flag):
            raise InputError(path, f"{word!r} is neither yes nor no", place=f"{place}, {flag}")
        values[flag] = word in ("1", "yes", "true", flag)
    return _Table(path, place, values)


def _scaled(place: Triple, scale: float) -> Triple:
    return place[0] * scale, place[1] * scale, place[2] * scale


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _rigid(path: Path, place: str, value: Any) -> Rows:
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise InputError(path, "must be four rows of four numbers", place=place)
    rotation = matrix[:3, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5) or np.linalg.det(rotation) < 0:
        raise InputError(path, "is not a rotation and a translation", place=place)
    if not np.array_equal(matrix[3], _IDENTITY[3]):
        raise InputError(path, "must end with the row 0, 0, 0, 1", place=place)
    # Digits that a file leaves out must not make it stretch.
    u, _, vt = np.linalg.svd(rotation)
    matrix[:3, :3] = u @ vt
    return cast(Rows, tuple(tuple(float(value) for value in row) for row in matrix))


def _nearest(name: str, known: Iterable[str], intro: str) -> str:
    known = list(known)
    near = difflib.get_close_matches(name, known, 1)
    return f"Is it {near[0]}?" if near else f"{intro} {', '.join(known[:8])}"


def resolved(constraints: Constraints, names: Mapping[str, Sequence[str]]) -> Constraints:
    """Give the scans that the constraints speak of the names that they have in the job.

    Parameters
    ----------
    names
        Of each station of the job: its name, and what else it may be called by.

    Raises
    ------
    InputError
        A scan is not in the job, or a name stands for several; the message gives the nearest name.
    """
    called: dict[str, set[str]] = {}
    for name, others in names.items():
        for other in others:
            called.setdefault(other, set()).add(name)

    def name_of(given: str, place: str) -> str:
        meant = {given} if given in names else called.get(given, set())
        if len(meant) == 1:
            return meant.pop()
        source = constraints.source or "constraints"
        if meant:
            several = ", ".join(sorted(meant))
            raise InputError(source, f"{given!r} stands for several scans: {several}", place=place)
        raise InputError(
            source, f"no scan is called {given!r}", place=place, advice=_nearest(given, names, "Scans are")
        )

    def pairs(kind: str) -> tuple[Pair, ...]:
        return tuple(
            replace(
                pair,
                from_station=name_of(pair.from_station, f"{kind}[{number}].from"),
                to_station=name_of(pair.to_station, f"{kind}[{number}].to"),
            )
            for number, pair in enumerate(getattr(constraints, kind), start=1)
        )

    level = constraints.level
    if level is not None and level.stations is not None:
        level = replace(level, stations=tuple(name_of(name, "level.stations") for name in level.stations))
    here = called.keys() | names.keys()
    return replace(
        constraints,
        level=level,
        fixed=tuple(
            replace(fixed, station=name_of(fixed.station, "fixed"))
            for fixed in constraints.fixed
            if fixed.station in here or fixed.needed
        ),
        forced=pairs("forced"),
        forbidden=pairs("forbidden"),
        locked=pairs("locked"),
        control=replace(
            constraints.control,
            measurements=tuple(
                replace(measurement, station=name_of(measurement.station, "control.measurements"))
                for measurement in constraints.control.measurements
            ),
        ),
    )
