"""All pairs of many simulated sites against their truth: what is right, what is believed, what is missed and where.

    python -m benchmarks.pairs                      # five kinds of place, as many seeds as SEEDS says
    python -m benchmarks.pairs --scenes office --seeds 1-3
    python -m benchmarks.pairs --bare                 # also --colorless, --tilt 20, --noise-mm 6
    python -m benchmarks.pairs --page-only          # the page again from the records

A pair is right when its best pose is within 10 mm and 0.05 degrees of the truth, whatever is believed of it. Of every
pair that is not right the stage that lost it is found: no hypothesis near the truth, none left after selection, another
one scored higher, refinement led away. Records go to a JSONL file, a line a pair; the page to
benchmarks/results/pairs.md.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import pairwise, repeat
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.bound import bounds, least
from benchmarks.table import RESULTS, machine, markdown
from benchmarks.truth import (
    BARE,
    CHI_SQUARE_MEDIAN,
    COLORLESS,
    Error,
    SimulatedSite,
    apart,
    centred,
    left_error,
    normalised_square,
    numbers,
    prepared,
    simulate,
    site_arguments,
)
from trihedral.final.point_to_plane import refine
from trihedral.geometry.se3 import distance
from trihedral.initial.hypotheses import propose
from trihedral.model.link import PairResult
from trihedral.pair.auto import AutoOptions, register_pair
from trihedral.pipeline import Options
from trihedral.scan.prepared import Prepared
from trihedral.verdict.evidence import gather
from trihedral.verdict.verification import rank

Float64 = NDArray[np.float64]
Record = dict[str, Any]

SEEDS = {
    "site": "1-5,11,12,21,22",
    "facade": "1-5,11,12,21,22",
    "office": "1-5,11,12,21,22",
    "warehouse": "11,12,21,22",
    "floors": "11,12,21,22,31-36",
}
CLASSES = ((0.10, 0.25), (0.25, 0.50), (0.50, 0.95))
# A hypothesis from which refinement can reach the truth; a selected pose that is that of the truth.
NEAR = (0.6, np.radians(4.0))
SAME = (0.1, np.radians(1.0))


def overlap_class(overlap: float) -> str:
    low, high = next((c for c in CLASSES if c[0] <= overlap < c[1]), CLASSES[-1])
    return f"{100 * low:.0f}-{100 * high:.0f} %"


def figures(link: PairResult) -> Record:
    """Numbers and flags that speak for a pose and against it, by name."""
    if link.evidence is None or link.estimate is None:
        return {}
    found = asdict(link.evidence) | {
        "unseen": link.unseen,
        "chi_square": link.estimate.chi_square,
        "compared": link.estimate.compared,
        "hypotheses": link.hypotheses,
    }
    return {name: value for name, value in found.items() if isinstance(value, int | float)}


def record(
    a: Prepared, b: Prepared, true: Float64, fisher: Float64, link: PairResult, options: AutoOptions
) -> Record:
    """What became of one pair; `true` is ``b_from_a`` between stations, `fisher` the information in the scans."""
    bound = least(fisher, true)
    found: Record = {
        "verdict": link.verdict.value,
        "reason": link.reason,
        "distance_m": float(np.linalg.norm(true[:3, 3])),
        "runner_up": link.runner_up,
        "overlaps": [link.overlap_from, link.overlap_to],
        "evidence": figures(link),
        "seconds": dict(link.seconds),
        "bound_mm": bound.mm,
        "bound_deg": bound.deg,
    }
    true_centred = centred(a, b, true)
    right = False
    if link.estimate is not None:
        error = apart(true, link.estimate.transform)
        right = not error.wrong
        found |= {"mm": error.mm, "deg": error.deg}
        weakest = link.estimate.weakest_direction
        if weakest is not None:
            found["weakest_mm"] = 1e3 * weakest.sigma_m
        if link.covariance is not None:
            off = left_error(true_centred, centred(a, b, link.estimate.transform))
            found["nees"] = normalised_square(off, link.covariance)
        found["alternative_right"] = any(
            not apart(true, rival.transform).wrong for rival in link.alternatives
        )
    found["right"] = right
    if not right:
        found |= lost(a, b, true_centred, options)
    return found


def lost(a: Prepared, b: Prepared, true: Float64, options: AutoOptions) -> Record:
    """The stage that lost a pair, and how the truth would have scored."""
    proposed = propose(a, b, options.hypotheses)[: options.verification.hypotheses]
    near = next((k for k, pose in enumerate(proposed) if _within(pose, true, NEAR)), None)
    ranked = rank(a, b, proposed, options.verification)
    kept = next((k for k, one in enumerate(ranked) if _within(one.pose, true, SAME)), None)
    at_truth = refine(a, b, true, options.refinement).transform
    off, turn = distance(true, at_truth)
    score = gather(a, b, at_truth, options.verification.evidence).score
    if near is None:
        stage = "no hypothesis near the truth"
    elif kept is None:
        stage = "lost in selection"
    elif kept > 0:
        stage = "another pose scored higher"
    else:
        stage = "refined wrongly"
    return {
        "lost": stage,
        "hypothesis_rank": near,
        "hypotheses": len(proposed),
        "selected_rank": kept,
        "from_truth_mm": 1e3 * off,
        "from_truth_deg": float(np.degrees(turn)),
        "truth_score_ratio": score / ranked[0].score if ranked else None,
    }


def _within(pose: Float64, true: Float64, limits: tuple[float, float]) -> bool:
    off, turn = distance(pose, true)
    return off < limits[0] and turn < limits[1]


def site_records(site: SimulatedSite, work: Path, options: Options, without: Sequence[str]) -> list[Record]:
    """Every pair of one site."""
    scans = {name: prepared(site, name, work, options, without=without) for name in site.poses}
    information = bounds(site, work)
    found = []
    for a, b, overlap in site.pairs(CLASSES[0][0], CLASSES[-1][1]):
        began = time.perf_counter()
        link = register_pair(scans[a], scans[b], options.auto)
        wall = time.perf_counter() - began
        head = {"scene": site.scene, "seed": site.seed, "a": a, "b": b, "overlap": overlap, "wall": wall}
        fisher = information[f"{a} {b}"]
        found.append(head | record(scans[a], scans[b], site.b_from_a(a, b), fisher, link, options.auto))
    return found


def share(records: list[Record], key: str) -> str:
    """`41 of 43 (95 %)`."""
    good = sum(bool(r[key]) for r in records)
    return f"{good} of {len(records)} ({100 * good / len(records):.0f} %)" if records else "-"


HEAD = (
    "scene", "overlap", "best pose right", "or a rival of it", "accepted and right", "accepted and wrong",
    "median mm", "median deg", "mm / bound", "deg / bound", "NEES median / 5.35", "NEES > 16.8",
)  # fmt: skip


def row(scene: str, overlap: str, records: list[Record]) -> list[str]:
    """One line of the table of shares."""
    right = [r for r in records if r["right"]]
    judged = [
        r
        | {
            "believed": r["right"] and r["verdict"] == "accepted",
            "told": r["right"] or (r["verdict"] == "ambiguous" and r["alternative_right"]),
        }
        for r in records
    ]
    wrong = sum(r["verdict"] == "accepted" and not r["right"] for r in records)
    squares = [r["nees"] for r in right if "nees" in r]
    figures = ["-"] * 6
    if right:
        figures = [
            f"{median(r['mm'] for r in right):.2f}",
            f"{median(r['deg'] for r in right):.4f}",
            f"{median(r['mm'] / r['bound_mm'] for r in right):.1f}",
            f"{median(r['deg'] / r['bound_deg'] for r in right):.1f}",
            f"{median(squares) / CHI_SQUARE_MEDIAN:.3f}",
            # 16.8 is the 99th percentile of chi-square with six degrees of freedom.
            f"{100 * float(np.mean(np.array(squares) > 16.81)):.0f} %",
        ]
    return [
        scene,
        overlap,
        share(records, "right"),
        share(judged, "told"),
        share(judged, "believed"),
        str(wrong),
        *figures,
    ]


def shares(records: list[Record]) -> str:
    """The table by scene and class, and over all scenes."""
    lines = []
    scenes = sorted({r["scene"] for r in records})
    names = [f"{100 * low:.0f}-{100 * high:.0f} %" for low, high in CLASSES]
    for scene in [*scenes, "all"]:
        of_scene = [r for r in records if scene in (r["scene"], "all")]
        for name in names:
            lines.append(row(scene, name, [r for r in of_scene if overlap_class(r["overlap"]) == name]))
        wide = [r for r in of_scene if r["overlap"] >= CLASSES[1][0]]
        lines.append(row(scene, "from 25 %", wide))
    return markdown(HEAD, lines)


def reliability(records: list[Record]) -> str:
    """Stated probabilities beside shares that are right, if links state one (`probability` in their evidence)."""
    told = [(r["evidence"]["probability"], r["right"]) for r in records if "probability" in r["evidence"]]
    rows = []
    edges = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999, 1.0)
    for low, high in pairwise(edges):
        part = [(p, good) for p, good in told if low <= p < high or p == high == 1.0]
        if part:
            stated, good = (float(np.mean(column)) for column in zip(*part, strict=True))
            rows.append([f"{low:g} to {high:g}", len(part), f"{stated:.4f}", f"{good:.4f}"])
    return markdown(("stated probability", "pairs", "mean stated", "share right"), rows) if rows else ""


def failures(records: list[Record]) -> Iterator[str]:
    """What is missing, counted: by stage for wrong poses, by reason for right ones that were not believed."""
    for low, high in CLASSES:
        name = f"{100 * low:.0f}-{100 * high:.0f} %"
        of_class = [r for r in records if overlap_class(r["overlap"]) == name]
        stages = Counter((r["lost"], r["scene"]) for r in of_class if not r["right"])
        kinds = Counter(
            (f"right, {r['verdict']}: {plain(r['reason'])}", r["scene"])
            for r in of_class
            if r["right"] and r["verdict"] != "accepted"
        )
        rows = [[what, scene, str(count)] for (what, scene), count in sorted((stages + kinds).items())]
        yield f"\n### {name}\n\n{markdown(('what', 'scene', 'pairs'), rows)}"


def plain(reason: str | None) -> str:
    """A reason without its figures, so that like ones count together."""
    words = (reason or "").split()
    return " ".join("N" if any(c.isdigit() for c in word) else word for word in words)


def line(r: Record) -> str:
    """One pair for a person who tunes the method."""
    error = str(Error(r["mm"], r["deg"])) if "mm" in r else "no pose"
    evidence = " ".join(f"{k}={v:.3g}" for k, v in r["evidence"].items())
    text = (
        f"{r['scene']} {r['seed']} {r['a']} -> {r['b']}: overlap {r['overlap']:.2f}, {r['distance_m']:.0f} m apart, "
        f"bound {r['bound_mm']:.2f} mm {r['bound_deg']:.4f} deg, {error}; {r['verdict']}: {r['reason']}; "
        f"runner-up {r['runner_up'] or 0:.2f}; {evidence}"
    )
    if "lost" in r:
        ratio = r["truth_score_ratio"]
        text += (
            f"; {r['lost']} (hypothesis {r['hypothesis_rank']} of {r['hypotheses']}, selected "
            f"{r['selected_rank']}, from truth {r['from_truth_mm']:.1f} mm {r['from_truth_deg']:.3f} deg, "
            f"truth's score / best {'-' if ratio is None else f'{ratio:.2f}'})"
        )
    return text


def page(records: list[Record], stated: str, made: str) -> str:
    accepted_wrong = [r for r in records if r["verdict"] == "accepted" and not r["right"]]
    wrong = [r for r in records if not r["right"]]
    seconds = np.array([r["wall"] for r in records])
    sites = len({(r["scene"], r["seed"]) for r in records})
    parts = [
        "# Pairs of simulated scans against their truth\n",
        f"Written by `python -m benchmarks.pairs`: {len(records)} pairs of {sites} sites, overlap by area 10 to 95 %; "
        f"{made}. Right: within 10 mm (position of the station) and 0.05 degrees. A rival: the link is ambiguous, "
        "and the right pose is among those it gives. Errors are medians of right poses, and of their ratios to the "
        "Cramer-Rao bound (root mean square; benchmarks/bound.py). NEES is the square of "
        "the error over the stated covariance (six degrees of freedom), of right poses; 1 would be right for its "
        "median over 5.35, and 1 % for the share above 16.8. "
        f"A pair took {np.median(seconds):.2f} s (median, wall, one process among others). "
        f"Machine: {stated}.\n",
        shares(records),
        *(["\n## Probability, stated and found\n", table] if (table := reliability(records)) else []),
        f"\n## Accepted and wrong: {len(accepted_wrong)}\n",
        *[f"- {line(r)}" for r in accepted_wrong],
        "\n## What is missed, and where",
        *failures(records),
        f"\n## Wrong best poses: {len(wrong)}\n",
        *[f"- {line(r)}" for r in wrong],
        "\n## Right, but not accepted\n",
        *[f"- {line(r)}" for r in records if r["right"] and r["verdict"] != "accepted"],
    ]
    return "\n".join(parts) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", default=",".join(SEEDS), help="separated by commas")
    parser.add_argument("--seeds", type=numbers, help="1-5 or 1,4,7; of each scene its own if not given")
    site_arguments(parser)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--bare", action="store_true", help="take colour and intensity away")
    parser.add_argument("--colorless", action="store_true", help="take colour away")
    parser.add_argument("--records", type=Path, help="JSONL; in the work folder if not given")
    parser.add_argument("--page-only", action="store_true", help="read the records, run nothing")
    parser.add_argument("--out", type=Path, default=RESULTS / "pairs.md", help="where the page goes")
    options = parser.parse_args()
    chosen = Options()
    without = BARE if options.bare else COLORLESS if options.colorless else ()
    kept = options.records or options.work / "pairs.jsonl"
    stated = machine()
    if not options.page_only:
        sites = [
            SimulatedSite(scene, seed, simulate(scene, seed, options))
            for scene in options.scenes.split(",")
            for seed in options.seeds or numbers(SEEDS[scene])
        ]
        with (
            kept.open("w") as stream,
            ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool,
        ):
            found_of_sites = pool.map(
                site_records, sites, repeat(options.work), repeat(chosen), repeat(without)
            )
            for site, found in zip(sites, found_of_sites, strict=True):
                for one in found:
                    stream.write(json.dumps(one) + "\n")
                stream.flush()
                believed = sum(r["right"] and r["verdict"] == "accepted" for r in found)
                right = share(found, "right")
                print(f"{site.folder.name}: right {right}, accepted and right {believed}", flush=True)
    records = [json.loads(text) for text in kept.read_text().splitlines()]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    made = (
        f"{options.points:,} beams a scan, range noise {options.noise_mm:g} mm, tilt up to {options.tilt:g} degrees, "
        f"{'without colour and intensity, ' if options.bare else 'without colour, ' if without else ''}"
    )
    options.out.write_text(page(records, stated, made))
    print(shares(records))
    return 1 if any(r["verdict"] == "accepted" and not r["right"] for r in records) else 0


if __name__ == "__main__":
    sys.exit(main())
