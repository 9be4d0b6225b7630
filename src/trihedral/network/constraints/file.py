"""The constraints file, TOML: docs/constraints.md has all of it with an example."""

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, cast

from trihedral.errors import InputError
from trihedral.guarded import read_bytes, read_toml
from trihedral.network.constraints.constraints import Constraints, Fixed, LevelScanners, Rows, UserPair
from trihedral.network.constraints.control_file import control_of
from trihedral.network.constraints.names import nearest
from trihedral.network.constraints.table import ConstraintTable, rigid_motion

# Names under which the file is found in a folder of scans.
FILE_NAMES = ("trihedral.toml", "constraints.toml")

_ARCSEC = math.pi / 180 / 3600


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
    values = read_toml(path)
    top = ConstraintTable(path, "", values)
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
        control=control_of(top.table("control")),
    )
    top.done()
    _check_pairs(path, constraints)
    return constraints


def _named_files(path: Path, values: Mapping[str, Any]) -> list[str]:
    control = values.get("control")
    named = [control.get(key) for key in ("points", "measurements")] if isinstance(control, dict) else []
    return [str(path.parent / name) for name in named if isinstance(name, str)]


def _level(table: ConstraintTable | None) -> LevelScanners | None:
    if table is None:
        return None
    level = LevelScanners(table.positive("sigma_arcsec", None) * _ARCSEC, table.names("stations"))
    table.done()
    return level


def _fixed(table: ConstraintTable) -> list[Fixed]:
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
                "stations", f"{source} places no scan {name!r}", nearest(name, poses, "It places")
            )
    return [Fixed(name, poses[name], *sigmas, needed=wanted is not None) for name in wanted or poses]


def _poses_of(path: Path) -> dict[str, Rows]:
    """Poses of the placed stations of the main part of a registration.json."""
    try:
        stations = json.loads(read_bytes(path))["stations"]
        poses = {
            str(station["name"]): station["pose"]
            for station in stations
            if station.get("pose") is not None and station.get("component") in (0, None)
        }
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(path, "it is not a registration.json") from None
    return {name: rigid_motion(path, f"pose of {name}", pose) for name, pose in poses.items()}


def _pair(table: ConstraintTable, transform: str, sigma_mm: float, sigma_arcsec: float) -> UserPair:
    ends = table.name("from"), table.name("to")
    if ends[0] == ends[1]:
        raise table.error("to", "a pair needs two scans")
    if transform == "none":
        table.done()
        return UserPair(*ends)
    pose = table.pose("transform")
    if pose is None and transform == "needed":
        raise table.error("transform", "is missing: the 4x4 that takes `from` coordinates into `to`")
    sigmas = (
        table.positive("sigma_mm", sigma_mm) * 1e-3,
        table.positive("sigma_arcsec", sigma_arcsec) * _ARCSEC,
    )
    table.done()
    return UserPair(*ends, pose, *sigmas)


def _check_pairs(path: Path, constraints: Constraints) -> None:
    said: dict[frozenset[str], str] = {}
    for kind in ("forced", "forbidden", "locked"):
        for number, pair in enumerate(getattr(constraints, kind), start=1):
            ends = frozenset((pair.from_station, pair.to_station))
            if ends in said:
                names = f"{pair.from_station} - {pair.to_station}"
                raise InputError(path, f"{names} is {said[ends]} too", place=f"{kind}[{number}]")
            said[ends] = kind
