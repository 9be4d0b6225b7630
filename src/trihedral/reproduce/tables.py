"""Tables 2 to 6: the paper's figures beside ours, as rows, CSV and Markdown."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from trihedral.geometry.deviation import deviation_angles, displacement_rmse
from trihedral.geometry.se3 import Matrix, inverse
from trihedral.initial.visual.scan_features import picture_features
from trihedral.model.paper_evidence import PlanesEvidence
from trihedral.reproduce.experiment import TABLES, TestbedRun, Trial, paper_tables

Row = dict[str, Any]
CHAINS = ((1, 4, 6), (7, 8, 9), (10, 11))  # how the paper brings each testbed into one frame


def trial_rows(trials: Iterable[Trial]) -> list[Row]:
    """Everything that was measured, a row for each pair, seed and way: what the CSV holds."""
    rows = []
    for trial in trials:
        for way, found in sorted(trial.found.items()):
            angles = {
                f"{step}_{axis}_deg": None if (deg := found.get(f"{step}_deg")) is None else deg[k]
                for step in ("original", "initial", "final")
                for k, axis in enumerate("xyz")
            }
            rows.append(
                {
                    "testbed": trial.testbed,
                    "seed": trial.seed,
                    "pair": _name(trial.pair),
                    "way": way,
                    "distance_m": trial.distance_m,
                    "overlap": trial.overlap,
                    **{
                        key: found.get(key) for key in ("method", "verdict", "initial_rmse_m", "final_rmse_m")
                    },
                    **angles,
                    "planes": described_planes(trial.planes.get(way)),
                    "reason": found.get("reason"),
                }
            )
    return rows


def described_planes(planes: PlanesEvidence | None) -> str | None:
    """Say which planes were matched: rank by size of each in its own scan, and its points."""
    if planes is None:
        return None
    pairs = zip(planes.from_, planes.to, strict=True)
    return "; ".join(
        f"no. {a.rank} ({a.points} points) on no. {b.rank} ({b.points} points)" for a, b in pairs
    )


def table_2(trials: Sequence[Trial]) -> list[Row]:
    """RMSE (m) of ICP and plane matching for each pair: the paper's, and the median of ours over the seeds."""
    rows = []
    for paper in paper_tables()["table2"]:
        of_pair = [t for t in trials if t.testbed == "testbed1" and _name(t.pair) == paper["pair"]]
        if not of_pair:
            continue
        rows.append(
            {
                "pair": paper["pair"],
                "paper overlap": paper["overlap"],
                "overlap": _median(t.overlap for t in of_pair),
                "paper distance m": paper["distance_m"],
                "distance m": _median(t.distance_m for t in of_pair),
                "paper ICP m": paper["icp_rmse_m"],
                "ICP m": _median_of(of_pair, "coarse-icp"),
                "paper planes m": paper["plane_matching_rmse_m"],
                "planes m": _median_of(of_pair, "coarse-planes"),
                "planes, three largest m": _median_of(of_pair, "coarse-largest"),
                "pictures then rule m": _median_of(of_pair, "pictures-rule"),
                "auto m": _median_of(of_pair, "auto"),
                "seeds": len(of_pair),
                "refused": "; ".join(_refusals(of_pair)) or None,
            }
        )
    return rows


def angle_table(number: int, trials: Sequence[Trial]) -> list[Row]:
    """Tables 3 to 5: deviation angles (deg) and RMSE (m), original, initial and final, of every seed."""
    rows = []
    paper = paper_tables()[f"table{number}"]
    for testbed, pairs in TABLES[number].items():
        for pair in pairs:
            name, says = _name(pair), paper[_name(pair)]
            rows.append(_angle_row(name, "paper", says["overlap"], says["distance_m"], says))
            for trial in (t for t in trials if t.testbed == testbed and t.pair == pair):
                for origin, label in (("pictures", "from its pictures"), ("coarse", "from a coarse start")):
                    found = trial.found.get(f"{origin}-rule")
                    if found is not None:
                        who, auto = f"seed {trial.seed}, {label}", trial.found.get("auto", {})
                        note = _note(found, trial, f"{origin}-rule")
                        rows.append(_angle_row(name, who, trial.overlap, trial.distance_m, found, auto, note))
    return rows


def _angle_row(
    pair: str,
    who: str,
    overlap: float,
    distance: float,
    found: Mapping[str, Any],
    auto: Mapping[str, Any] = MappingProxyType({}),
    note: str | None = None,
) -> Row:
    return {
        "pair": pair,
        "who": who,
        "overlap": overlap,
        "distance m": distance,
        "original deg": _angles(found.get("original_deg")),
        "initial deg": _angles(found.get("initial_deg")),
        "initial m": found.get("initial_rmse_m"),
        "final deg": _angles(found.get("final_deg")),
        "final m": found.get("final_rmse_m"),
        "auto deg": _angles(auto.get("final_deg")),
        "auto m": auto.get("final_rmse_m"),
        "note": note,
    }


