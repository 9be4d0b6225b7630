"""Attempts to have a wrong tie believed: pairs and whole jobs of places that look alike.

    python -m benchmarks.wrong_ties                # pairs, then jobs
    python -m benchmarks.wrong_ties --page-only    # the page again from the records

Pairs: scans of different places, of one kind and of different kinds, which share nothing; and all pairs within places
that repeat: storeys and rooms that are copies, racks, corridors along which a scan can slide, halls that half a turn
takes onto themselves. Whatever is accepted and not right is listed. Jobs: `trihedral register` on all scans of such a
place, and on scans of two places together; a station that is placed wrongly against the station that carries its
part counts, and whether it was called verified. Records go to JSONL files in the work folder, the page to
benchmarks/results/wrong_ties.md. Exit 1 if there is a wrong tie.
"""

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import pairs, sites
from benchmarks.table import RESULTS, machine, markdown
from benchmarks.truth import SimulatedSite, apart, numbers, prepared, simulate, site_arguments
from trihedral.pair.auto import AutoOptions, register_pair

Record = dict[str, Any]

REPEATING = {
    "floors": pairs.SEEDS["floors"],
    "warehouse": pairs.SEEDS["warehouse"],
    "corridor": "1-4",
    "hall": "1-4",
    "rooms": "1-4",
}
# Of the pairs of places, how many are of one kind; and scans that are paired of each pair of places.
OF_ONE_KIND, SCANS = 0.7, 5
APART = 10_000.0  # metres between the places of a job of two


@dataclass(frozen=True)
class Attempt:
    """Some pairs of one place, or of two that share nothing."""

    kind: str
    first: SimulatedSite
    second: SimulatedSite
    pairs: tuple[tuple[str, str], ...]


def within(places: Iterable[SimulatedSite]) -> Iterator[Attempt]:
    """All pairs of each place."""
    for place in places:
        yield Attempt(
            f"{place.scene}, one place", place, place, tuple((a, b) for a, b, _ in place.pairs(0.0, 1.0))
        )


def across(places: list[SimulatedSite], attempts: int) -> Iterator[Attempt]:
    """About so many pairs of scans of different places, the same at every run."""
    rng = np.random.default_rng(5)
    taken: set[tuple[int, int]] = set()
    scenes = np.array([place.scene for place in places])
    while len(taken) < attempts // SCANS:
        i = int(rng.integers(len(places)))
        alike = (scenes == scenes[i]) == (rng.random() < OF_ONE_KIND)
        alike[i] = False
        if not alike.any():
            continue
        j = int(rng.choice(np.flatnonzero(alike)))
        if (min(i, j), max(i, j)) in taken:
            continue
        taken.add((min(i, j), max(i, j)))
        one, two = (sorted(places[k].poses) for k in (i, j))
        order = rng.permutation(len(two))
        matched = tuple((a, two[k]) for a, k in zip(one, order, strict=False))[:SCANS]
        kind = f"{scenes[i]}, two places" if scenes[i] == scenes[j] else "places of two kinds"
        yield Attempt(kind, places[i], places[j], matched)


def history(attempt: Attempt, work: Path) -> list[Record]:
    """What became of each pair."""
    one_place = attempt.first.folder == attempt.second.folder
    first = {a: prepared(attempt.first, a, work) for a in sorted({a for a, _ in attempt.pairs})}
    second = {b: prepared(attempt.second, b, work) for b in sorted({b for _, b in attempt.pairs})}
    found = []
    for a, b in attempt.pairs:
        link = register_pair(first[a], second[b], AutoOptions())
        one: Record = {
            "kind": attempt.kind,
            "from": f"{attempt.first.scene} {attempt.first.seed} {a}",
            "to": f"{attempt.second.scene} {attempt.second.seed} {b}",
            "overlap": 0.0,
            "verdict": link.verdict.value,
            "reason": link.reason,
            "runner_up": link.runner_up,
            "evidence": pairs.figures(link),
            "right": False,
            "seconds": sum(link.seconds.values()),
        }
        weakest = link.estimate and link.estimate.weakest_direction
        if weakest is not None:
            one["weakest_mm"] = 1e3 * weakest.sigma_m
        if one_place:
            one["overlap"] = attempt.first.overlaps[frozenset((a, b))]
            if link.transform is not None:
                error = apart(attempt.first.b_from_a(a, b), link.transform)
                one |= {"mm": error.mm, "deg": error.deg, "right": not error.wrong}
        found.append(one)
    return found


def job(places: list[SimulatedSite], work: Path) -> Record:
    """Register the scans of one place, or of several together, and look for stations that are where they are not."""
    with tempfile.TemporaryDirectory(dir=work) as temporary:
        folder = Path(temporary)
        stations, overlaps = [], []
        for k, place in enumerate(places):
            for station in place.truth["stations"]:
                (folder / station["file"]).symlink_to(place.folder.resolve() / station["file"])
                pose = np.array(station["project_from_station"])
                pose[0, 3] += k * APART
                stations.append(station | {"project_from_station": pose.tolist()})
            overlaps += place.truth["pairs"]
        done = sites.register(folder, folder / "out", None)
    name = " + ".join(f"{place.scene} {place.seed}" for place in places)
    outcome = sites.compare(name, {"stations": stations, "pairs": overlaps}, done)
    status = {s["name"]: s["status"] for s in done.document["stations"]}
    wrong = {name: error for name, error in outcome.errors.items() if error.wrong}
    return {
        "job": name,
        "stations": outcome.stations,
        "placed": outcome.placed,
        "in_largest": outcome.in_largest,
        "wrong": {name: f"{status[name]}: {error}" for name, error in wrong.items()},
        "wrong_verified": sum(status[name] == "verified" for name in wrong),
        "wrong_links": outcome.wrong_links,
        "failures": [line for line in sites.failures(outcome) if line.startswith("WRONG")],
    }


