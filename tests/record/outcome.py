"""What a job gave, short enough to keep: hashes of its numbers, and its verdicts and poses as they are.

Taken from the document that registration.json holds, whose keys stay while the program behind them changes.
"""

import csv
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from tests.record.jobs import JOBS, Job
from threadpoolctl import threadpool_limits

import trihedral
from trihedral.pipeline import Stages, stages

Entry = dict[str, Any]

#: Of an entry: words and evidence, which change when things get other names.
ASIDE = "aside"
#: Of an entry: the poses' rows as numbers, whose bits are kept as hashes.
PLACES = "places"
# Figures of links, loops and looks beside their poses.
_LINK = ("rmse_m", "median_m", "p90_m", "p95_m", "max_m", "free_space_conflict", "runner_up")
_LOOP = ("translation_m", "rotation_deg", "expected_translation_m", "expected_rotation_deg")
_LOOK = ("round", "score", "likeness")


def run(name: str, work: Path, shared: Path, threads: int | None = None) -> Entry:
    """Make a job's scans and register them.

    Parameters
    ----------
    work
        Scans and results go there.
    shared
        Real data lie there.
    """
    # As the command has it: OpenBLAS with threads of its own would split sums by their number.
    with threadpool_limits(1, user_api="blas"):
        job = JOBS[name](work / name, shared)
        if job.trials is not None:
            given = _trials(job.trials)
        else:
            result = trihedral.register(
                job.paths, work / f"{name}-out", steps=_nameless(job.options), threads=threads
            )
            # Reasons name files; where they lie is of no interest.
            document = json.loads(json.dumps(result.document).replace(f"{work}/", ""))
            given = _given(document, job)
    inputs = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in job.inputs}
    return {"found": job.found, "inputs": inputs, **given}


def _nameless(options: trihedral.Options) -> Stages:
    """Take the program's and the options' own texts out of what tells scans apart.

    Which scan of a pair comes first, which one the frame is of and all seeds follow from hashes of the scans and of
    what prepared them: source, compiled core, options as text. With those in it, every comment would give other bits,
    and every build another frame.
    """
    return replace(stages(options), program="record", prepare_options="")


def _given(document: Mapping[str, Any], job: Job) -> Entry:
    pose, figures = (_printed_pose, _printed) if job.printed else (_bits, _bits)
    stations, links, loops, frame = (document[key] for key in ("stations", "links", "loops", "frame"))
    ends = {id(entry): f"{entry['from']} - {entry['to']}" for entry in [*links, *document["looks"]]}
    return {
        "exit": document["verdict"]["exit"],
        "stations": {
            s["name"]: {
                "status": s["status"],
                "part": [s["tied"], s["component"]],
                "pose": pose(s["pose"]),
                "sigmas": figures([s["sigma_translation_m"], s["sigma_rotation_deg"]]),
            }
            for s in stations
        },
        "links": {
            ends[id(k)]: {
                "verdict": k["verdict"],
                "method": k["method"],
                "transform": pose(k["transform"]),
                "initial": pose(k["initial_transform"]),
                "covariance": figures(k["covariance"]),
                "alternatives": [pose(other) for other in k["alternatives"]],
                "figures": figures([*(k[key] for key in _LINK), k["overlap"], k["weakest_direction"]]),
                "network": figures(k["network"]),
            }
            for k in links
        },
        "loops": {
            " - ".join(p["stations"]): {"ok": p["ok"], "figures": figures([p[key] for key in _LOOP])}
            for p in loops
        },
        "looks": {
            ends[id(k)]: {"decision": k["decision"], "figures": figures([k[key] for key in _LOOK])}
            for k in document["looks"]
        },
        "control": {f"{m['point']} in {m['station']}": figures(m) for m in document["control"]},
        "frame": None
        if frame is None
        else {"crs": frame["crs"], "figures": figures({**frame, "text": None})},
        "pairs": figures(document["pairs"]),
        PLACES: {s["name"]: s["pose"][:3] for s in stations if s["pose"] is not None},
        ASIDE: {
            "verdict": _words(document["verdict"]["text"], document["verdict"]["problems"]),
            "frame": frame and _words(frame["text"]),
            "stations": {s["name"]: _words(s["reason"], s["notes"]) for s in stations},
            "links": {ends[id(k)]: _words(k["reason"], k["tried_because"]) for k in links},
            "looks": {ends[id(k)]: _words(k["reason"], k["because"]) for k in document["looks"]},
            "evidence": {ends[id(k)]: _bits(sorted(_numbers(k["evidence"]))) for k in links},
        },
    }


def _trials(path: Path) -> Entry:
    """Figures of a table of trials as they are printed, by pair and way."""
    rows: Entry = {}
    words: Entry = {}
    with path.open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            name = f"{row.pop('testbed')} {row.pop('pair')} {row.pop('way')}"
            words[name] = _words(row.pop("reason"), row.pop("planes"))
            rows[name] = {key: _number(value) for key, value in row.items()}
    return {"trials": rows, ASIDE: {"trials": words}}


def _number(text: str) -> str:
    """Print a number as tables do; leave a word as it is."""
    try:
        return _printed(float(text)) or ""
    except ValueError:
        return text


def _leaves(value: Any) -> Iterator[Any]:
    """Everything in it that holds nothing else, in the order of keys."""
    if isinstance(value, Mapping):
        value = [value[key] for key in sorted(value)]
    if isinstance(value, list | tuple):
        for item in value:
            yield from _leaves(item)
    else:
        yield value


def _numbers(value: Any) -> list[float]:
    """All numbers in it; true is 1."""
    return [float(leaf) for leaf in _leaves(value) if isinstance(leaf, int | float)]


def _bits(value: Any) -> str | None:
    """Hash of the bytes of its numbers, float64 with the lowest first, and of what else is in it."""
    if value is None:
        return None
    parts = (
        np.array(leaf, dtype="<f8").tobytes() if isinstance(leaf, int | float) else repr(leaf).encode()
        for leaf in _leaves(value)
    )
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def _printed(value: Any) -> str | None:
    """All its numbers to the three digits of the paper's tables."""
    return None if value is None else " ".join(f"{round(v, 3) + 0.0:.3f}" for v in _numbers(value))


def _printed_pose(rows: list[list[float]] | None) -> str | None:
    """Metres and degrees about x, y and z."""
    if rows is None:
        return None
    pose = np.array(rows)
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return _printed([*pose[:3, 3].tolist(), *angles.tolist()])


def _words(*texts: Any) -> str:
    return hashlib.sha256(repr(texts).encode()).hexdigest()[:16]
