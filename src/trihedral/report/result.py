"""The result as a document, written to registration.json and poses.csv."""

import csv
import dataclasses
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import write_new
from trihedral.job.inputs import natural
from trihedral.model.link import Link
from trihedral.model.paper_evidence import PaperEvidence
from trihedral.model.registration import Loop, PreviewRecord, Registration
from trihedral.model.station import StationResult
from trihedral.verdict.job import judge
from trihedral.verdict.profile import DEFAULT_PROFILE, Profile
from trihedral.version import VERSION

SCHEMA = "trihedral.registration/1"

Document = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Input:
    """A file that the job read."""

    #: As the user gave it.
    path: str
    #: Of its bytes, hexadecimal.
    sha256: str
    bytes: int


def to_document(
    registration: Registration, inputs: Sequence[Input], profile: Profile = DEFAULT_PROFILE
) -> Document:
    """Turn the result into plain lists, numbers and strings in the shape of `trihedral.registration/1`.

    Inputs, stations, links, loops and previews are sorted by name, so the order in which they were given does not show.
    Figures that are not finite become None. Everything that is time lies under `timing` and links' `seconds`.

    Raises
    ------
    ValueError
        A pose holds a number that is not finite: the stage that made it is broken.
    """
    document: Document = {
        "schema": SCHEMA,
        "software": {
            "name": "trihedral",
            "version": VERSION,
            "options": _plain(registration.options),
            "seed": registration.seed,
        },
        "inputs": [dataclasses.asdict(i) for i in sorted(inputs, key=lambda i: (natural(i.path), i.sha256))],
        "verdict": {},
        "stations": [_station(s) for s in sorted(registration.stations, key=lambda s: natural(s.name))],
        "links": [
            {**_link(link), "network": _plain(registration.checks.get((link.from_station, link.to_station)))}
            for link in sorted(registration.links, key=_ends)
        ],
        "loops": [
            _loop(loop)
            for loop in sorted(registration.loops, key=lambda p: [natural(name) for name in p.stations])
        ],
        "looks": [_preview(preview) for preview in sorted(registration.previews, key=_ends)],
        "frame": _plain(registration.frame),
        "control": [
            _plain(miss)
            for miss in sorted(
                registration.control, key=lambda m: (m.check, natural(m.point), natural(m.station))
            )
        ],
        "failures": [
            dataclasses.asdict(f)
            for f in sorted(registration.failures, key=lambda f: (natural(f.path), f.scan_index or 0))
        ],
        "pairs": _plain(registration.pairs),
        "timing": _plain(registration.timing),
    }
    verdict = judge(document, profile)
    document["verdict"] = {**dataclasses.asdict(verdict), "problems": list(verdict.problems)}
    return document


def _ends(pair: Link | PreviewRecord) -> Any:
    return natural(pair.from_station), natural(pair.to_station)


def _station(station: StationResult) -> Document:
    header = station.header
    return {
        "name": station.name,
        "source": str(header.source),
        "scan_index": header.scan_index,
        "format": header.format,
        "points": int(station.points),
        "pose": _matrix(station.pose),
        "tied": bool(station.tied),
        "component": None if station.component is None else int(station.component),
        "status": station.status.value,
        "reason": station.reason,
        "sigma_translation_m": _finite(station.sigma_translation_m),
        "sigma_rotation_deg": _finite(station.sigma_rotation_deg),
        "scanner_origin": _finite(header.scanner_origin),
        "scanner_origin_sigma_m": _finite(header.origin_sigma),
        "notes": list(header.notes),
    }


def _link(link: Link) -> Document:
    estimate = link.estimate
    residuals = estimate and estimate.residuals
    # What a person gave has no surfaces that could know it less in one direction.
    weakest = estimate.weakest_direction if estimate is not None and link.evidence is not None else None
    overlap = _finite((link.overlap_from, link.overlap_to))
    return {
        "from": link.from_station,
        "to": link.to_station,
        "accepted": link.accepted,
        "verdict": link.verdict.value,
        "reason": link.reason,
        "transform": _matrix(link.transform),
        "initial_transform": _matrix(link.initial_transform),
        "method": link.method,
        "overlap": None if overlap is None else {"from": overlap[0], "to": overlap[1]},
        **{
            name: _number(residuals and getattr(residuals, name))
            for name in ("rmse_m", "median_m", "p90_m", "p95_m", "max_m")
        },
        "free_space_conflict": _number(link.free_space_conflict),
        "weakest_direction": weakest and {"axis": _finite(weakest.axis), "sigma_m": _number(weakest.sigma_m)},
        "runner_up": _number(link.runner_up),
        "alternatives": [_matrix(rival.transform) for rival in link.alternatives],
        "covariance": None
        if link.covariance is None or not np.isfinite(link.covariance).all()
        else np.asarray(link.covariance, dtype=np.float64).tolist(),
        "evidence": _plain({**_evidence(link), **_paper_evidence(link.paper)}),
        "seconds": _plain(link.seconds),
        "tried_because": link.tried_because,
    }