def line(r: Record) -> str:
    """One accepted pair that is not right."""
    evidence = " ".join(f"{k}={v:.3g}" for k, v in r["evidence"].items())
    error = f"{r['mm']:.1f} mm {r['deg']:.3f} deg" if "mm" in r else "no true pose"
    return (
        f"- {r['kind']}: {r['from']} -> {r['to']}, overlap {r['overlap']:.2f}, {error}; runner-up "
        f"{r['runner_up'] or 0:.2f}; weakest {r.get('weakest_mm', 0):.2f} mm; {evidence}"
    )


VERDICTS = ("accepted", "ambiguous", "doubtful", "refused")


def page(records: list[Record], jobs: list[Record], stated: str) -> str:
    def counts(kind: str, of_kind: list[Record]) -> list[object]:
        verdicts = Counter(r["verdict"] for r in of_kind)
        wrong = sum(r["verdict"] == "accepted" and not r["right"] for r in of_kind)
        return [kind, len(of_kind), wrong, sum(r["right"] for r in of_kind), *(verdicts[v] for v in VERDICTS)]

    kinds = sorted({r["kind"] for r in records})
    lines = [counts(kind, [r for r in records if r["kind"] == kind]) for kind in kinds]
    wrong = [r for r in records if r["verdict"] == "accepted" and not r["right"]]
    head = ["pairs of", "attempts", "accepted and wrong", "best pose right", *VERDICTS]
    job_head = ["job", "stations", "placed", "largest group", "wrong", "wrong and verified", "wrong links"]
    keys = ("job", "stations", "placed", "in_largest", "wrong", "wrong_verified", "wrong_links")
    job_lines = [[len(j[k]) if k == "wrong" else j[k] for k in keys] for j in jobs]
    sums = [sum(int(row[k]) for row in job_lines) for k in range(1, len(keys))]
    parts = [
        "# Wrong ties\n",
        f"Written by `python -m benchmarks.wrong_ties`: {len(records)} attempts on pairs, {len(jobs)} jobs. Wrong: "
        f"more than 10 mm or 0.05 degrees off, or a pair of scans that share nothing. Machine: {stated}.\n",
        markdown(head, [*lines, counts("all", records)]),
        *(["\n## Probability, stated and found\n", table] if (table := pairs.reliability(records)) else []),
        f"\n## Accepted and wrong: {len(wrong)}\n",
        *[line(r) for r in wrong],
        "\n## Whole jobs\n",
        markdown(job_head, [*job_lines, ["all", *sums]]),
        "\n## Stations and links of jobs that are wrong\n",
        *[f"- {j['job']}: {text}" for j in jobs for text in j["failures"]],
    ]
    return "\n".join(parts) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    site_arguments(parser)
    parser.add_argument("--across", type=int, default=750, help="pairs of scans of different places")
    parser.add_argument("--scenes", help="only these, separated by commas")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--skip", choices=("pairs", "jobs"), help="take those from the records")
    parser.add_argument("--page-only", action="store_true", help="read the records, run nothing")
    parser.add_argument("--out", type=Path, default=RESULTS / "wrong_ties.md", help="where the page goes")
    options = parser.parse_args()
    stated = machine()
    wanted = options.scenes.split(",") if options.scenes else [*pairs.SEEDS, *REPEATING]

    def places(seeds: dict[str, str]) -> list[SimulatedSite]:
        return [
            SimulatedSite(scene, seed, simulate(scene, seed, options))
            for scene, text in seeds.items()
            if scene in wanted
            for seed in numbers(text)
        ]

    def kept(name: str, run: bool, work: Callable[[], Iterator[Record]]) -> list[Record]:
        path = options.work / f"wrong_{name}.jsonl"
        if run:
            with path.open("w") as stream:
                for one in work():
                    stream.write(json.dumps(one) + "\n")
                    stream.flush()
        return [json.loads(text) for text in path.read_text().splitlines()] if path.exists() else []

    def of_pairs() -> Iterator[Record]:
        every = places(pairs.SEEDS | REPEATING)
        attempts = [*within(p for p in every if p.scene in REPEATING), *across(every, options.across)]
        with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
            for found in pool.map(history, attempts, [options.work] * len(attempts)):
                for one in found:
                    if one["verdict"] == "accepted" and not one["right"]:
                        print(line(one), flush=True)
                    yield one

    def of_jobs() -> Iterator[Record]:
        repeating = places(REPEATING)
        mixed = [[a, b] for a, b in pairwise(repeating) if a.scene == b.scene]
        for together in [*([place] for place in repeating), *mixed[::2]]:
            one = job(together, options.work)
            print(one, flush=True)
            yield one

    run = not options.page_only
    records = kept("pairs", run and options.skip != "pairs", of_pairs)
    jobs = kept("jobs", run and options.skip != "jobs", of_jobs)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(page(records, jobs, stated))
    print(options.out.read_text())
    bad = any(r["verdict"] == "accepted" and not r["right"] for r in records)
    return 1 if bad or any(j["wrong"] for j in jobs) else 0


if __name__ == "__main__":
    sys.exit(main())
