"""A registration.json read and checked."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from trihedral.errors import InputError
from trihedral.report.result import SCHEMA, Document

_STATION_KEYS = frozenset(
    {"name", "source", "scan_index", "points", "pose", "tied", "component", "status", "reason"}
)
_LINK_KEYS = frozenset({"from", "to", "accepted", "verdict", "reason", "transform", "method", "overlap"})
_LOOP_KEYS = frozenset({"stations", "translation_m", "rotation_deg", "ok"})


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
    try:
        text = path.read_bytes().decode()
    except FileNotFoundError:
        raise InputError(path, "there is no such file", advice="`trihedral register` writes it") from None
    except UnicodeDecodeError as error:
        raise InputError(path, "it is not UTF-8 text", place=f"byte {error.start}") from None
    except OSError as error:
        raise InputError(path, f"it cannot be read ({error.strerror})") from None
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
    names: set[str] = set()
    for index, station in enumerate(document["stations"]):
        place = f"stations[{index}]"
        _require(path, place, station, _STATION_KEYS)
        if not isinstance(station["name"], str) or station["name"] in names:
            raise InputError(path, f"the name {station['name']!r} is not a text of its own", place=place)
        names.add(station["name"])
        _check_pose(path, f"{place}.pose", station["pose"])
    for index, link in enumerate(document["links"]):
        place = f"links[{index}]"
        _require(path, place, link, _LINK_KEYS)
        _check_pose(path, f"{place}.transform", link["transform"])
        for end in (link["from"], link["to"]):
            if end not in names:
                raise InputError(path, f"there is no station {end!r}", place=place)
    for index, loop in enumerate(document["loops"]):
        _require(path, f"loops[{index}]", loop, _LOOP_KEYS)


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
    except (TypeError, ValueError):
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