def _evidence(link: Link) -> Document:
    """What speaks for a link: figures by name, flags only where they are set."""
    found: Document = {}
    if link.evidence is not None:
        found = dataclasses.asdict(link.evidence)
        # Keys of this schema; what others say stands beside them or elsewhere in the link.
        found["likeness"] = found["appearance_similarity"]
    if link.estimate is not None and link.estimate.covariance is not None and link.evidence is not None:
        found |= {
            "chi_square": link.estimate.chi_square,
            "compared": link.estimate.compared,
            "weakest_rotation_deg": float(np.degrees(link.estimate.weakest_rotation or 0.0)),
        }
    flags = {
        "unseen": link.unseen,
        "contradicted": link.contradicted,
        "confirmed_by_loops": link.confirmed_by_loops,
        "forced": link.decision == "forced",
        "locked": link.decision == "locked",
    }
    for name in flags:
        found.pop(name, None)
    found |= {"hypotheses": link.hypotheses} | {name: True for name, flag in flags.items() if flag}
    return {name: value for name, value in found.items() if value is not None}


def _paper_evidence(found: PaperEvidence | None) -> Document:
    return {} if found is None else {k: v for k, v in _plain(found).items() if v is not None}


def _loop(loop: Loop) -> Document:
    return {
        "stations": list(loop.stations),
        "translation_m": _number(loop.translation_m),
        "rotation_deg": _number(loop.rotation_deg),
        "expected_translation_m": _number(loop.expected_translation_m),
        "ok": bool(loop.ok),
        "expected_rotation_deg": _number(loop.expected_rotation_deg),
    }


def _preview(preview: PreviewRecord) -> Document:
    return {
        "from": preview.from_station,
        "to": preview.to_station,
        "because": preview.because,
        "round": int(preview.round),
        "score": _number(preview.preview.score),
        "likeness": _number(preview.preview.appearance_similarity),
        "decision": "registered" if preview.registered else "passed over",
        "reason": preview.reason,
    }


def _number(value: Any) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _finite(values: Iterable[float | None] | None) -> list[float] | None:
    """All of them, or None when one is missing or not finite."""
    numbers = None if values is None else [_number(value) for value in values]
    return None if numbers is None or None in numbers else [n for n in numbers if n is not None]


def _matrix(pose: NDArray[np.float64] | None) -> list[list[float]] | None:
    if pose is None:
        return None
    pose = np.asarray(pose, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(f"a pose must be 4x4 finite numbers, not {pose!r}")
    rows: list[list[float]] = pose.tolist()
    return rows


def _plain(value: object) -> Any:
    """Options and measurements of any kind as JSON has them; keys sorted."""
    if isinstance(value, Enum):
        return _plain(value.value)
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Path):
        return str(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _plain({f.name.removesuffix("_"): getattr(value, f.name) for f in dataclasses.fields(value)})
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in sorted(value.items(), key=lambda pair: str(pair[0]))}
    if isinstance(value, set | frozenset):
        return sorted((_plain(item) for item in value), key=repr)
    if isinstance(value, Iterable):
        return [_plain(item) for item in value]
    raise TypeError(f"cannot write a {type(value).__name__} into the result")


def write_result(document: Document, path: Path | str) -> None:
    """Write registration.json: one line a station, a link, a loop and a preview; full precision; atomically.

    `OutputError` where it cannot be written.
    """
    entries = []
    for key, value in document.items():
        if isinstance(value, list) and value:
            text = "[\n  " + ",\n  ".join(_dump(item) for item in value) + "\n ]"
        else:
            text = _dump(value)
        entries.append(f" {_dump(key)}: {text}")
    write_new(path, ("{\n" + ",\n".join(entries) + "\n}\n").encode())


def _dump(value: object) -> str:
    # Lone surrogates, which stand for bytes of file names that are not UTF-8, survive only as escapes.
    return json.dumps(value, allow_nan=False, ensure_ascii=True)


POSE_COLUMNS = (
    *("name", "qw", "qx", "qy", "qz", "tx", "ty", "tz"),
    *("sigma_tx_m", "sigma_ty_m", "sigma_tz_m", "sigma_rx_deg", "sigma_ry_deg", "sigma_rz_deg", "status"),
)


def write_poses(document: Document, path: Path | str) -> None:
    """Write poses.csv: each `project_from_station` as unit quaternion (qw >= 0) and translation in metres.

    Numbers are written in full precision; those of a scan that is not placed stay empty. A name that a spreadsheet
    would take for a formula has an apostrophe before it. `OutputError` where the file cannot be written.
    """
    # SciPy's rotations take longer to import than all the rest of this room.
    from scipy.spatial.transform import Rotation

    text = io.StringIO()
    needed, every = (
        csv.writer(text, lineterminator="\n", quoting=quoting)
        for quoting in (csv.QUOTE_MINIMAL, csv.QUOTE_ALL)
    )
    needed.writerow(POSE_COLUMNS)
    for station in document["stations"]:
        pose: list[object] = [None] * 7
        if station["pose"] is not None:
            matrix = np.array(station["pose"])
            x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat(canonical=True).tolist()
            pose = [w, x, y, z, *matrix[:3, 3].tolist()]
        sigmas = [
            *(station["sigma_translation_m"] or [None] * 3),
            *(station["sigma_rotation_deg"] or [None] * 3),
        ]
        name = _cell(station["name"])
        # The writer takes a lone return for no end of a line; readers do.
        writer = every if "\r" in name else needed
        writer.writerow([name, *pose, *sigmas, station["status"]])
    write_new(path, text.getvalue().encode(errors="backslashreplace"))


def _cell(name: str) -> str:
    """Give a name as text, whatever it begins with; one that begins with an apostrophe gets another one."""
    return f"'{name}" if name.startswith(("=", "+", "-", "@", "\t", "\r", "'")) else name