def table_6(trials: Sequence[Trial], runs: Sequence[TestbedRun]) -> list[Row]:
    """Each testbed chained into one frame: deviation angles (deg) and RMSE (m) of the first scan seen from the last."""
    rows: list[Row] = []
    paper = paper_tables()["table6"]
    for chain in CHAINS:
        name = "-".join(str(number) for number in chain)
        final = _angles(paper[name]["final_deg"])
        rows.append({"chain": name, "who": "paper", "final deg": final, "final m": paper[name]["rmse_m"]})
        for run in runs:
            if not set(chain) <= run.poses.keys():
                continue
            true = inverse(run.poses[chain[-1]]) @ run.poses[chain[0]]
            of_run = [t for t in trials if (t.testbed, t.seed) == (run.name, run.seed)]
            for way in ("coarse-rule", "pictures-rule", "auto"):
                pose = _chained(chain, way, of_run)
                points, who = picture_features(run.scans[chain[0]]).points, f"seed {run.seed}, {way}"
                final = None if pose is None else _angles(deviation_angles(pose, true))
                rmse = None if pose is None else displacement_rmse(points, pose, true)
                rows.append({"chain": name, "who": who, "final deg": final, "final m": rmse})
    return rows


def _chained(chain: Sequence[int], way: str, trials: Sequence[Trial]) -> Matrix | None:
    total: Matrix = np.eye(4)
    for a, b in pairwise(chain):
        step = next((t.transforms.get(way) for t in trials if t.pair == (a, b)), None)
        if step is None:
            return None
        total = step @ total
    return total


def summary_2(trials: Sequence[Trial]) -> Row:
    """What Table 2 shows: medians over all pairs and seeds, and ICP where scans overlap much and little."""
    ours = [t for t in trials if t.testbed == "testbed1" and t.pair in TABLES[2]["testbed1"]]
    near = [t for t in ours if t.pair[1] - t.pair[0] == 1]
    far = [t for t in ours if t.pair[1] - t.pair[0] >= 3]
    return {
        "trials": len(ours),
        "planes, median m": _median_of(ours, "coarse-planes"),
        "planes, median m, neighbours": _median_of(near, "coarse-planes"),
        "planes, median m, three apart and more": _median_of(far, "coarse-planes"),
        "ICP, median m, neighbours": _median_of(near, "coarse-icp"),
        "ICP, median m, three apart and more": _median_of(far, "coarse-icp"),
        "three largest, median m": _median_of(ours, "coarse-largest"),
        "three largest, refused": sum(t.transforms.get("coarse-largest") is None for t in ours),
        "auto, median m": _median_of(ours, "auto"),
        "tied by their pictures": sum("pictures-icp" in t.found for t in ours),
        "paper's planes, median m": float(
            np.median([row["plane_matching_rmse_m"] for row in paper_tables()["table2"]])
        ),
    }


def as_csv(rows: Sequence[Row]) -> str:
    """Rows with a header; numbers in full."""
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue()


def as_markdown(rows: Sequence[Row]) -> str:
    """Rows as a table; numbers to the millimetre."""
    if not rows:
        return ""
    head = list(rows[0])
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        lines.append("| " + " | ".join(_cell(row.get(key)) for key in head) + " |")
    return "\n".join(lines) + "\n"


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.3f}"
    return str(value).replace("|", "/").replace("\n", " ")


def _name(pair: Sequence[int]) -> str:
    return "-".join(str(number) for number in pair)


def _angles(degrees: Sequence[float] | None) -> str | None:
    return None if degrees is None else ", ".join(f"{angle:.3f}" for angle in degrees)


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.median(known)) if known else None


def _median_of(trials: Sequence[Trial], way: str) -> float | None:
    return _median(t.found.get(way, {}).get("final_rmse_m") for t in trials)


def _refusals(trials: Sequence[Trial]) -> list[str]:
    return [
        f"seed {t.seed}: {t.found['coarse-planes']['reason']}"
        for t in trials
        if t.transforms.get("coarse-planes") is None
    ]


def _note(found: Mapping[str, Any], trial: Trial, way: str) -> str:
    parts = [str(found["reason"])] if found.get("reason") else []
    if found.get("method"):
        parts.append(f"by {found['method']}")
    if found.get("method") == "plane-matching" and (planes := described_planes(trial.planes.get(way))):
        parts.append(f"planes {planes}")
    return "; ".join(parts)
