"""The trials: each pair of a testbed registered by ICP, by plane matching, by the overlap rule and by default."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.se3 import Matrix, inverse, motion
from trihedral.initial.visual.alignment import visual_alignment
from trihedral.initial.visual.scan_features import picture_features, prepare_pictured
from trihedral.io import read_headers, read_photos, read_scan
from trihedral.model.link import PairResult
from trihedral.model.paper_evidence import PlanesEvidence
from trihedral.pair.auto import AutoOptions, register_pair
from trihedral.pair.paper import PaperOptions, align_finally
from trihedral.parallel import ordered_map, processors
from trihedral.progress import Progress, Silent
from trihedral.report.against import measures
from trihedral.scan.prepared import Prepared
from trihedral.simulate.rig import RigOptions
from trihedral.simulate.survey import make_testbed
from trihedral.simulate.testbed_files import write_testbed

Pair = tuple[int, int]

# The pairs of each table, by the paper's numbers of its scans, and the testbed they are in.
TABLES: dict[int, dict[str, list[Pair]]] = {
    2: {"testbed1": [(a, b) for gap in range(1, 6) for a in range(1, 7 - gap) for b in [a + gap]]},
    3: {"testbed1": [(1, 4), (4, 6)]},
    4: {"testbed2": [(7, 8), (8, 9)]},
    5: {"testbed3": [(10, 11)]},
    6: {"testbed1": [(1, 4), (4, 6)], "testbed2": [(7, 8), (8, 9)], "testbed3": [(10, 11)]},
}
# What the paper's own initial alignments were off by (Tables 3 to 5): degrees about x, y and z, and metres RMSE.
COARSE_DEG = (7.2, 2.4, 12.3)
COARSE_M = (2.2, 3.0)


@dataclass(frozen=True)
class Trial:
    """One pair in one testbed."""

    seed: int
    testbed: str
    pair: Pair
    distance_m: float
    #: Share of the reference scan (the higher number) under the true pose.
    overlap: float
    #: By way ("pictures-icp", "pictures-planes", "pictures-rule", "coarse-icp", "coarse-planes",
    #: "coarse-largest", "auto"), the measures of `report.against` with verdict, reason and method.
    #: "pictures" begin at the initial alignment by the scans' own pictures, "coarse" at a true pose made as
    #: wrong as the paper's.
    found: dict[str, dict[str, Any]]
    #: ``b_from_a`` or None, by way.
    transforms: dict[str, Matrix | None]
    #: Which planes were matched, by way.
    planes: dict[str, PlanesEvidence]


@dataclass(frozen=True)
class TestbedRun:
    """A simulated testbed, prepared."""

    name: str
    seed: int
    #: By the paper's number, as the scans; project_from_station.
    poses: dict[int, Matrix]
    scans: dict[int, Prepared]


def paper_tables() -> dict[str, Any]:
    """The paper's Tables 2 to 6 as numbers."""
    tables: dict[str, Any] = json.loads((files("trihedral.reproduce") / "paper.json").read_text("utf-8"))
    return tables


def wanted(tables: Sequence[int]) -> dict[str, list[Pair]]:
    """Pairs by testbed that the tables need, each once."""
    pairs: dict[str, list[Pair]] = {}
    for table in tables:
        for testbed, of_table in TABLES[table].items():
            known = pairs.setdefault(testbed, [])
            known += [pair for pair in of_table if pair not in known]
    return pairs


def prepared_testbed(
    name: str,
    seed: int,
    numbers: Sequence[int],
    folder: Path,
    options: PaperOptions,
    points: int,
    threads: int,
    progress: Progress,
) -> TestbedRun:
    """Simulate the testbed as the rig's raw files, read them back, and prepare the scans."""
    survey = make_testbed(name, seed, RigOptions(points=points))
    progress.phase(f"Simulating {name}, seed {seed}", len(survey), "scans", len(survey), "")
    for station, _ in write_testbed(survey, folder):
        progress.advance(station, 1.0)
    first = survey.testbed.first

    def prepared(number: int) -> Prepared:
        header = read_headers(folder / f"scan-{number}.toml")[0]
        return prepare_pictured(read_scan(header), read_photos(header), feature_options=options.features)

    progress.phase(f"Preparing {name}, seed {seed}", len(numbers), "scans", len(numbers), "")
    scans = ordered_map(
        prepared, list(numbers), threads, lambda number, _: progress.advance(f"scan-{number}", 1.0)
    )
    poses = {number: np.asarray(survey.poses[number - first]) for number in numbers}
    return TestbedRun(name, seed, poses, dict(zip(numbers, scans, strict=True)))


