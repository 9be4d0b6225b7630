"""Simulated sites, registered by the command and held against their truth.

    python -m benchmarks.sites --scenes office,facade,site --seeds 1-5 --stations 5 --points 1000000

Each site is simulated once and kept in benchmarks/work/. Exit 1 if anything that was placed is wrong.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import psutil

from benchmarks.table import RESULTS, machine, markdown
from benchmarks.truth import COMMAND, Error, apart, numbers, simulate, site_arguments

SCENES = ("office", "facade", "site")


@dataclass(frozen=True)
class Job:
    """One run of the command: its result, and what each phase cost."""

    document: dict[str, Any]
    wall: dict[str, float]  # seconds by phase
    cpu: dict[str, float]  # seconds of all its threads by phase
    peak_mb: float


@dataclass
class Outcome:
    """One site held against its truth."""

    site: str
    stations: int
    pairs: int
    job: Job
    errors: dict[str, Error] = field(default_factory=dict)  # of stations, from the anchor of their component
    links: list[tuple[dict[str, Any], Error | None, float]] = field(
        default_factory=list
    )  # error, true overlap
    placed: int = 0
    in_largest: int = 0

    @property
    def wrong(self) -> int:
        return sum(error.wrong for error in self.errors.values())

    @property
    def wrong_links(self) -> int:
        return sum(link["accepted"] and error is not None and error.wrong for link, error, _ in self.links)


def register(scans: Path, out: Path, threads: int | None) -> Job:
    """Run the command in an empty folder and take its times by phase from what it says of its progress."""
    command = [str(COMMAND), "register", str(scans), "--out", str(out), "--json-progress"]
    if threads:
        command += ["--threads", str(threads)]
    wall: Counter[str] = Counter()
    cpu: Counter[str] = Counter()
    said: list[str] = []
    began = time.perf_counter()
    process = psutil.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    phase, last = "start", (began, 0.0)
    for line in process.stderr:
        said.append(line)
        try:
            message = json.loads(line)
        except json.JSONDecodeError:
            continue
        if "phase" in message:
            used = process.cpu_times()
            now = (time.perf_counter(), used.user + used.system)
            wall[phase] += now[0] - last[0]
            cpu[phase] += now[1] - last[1]
            phase, last = message["phase"], now
    _, code, usage = os.wait4(process.pid, 0)
    wall[phase] += time.perf_counter() - last[0]
    cpu[phase] += usage.ru_utime + usage.ru_stime - last[1]
    status = os.waitstatus_to_exitcode(code)
    if status not in (0, 3, 4):
        raise SystemExit(f"{' '.join(command)} ended with {status}:\n{''.join(said[-20:])}")
    document = json.loads((out / "registration.json").read_text())
    return Job(document, dict(wall), dict(cpu), usage.ru_maxrss / 1024)


def compare(site: str, truth: dict[str, Any], job: Job) -> Outcome:
    """Hold stations against the anchor of their component, and links against the true relative pose."""
    true = {Path(s["file"]).stem: np.array(s["project_from_station"]) for s in truth["stations"]}
    shared = {frozenset((p["a"], p["b"])): p["overlap"] for p in truth["pairs"]}
    stations = {s["name"]: s for s in job.document["stations"]}
    out = Outcome(site, len(true), math.comb(len(true), 2), job)
    components: dict[int, list[str]] = {}
    for name, station in stations.items():
        if station["pose"] is not None:
            components.setdefault(station["component"], []).append(name)
    for names in components.values():
        # The anchor is the station whose pose is the identity; all errors are told from it.
        anchor = min(names, key=lambda n: np.abs(np.array(stations[n]["pose"]) - np.eye(4)).max())
        from_anchor = np.linalg.inv(np.array(stations[anchor]["pose"]))
        truly = np.linalg.inv(true[anchor])
        for name in names:
            if name != anchor:
                found = from_anchor @ np.array(stations[name]["pose"])
                out.errors[name] = apart(truly @ true[name], found)
    # A station alone in its component is tied to nothing, whatever its pose.
    out.placed = sum(len(names) for names in components.values() if len(names) > 1)
    out.in_largest = max((len(names) for names in components.values() if len(names) > 1), default=0)
    for link in job.document["links"]:
        ends = (link["from"], link["to"])
        error = None
        if link["transform"] is not None:
            error = apart(np.linalg.inv(true[ends[1]]) @ true[ends[0]], np.array(link["transform"]))
        out.links.append((link, error, shared.get(frozenset(ends), math.nan)))
    return out


def failures(out: Outcome) -> Iterator[str]:
    """What a person who tunes the method wants to know of a site that is not perfect."""
    stations = out.job.document["stations"]
    for station in stations:
        name = station["name"]
        if name in out.errors and out.errors[name].wrong:
            yield f"WRONG STATION {name} ({station['status']}): {out.errors[name]}"
        elif station["pose"] is None or (name not in out.errors and out.in_largest < out.stations > 1):
            yield f"station {name}: {station['status']}, component {station['component']}: {station['reason']}"
    for link, error, overlap in out.links:
        bad = link["accepted"] and error is not None and error.wrong
        missed = not link["accepted"] and overlap >= 0.2
        right = not link["accepted"] and error is not None and not error.wrong
        if not (bad or missed or right):
            continue
        mark = "WRONG ACCEPTED" if bad else "right, not accepted" if right else "missed"
        evidence = " ".join(f"{k}={v:.3g}" for k, v in link["evidence"].items() if isinstance(v, int | float))
        runner = link["runner_up"]
        yield (
            f"{mark} {link['from']} -> {link['to']}: true overlap {overlap:.2f}, {error or 'no pose'}; "
            f"{link['verdict']}: {link['reason']}; runner-up {'-' if runner is None else f'{runner:.2f}'}; "
            f"conflict {link['free_space_conflict']}; {evidence}"
        )


HEAD = (
    "site", "placed", "largest group", "wrong stations", "links accepted", "wrong accepted", "largest mm",
    "largest deg", "median mm", "CPU s a scan", "CPU s a pair", "wall s", "peak MB",
)  # fmt: skip


def row(name: str, outcomes: list[Outcome]) -> list[str]:
    """One line of the table: a site, or several together."""
    errors = [error for out in outcomes for error in out.errors.values()]
    stations = sum(out.stations for out in outcomes)
    pairs = sum(out.pairs for out in outcomes)

    def cost(phase: str) -> float:
        return sum(out.job.cpu.get(phase, 0.0) for out in outcomes)

    return [
        name,
        f"{sum(out.placed for out in outcomes)}/{stations}",
        str(sum(out.in_largest for out in outcomes)),
        str(sum(out.wrong for out in outcomes)),
        str(sum(link["accepted"] for out in outcomes for link, _, _ in out.links)),
        str(sum(out.wrong_links for out in outcomes)),
        f"{max((e.mm for e in errors), default=math.nan):.2f}" if errors else "-",
        f"{max((e.deg for e in errors), default=math.nan):.4f}" if errors else "-",
        f"{median(e.mm for e in errors):.2f}" if errors else "-",
        f"{cost(PREPARING) / stations:.2f}",
        f"{cost(PAIRING) / pairs:.2f}" if pairs else "-",
        f"{sum(sum(out.job.wall.values()) for out in outcomes):.1f}",
        f"{max(out.job.peak_mb for out in outcomes):.0f}",
    ]


PREPARING = "Preparing scans"
PAIRING = "Registering pairs"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", default=",".join(SCENES), help="separated by commas")
    parser.add_argument("--seeds", type=numbers, default="1-5", help="1-5 or 1,4,7")
    site_arguments(parser)
    parser.add_argument("--threads", type=int, help="as of `trihedral register`")
    parser.add_argument("--out", type=Path, default=RESULTS / "sites.md", help="where the table goes")
    parser.add_argument("--log", type=Path, help="append what went wrong, pair by pair, as it is found")
    options = parser.parse_args()

    stated = machine()
    outcomes: list[Outcome] = []
    for seed in options.seeds:
        for scene in options.scenes.split(","):
            scans = simulate(scene, seed, options)
            truth = json.loads((scans / "truth.json").read_text())
            with tempfile.TemporaryDirectory(dir=options.work) as out:
                job = register(scans, Path(out), options.threads)
            outcome = compare(f"{scene} {seed}", truth, job)
            outcomes.append(outcome)
            found = [f"## {outcome.site}: {' | '.join(row('', [outcome])[1:])}", *failures(outcome)]
            print("\n".join(found), flush=True)
            if options.log:
                with options.log.open("a") as stream:
                    stream.write("\n".join(found) + "\n")
    lines = [row(out.site, [out]) for out in outcomes]
    for scene in options.scenes.split(","):
        lines.append(row(f"all {scene}", [out for out in outcomes if out.site.split()[0] == scene]))
    lines.append(row("all", outcomes))
    table = markdown(HEAD, lines)
    print(table)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(
        "# Simulated sites against their truth\n\n"
        f"Written by `python -m benchmarks.sites`: {options.stations} stations a site, {options.points:,} beams "
        f"a scan, range noise {options.noise_mm:g} mm, tilt up to {options.tilt:g} degrees. "
        f"Machine: {stated}.\n\n{table}"
    )
    return 1 if any(out.wrong for out in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
