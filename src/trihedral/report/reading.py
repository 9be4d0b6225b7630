"""A registration.json read and checked."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trihedral.errors import InputError
from trihedral.guarded import is_finite_number, read_bytes
from trihedral.report.result import SCHEMA, Document
from trihedral.scan.scan import METRES_PER_UNIT

_STATION_KEYS = frozenset(
    {"name", "source", "scan_index", "points", "pose", "tied", "component", "status", "reason"}
)
_LINK_KEYS = frozenset({"from", "to", "accepted", "verdict", "reason", "transform", "method", "overlap"})
_LOOP_KEYS = frozenset({"stations", "translation_m", "rotation_deg", "ok"})


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 63


def _triple(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(is_finite_number, value))


def _places(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(row, list) and len(row) == 2 and _text(row[0]) and _triple(row[1]) for row in value
    )


def _or_null(holds: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: value is None or holds(value)


_Kinds = Mapping[str, Callable[[Any], bool]]
_STATION_KINDS: _Kinds = {
    **{"source": _text, "scan_index": _count, "points": _count},
    **{"reason": _or_null(_text), "component": _or_null(_count)},
    **{"scanner_origin": _or_null(_triple), "scanner_origin_sigma_m": _or_null(_triple)},
}
_INPUT_KINDS: _Kinds = {"path": _text, "sha256": _text, "bytes": _count}
_FRAME_KINDS: _Kinds = {"crs": _or_null(_text)}
_READ_KINDS: _Kinds = {
    "units": _or_null(lambda value: isinstance(value, str) and value in METRES_PER_UNIT),
    "scanner_origin": _or_null(_triple),
    "scanner_origins": _or_null(_places),
}


def read_result(path: Path | str) -> Document:
    """Read a registration.json, or the one in an output folder, and check what others rely on.

    Raises
    ------
    InputError
        It is absent, cut short, not JSON, of another schema, lacks a key, names a station that is not there
        or holds a pose that is not a rigid motion.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "registration.json"
    if not path.exists():
        raise InputError(path, "there is no such file", advice="`trihedral register` writes it")
    try:
        text = read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise InputError(path, "it is not UTF-8 text", place=f"byte {error.start}") from None
    try:
        document = json.loads(text)
    except RecursionError:
        raise InputError(path, "it is nested too deeply to be a result") from None
    except ValueError as error:
        line = f"line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        reason = f"it is not valid JSON ({error.msg if isinstance(error, json.JSONDecodeError) else error})"
        raise InputError(path, reason, place=line, advice="Register again to write it anew") from None
    _check(path, document)
    return dict(document)


def _check(path: Path, document: Any) -> None:
    if not isinstance(document, dict) or "schema" not in document:
        raise InputError(path, "it is not a registration result: it states no schema")
    if document["schema"] != SCHEMA:
        advice = "Read it with the version of trihedral that wrote it"
        raise InputError(
            path, f"its schema is {document['schema']!r}, not {SCHEMA!r}", place="schema", advice=advice
        )
    for key, kind in {
        **{"software": dict, "verdict": dict, "timing": dict},
        **{"inputs": list, "stations": list, "links": list, "loops": list},
    }.items():
        if not isinstance(document.get(key), kind):
            raise InputError(path, "is missing or of the wrong kind", place=key)
    for index, entry in enumerate(document["inputs"]):
        place = f"inputs[{index}]"
        _require(path, place, entry, frozenset(_INPUT_KINDS))
        _check_kinds(path, place, entry, _INPUT_KINDS)
    frame = document.get("frame")
    if frame is not None:
        _check_kinds(path, "frame", _object(path, "frame", frame), _FRAME_KINDS)
    options = _object(path, "software.options", document["software"].get("options", {}))
    read = _object(path, "software.options.read", options.get("read") or {})
    _check_kinds(path, "software.options.read", read, _READ_KINDS)
    names: set[str] = set()
    for index, station in enumerate(document["stations"]):
        place = f"stations[{index}]"
        _require(path, place, station, _STATION_KEYS)
        if not isinstance(station["name"], str) or station["name"] in names:
            raise InputError(path, f"the name {station['name']!r} is not a text of its own", place=place)
        names.add(station["name"])
        _check_pose(path, f"{place}.pose", station["pose"])
        _check_kinds(path, place, station, _STATION_KINDS)
        if station.get("scanner_origin_sigma_m") and station.get("scanner_origin") is None:
            raise InputError(path, "is missing", place=f"{place}.scanner_origin")
    for index, link in enumerate(document["links"]):
        place = f"links[{index}]"
        _require(path, place, link, _LINK_KEYS)
        _check_pose(path, f"{place}.transform", link["transform"])
        for end in (link["from"], link["to"]):
            if not isinstance(end, str) or end not in names:
                raise InputError(path, f"there is no station {end!r}", place=place)
    for index, loop in enumerate(document["loops"]):
        _require(path, f"loops[{index}]", loop, _LOOP_KEYS)


def _object(path: Path, place: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(path, "is not an object", place=place)
    return value


def _check_kinds(path: Path, place: str, entry: dict[str, Any], kinds: _Kinds) -> None:
    """Refuse values that are there and of another kind than others rely on."""
    for key, holds in kinds.items():
        if key in entry and not holds(entry[key]):
            raise InputError(path, "is of the wrong kind", place=f"{place}.{key}")


def _require(path: Path, place: str, entry: Any, keys: frozenset[str]) -> None:
    if not isinstance(entry, dict):
        raise InputError(path, "is not an object", place=place)
    missing = sorted(keys - entry.keys())
    if missing:
        raise InputError(path, f"lacks {', '.join(missing)}", place=place)


def _check_pose(path: Path, place: str, rows: Any) -> None:
    if rows is None:
        return
    try:
        pose = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        pose = np.zeros(0)
    rotation = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
    rigid = (
        pose.shape == (4, 4)
        and bool(np.isfinite(pose).all())
        and np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0])
        and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        and np.linalg.det(rotation) > 0.0
    )
    if not rigid:
        raise InputError(path, "is not a rigid motion (4x4, a rotation and a translation)", place=place)