def coarse_start(true: Matrix, points: NDArray[np.floating[Any]], key: str) -> Matrix:
    """A true ``b_from_a`` made as wrong as the paper's initial alignments: by angles and RMSE within their ranges.

    The RMSE is over `points` (N, 3) of `a`, metres; the draw derives from `key`.
    """
    rng = np.random.default_rng(list(hashlib.sha256(key.encode()).digest()))
    angles = np.radians(rng.uniform(0.3, 1.0, 3) * COARSE_DEG * rng.choice([-1.0, 1.0], 3))
    turn = np.eye(3)
    for axis, angle in enumerate(angles):
        c, s = np.cos(angle), np.sin(angle)
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        step = np.eye(3)
        step[i, i] = step[j, j] = c
        step[i, j], step[j, i] = -s, s
        turn = step @ turn
    moved = points @ true[:3, :3].T + true[:3, 3]
    centre = moved.mean(axis=0)
    spread = float(np.mean(np.sum(((moved - centre) @ (turn - np.eye(3)).T) ** 2, axis=1)))
    rmse = float(rng.uniform(*COARSE_M))
    # What the turn about the middle of the scan leaves of the RMSE is a shift, mostly level.
    direction = rng.normal(size=3) * [1.0, 1.0, 0.3]
    shift = direction / np.linalg.norm(direction) * np.sqrt(max(rmse**2 - spread, 0.04))
    return motion(turn, centre + shift - turn @ centre) @ true


def run_pair(run: TestbedRun, pair: Pair, options: PaperOptions, auto: bool = True) -> Trial:
    """Register one pair in every way; the higher number is the reference, as in the paper."""
    a, b = run.scans[pair[0]], run.scans[pair[1]]
    true = inverse(run.poses[pair[1]]) @ run.poses[pair[0]]
    of_a, of_b = picture_features(a), picture_features(b)
    points_a, points_b = of_a.points, of_b.points
    key = f"{run.name} {run.seed} {pair}"
    seed = int(hashlib.sha256(key.encode()).hexdigest()[:12], 16)
    visual = visual_alignment(of_a.features, of_b.features, replace(options.visual, seed=seed))
    links: dict[str, PairResult] = {}
    starts = {"pictures": visual.pose, "coarse": coarse_start(true, points_a, key)}
    largest = replace(options, final="planes", planes=replace(options.planes, choice="largest"))
    for origin, start in starts.items():
        if start is None:
            continue
        for final in ("icp", "planes"):
            ways = replace(options, final=final)
            links[f"{origin}-{final}"] = align_finally(a, b, start, seed, ways)
        if origin == "coarse":
            links["coarse-largest"] = align_finally(a, b, start, seed, largest)
        paper = links[f"{origin}-icp"].paper
        assert paper is not None and paper.overlap_initial is not None, "step 3 was run"
        chosen = "icp" if paper.overlap_initial.to >= options.overlap.threshold else "planes"
        links[f"{origin}-rule"] = links[f"{origin}-{chosen}"]
    if auto:
        links["auto"] = register_pair(a, b, AutoOptions())
    found: dict[str, dict[str, Any]] = {}
    for way, link in links.items():
        found[way] = {
            **measures(link.transform, link.initial_transform, true, points_a, points_b),
            "verdict": link.verdict.value,
            "reason": link.reason,
            "method": link.method,
            "seconds": dict(link.seconds),
        }
    if visual.pose is None:
        reason = f"the pictures gave no pose: {visual.reason}"
        found["pictures-rule"] = {"reason": reason, "verdict": "refused"}
    measured = measures(None, None, true, points_a, points_b)
    return Trial(
        run.seed,
        run.name,
        pair,
        measured["distance_m"],
        measured["overlap"]["to"],
        found,
        {way: link.transform for way, link in links.items()},
        {way: k.paper.planes for way, k in links.items() if k.paper and k.paper.planes},
    )


def run_experiments(
    tables: Sequence[int],
    seeds: Sequence[int],
    out: Path,
    *,
    options: PaperOptions | None = None,
    points: int = 600_000,
    threads: int | None = None,
    progress: Progress | None = None,
    each: Callable[[TestbedRun], None] = lambda run: None,
) -> list[Trial]:
    """Run every pair that the tables need, on testbeds of every seed.

    The testbeds' raw files go to `out/testbeds`, with so many `points`, beams, a station; `each` is shown each
    prepared testbed.
    """
    options, progress = options or PaperOptions(), progress or Silent()
    threads = threads or processors()
    trials: list[Trial] = []
    for testbed, pairs in wanted(tables).items():
        for seed in seeds:
            numbers = sorted({number for pair in pairs for number in pair})
            folder = out / "testbeds" / f"{testbed}-{seed}"
            run = prepared_testbed(testbed, seed, numbers, folder, options, points, threads, progress)
            each(run)
            progress.phase(f"Registering {testbed}, seed {seed}", len(pairs), "pairs", len(pairs), "")
            trials += ordered_map(
                partial(run_pair, run, options=options),
                pairs,
                threads,
                lambda pair, _: progress.advance(f"{pair[0]} - {pair[1]}", 1.0),
            )
    return trials
