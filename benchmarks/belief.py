"""How far poses may be believed: evidence of right and wrong ones, the weights fitted to it, and what they miss.

    python -m benchmarks.belief              # twelve kinds of place, five sensors (about an hour on two cores)
    python -m benchmarks.belief --sites 48   # fewer places
    python -m benchmarks.belief --fit-only   # weights and page again from the table

Every pair of scans of every place is registered with the default method; the evidence of each pose that it refines, and
of the true pose where it found none, is a line of benchmarks/results/belief.csv. The weights of `verdict.evidence` are
the conditional logit's of largest likelihood with a ridge, each with the sign that its meaning asks for
(`scipy.optimize.minimize`). What is shown of a kind of place, and of a sensor, was fitted on the others. Poses that put
a scan into an exact copy of its room, storey or half of a hall are left out of the fit, since nothing in a pair tells
them apart; how many are accepted is shown. The page goes to benchmarks/results/belief.md; it ends with the weights.
"""

import argparse
import csv
import itertools
import pickle
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import beta

from benchmarks.table import RESULTS, WORK, machine, markdown
from benchmarks.truth import COMMAND, SimulatedSite, centred
from trihedral.errors import InputError
from trihedral.final.point_to_plane import refine
from trihedral.geometry.se3 import distance
from trihedral.initial.hypotheses import propose
from trihedral.model.link import LinkEvidence, PoseEstimate
from trihedral.pair.auto import AutoOptions, refine_with_rivals
from trihedral.pipeline import Options, stages
from trihedral.scan.prepared import Prepared
from trihedral.verdict.evidence import WEIGHTS, features, gather
from trihedral.verdict.judgement import JudgementOptions, different
from trihedral.verdict.verification import verify

Float64 = NDArray[np.float64]
Row = dict[str, Any]

KINDS = (
    "office",
    "facade",
    "building",
    "warehouse",
    "corridor",
    "site",
    "floors",
    "rooms",
    "hall",
    "estate",
    "gallery",
    "hotel",
)
SENSORS: dict[str, tuple[object, ...]] = {
    "tof": ("--points", 700_000, "--noise-mm", 2),
    "phase": ("--points", 900_000, "--noise-mm", 1, "--pulse-length", 5, "--beam-mrad", 0.5),
    "coarse": ("--points", 200_000, "--noise-mm", 5, "--max-range", 70),
    "tilting": (
        *("--points", 300_000, "--noise-mm", 6, "--pattern", "tilting"),
        *("--max-range", 60, "--beam-mrad", 3),
    ),
    "rings": (
        *("--points", 200_000, "--noise-mm", 10, "--pattern", "rings"),
        *("--max-range", 100, "--beam-mrad", 2),
    ),
}
# In the order in which sites take them, so that every kind meets every one.
SENSOR_ORDER = ("tof", "coarse", "phase", "tof", "tilting", "tof", "rings")
VARIANTS = ("grid", "nogrid", "grid", "bare", "grid", "nocolor", "nogrid")
OVERLAPS = ((0.3, 0.7), (0.15, 0.4), (0.2, 0.8))
# Kinds of which a scan may stand in an exact copy, turned by a quarter of the circle or not, within so many degrees.
COPIED, COPIED_DEG = ("hall", "rooms", "floors", "corridor", "hotel"), 0.3
# Metres and degrees within which a pose is the right one: precision is another matter.
RIGHT_M, RIGHT_DEG = 0.15, 1.0
# The signs of `WEIGHTS`, and the ridge on standardised ones, of each pair.
SIGNS = (1, -1, 1, -1, -1, -1, -1)
RIDGE = 0.005
SHARED = 0.25


@dataclass(frozen=True)
class Place:
    """A simulated site, the sensor that scans it, and what is kept of the scans."""

    kind: str
    seed: int
    sensor: str
    variant: str
    light_changes: bool

    @property
    def name(self) -> str:
        light = "light" if self.light_changes else "same"
        return f"{self.kind}-{self.seed}-{self.sensor}-{self.variant}-{light}"

    def command(self, folder: Path) -> list[str]:
        stations = 5 if self.kind in ("office", "floors", "rooms", "building") else 4
        overlap = OVERLAPS[self.seed % len(OVERLAPS)]
        words = ["simulate", self.kind, "--seed", self.seed, "--stations", stations, "--overlap", *overlap]
        words += [*SENSORS[self.sensor], "--out", folder, "--quiet"]
        return [str(word) for word in (COMMAND, *words, *(["--light-changes"] * self.light_changes))]


def places(count: int) -> list[Place]:
    """So many places of all kinds in turn, the same at every run."""
    found = []
    for number in range(count):
        row, column = divmod(number, len(KINDS))
        sensor = SENSOR_ORDER[(row + column) % len(SENSOR_ORDER)]
        variant = VARIANTS[(row + 3 * column) % len(VARIANTS)]
        found.append(Place(KINDS[column], 101 + row, sensor, variant, (101 + row + column) % 2 == 0))
    return found


def poses(place: Place, work: Path) -> list[Row]:
    """Refined poses of all pairs of a place, and its prepared scans, made once."""
    kept = work / "rec" / f"{place.name}.pkl"
    if kept.exists():
        found: list[Row] = pickle.loads(kept.read_bytes())["pairs"]
        return found
    folder = work / "sites" / place.name
    subprocess.run(place.command(folder), check=True, stdout=subprocess.DEVNULL)
    site = SimulatedSite(place.kind, place.seed, folder)
    steps, scans = stages(Options()), {}
    for name in site.poses:
        try:
            scan = steps.read_scan(steps.read_headers(site.file(name))[0])
        except InputError as refused:
            print(f"left out: {refused}", file=sys.stderr)
            continue
        without = {"nogrid": ("row", "column"), "bare": ("color", "intensity"), "nocolor": ("color",)}
        scan = replace(scan, **dict.fromkeys(without.get(place.variant, ())))
        scans[name] = steps.prepare(scan)
        scans[name].save(work / "prep" / f"{place.name}-{name}.npz")
    found = []
    for a, b, overlap in site.pairs(0.0, 1.0):
        if a not in scans or b not in scans:
            continue
        true = centred(scans[a], scans[b], site.b_from_a(a, b))
        found.append(
            {
                "a": f"{place.name}-{a}",
                "b": f"{place.name}-{b}",
                "overlap": overlap,
                "true": true,
                "estimates": estimates(scans[a], scans[b]),
                "at_true": refine(scans[a], scans[b], true),
            }
        )
    shutil.rmtree(folder)
    kept.write_bytes(pickle.dumps({"pairs": found}))
    return found


def estimates(a: Prepared, b: Prepared) -> list[PoseEstimate]:
    """The poses that a pair offers."""
    options = AutoOptions()
    ranked = verify(a, b, propose(a, b, options.hypotheses), options.verification)
    return refine_with_rivals(a, b, ranked, options)


@lru_cache(maxsize=8)
def _load(path: Path) -> Any:
    return stages(Options()).load(path)


def rows(place: Place, work: Path) -> list[Row]:
    """The evidence of each pose of a place."""
    found = []
    for pair in poses(place, work):
        a, b = (_load(work / "prep" / f"{pair[end]}.npz") for end in ("a", "b"))
        offered = [(number, one) for number, one in enumerate(pair["estimates"])]
        if not any(_right(one, pair["true"]) for _, one in offered):
            offered.append((-1, pair["at_true"]))
        for number, one in offered:
            evidence = gather(a, b, one, AutoOptions().verification.evidence)
            metres, radians = distance(one.transform, pair["true"])
            found.append(
                {
                    "kind": place.kind,
                    "sensor": place.sensor,
                    "pair": f"{pair['a']} {pair['b'].rsplit('-', 1)[1]}",
                    "overlap": round(pair["overlap"], 4),
                    "pose": number,
                    "right": int(_right(one, pair["true"])),
                    "copy": int(_copy(place, one, pair["true"])),
                    "gate": int(_gated(evidence)),
                    "metres": round(metres, 4),
                    "degrees": round(float(np.degrees(radians)), 3),
                    "seen": "open" if not evidence.enclosed else "unseen" if evidence.unseen else "seen",
                    **{f"x{k}": round(float(value), 4) for k, value in enumerate(features(evidence))},
                }
            )
    return found


def _right(estimate: PoseEstimate, true: Float64) -> bool:
    metres, radians = distance(estimate.transform, true)
    return metres < RIGHT_M and np.degrees(radians) < RIGHT_DEG


def _copy(place: Place, estimate: PoseEstimate, true: Float64) -> bool:
    """Whether a pose puts a scan into what may be an exact copy of where it stood."""
    if place.kind not in COPIED or _right(estimate, true):
        return False
    off = float(np.degrees(distance(estimate.transform, true)[1])) % 90.0
    return min(off, 90.0 - off) < COPIED_DEG


def _gated(evidence: LinkEvidence) -> bool:
    """Whether the verdict refuses or doubts it whatever its probability."""
    limits = JudgementOptions()
    return (
        evidence.held_area_m2 < limits.refused_held
        or evidence.solid_conflict > limits.refused_conflict
        or evidence.strange
        or different(evidence, limits)
    )


@dataclass(frozen=True)
class Table:
    """The evidence of all poses, in columns."""

    x: Float64
    pair: NDArray[np.str_]
    kind: NDArray[np.str_]
    sensor: NDArray[np.str_]
    seen: NDArray[np.str_]
    overlap: Float64
    right: NDArray[np.bool_]
    copy: NDArray[np.bool_]
    #: Offered by the method, not made from the truth.
    offered: NDArray[np.bool_]
    gate: NDArray[np.bool_]

    @classmethod
    def read(cls, path: Path) -> "Table":
        with path.open(encoding="utf-8", newline="") as file:
            lines = list(csv.DictReader(file))

        def column(name: str) -> NDArray[np.str_]:
            return np.array([line[name] for line in lines])

        def flag(name: str) -> NDArray[np.bool_]:
            return column(name) == "1"

        x = np.array([[float(line[f"x{k}"]) for k in range(len(SIGNS))] for line in lines])
        return cls(
            *(x, column("pair"), column("kind"), column("sensor"), column("seen")),
            column("overlap").astype(float),
            *(flag("right"), flag("copy"), column("pose") != "-1", flag("gate")),
        )


def fit(x: Float64, pair: NDArray[np.str_], right: NDArray[np.bool_]) -> Float64:
    """Constant and weights of the conditional logit with "none" among the choices of each pair."""
    mean, spread = x.mean(axis=0), x.std(axis=0) + 1e-9
    z = (x - mean) / spread
    of_pair = np.unique(pair, return_inverse=True)[1]
    ridge = RIDGE * (of_pair.max() + 1)

    def loss(w: Float64) -> tuple[float, Float64]:
        score = np.clip(z @ w[1:] + w[0], -60, 60)
        odds = np.exp(score)
        total = 1 + np.bincount(of_pair, odds)
        rest = right - odds / total[of_pair]
        value = np.log(total).sum() - score[right].sum() + ridge / 2 * w[1:] @ w[1:]
        return float(value), np.concatenate([[-rest.sum()], ridge * w[1:] - rest @ z])

    bounds = [(None, None), *((0, None) if sign > 0 else (None, 0) for sign in SIGNS)]
    w: Float64 = minimize(loss, np.zeros(len(SIGNS) + 1), jac=True, method="L-BFGS-B", bounds=bounds).x
    return np.concatenate([[w[0] - (w[1:] * mean / spread).sum()], w[1:] / spread])


@dataclass(frozen=True)
class Best:
    """The likeliest pose of each pair, judged by weights that were not fitted on its like."""

    rows: NDArray[np.intp]
    probability: Float64
    #: The likeliest of the others, were it the only one.
    standing: Float64


def left_out(table: Table, groups: NDArray[np.str_]) -> Best:
    """Judge each group of pairs with the weights of all others."""
    score = np.zeros(len(table.x))
    fitted = ~table.copy & ~table.gate
    for group in np.unique(groups):
        inside = groups == group
        use = fitted & ~inside
        w = fit(table.x[use], table.pair[use], table.right[use])
        score[inside] = table.x[inside] @ w[1:] + w[0]
    odds = np.where(table.gate | ~table.offered, 0.0, np.exp(np.clip(score, -60, 60)))
    names, of_pair = np.unique(table.pair, return_inverse=True)
    probability = odds / (1 + np.bincount(of_pair, odds)[of_pair])
    order = np.lexsort((-probability, of_pair))
    first = np.searchsorted(of_pair[order], np.arange(len(names)))
    best = order[first]
    rivals = odds / (1 + odds)
    rivals[best] = 0.0
    standing = np.zeros(len(names))
    np.maximum.at(standing, of_pair, rivals)
    return Best(best, probability[best], standing)


def accepted(table: Table, best: Best) -> NDArray[np.bool_]:
    limits = JudgementOptions()
    unseen = table.seen[best.rows] == "unseen"
    least = np.where(unseen, limits.unseen_probability, limits.probability)
    believed: NDArray[np.bool_] = (
        (best.probability >= least) & (best.standing < limits.rival) & ~table.gate[best.rows]
    )
    return believed


def bound(wrong: int, attempts: int) -> float:
    """Upper limit, at 95 %, of the share of which so many were found (Clopper and Pearson, 1934)."""
    return float(beta.ppf(0.95, wrong + 1, attempts - wrong)) if wrong < attempts else 1.0


def by_group(table: Table, best: Best, groups: NDArray[np.str_]) -> Iterator[Sequence[object]]:
    believed = accepted(table, best)
    right, copy, shared = (v[best.rows] for v in (table.right, table.copy, table.overlap))
    known = np.unique(groups)
    for group in [*known, "all"]:
        inside = np.ones(len(groups), bool) if group == "all" else groups == group
        near = inside & (shared >= SHARED)
        wrong = inside & believed & ~right
        yield (
            group,
            int(inside.sum()),
            f"{(near & right).sum()} of {near.sum()}",
            f"{(near & right & believed).sum()} of {(near & right).sum()}",
            f"{(inside & right & believed).sum()} of {(inside & right).sum()}",
            int((wrong & ~copy).sum()),
            int((wrong & copy).sum()),
        )


def reliability(table: Table, best: Best) -> Iterator[Sequence[object]]:
    """Stated probability against found, copies aside."""
    use = ~table.copy[best.rows] & ~table.gate[best.rows]
    p, right = best.probability[use], table.right[best.rows][use]
    edges = (0.0, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)
    for low, high in itertools.pairwise(edges):
        inside = (p >= low) & (p < high if high < 1 else p <= high)
        if inside.any():
            yield (
                f"{low:g} to {high:g}",
                int(inside.sum()),
                f"{p[inside].mean():.3f}",
                f"{right[inside].mean():.3f}",
            )


def page(table: Table) -> str:
    """What the weights rest on, and what they miss."""
    columns = (
        "",
        "pairs",
        "best pose right, from 25 %",
        "of these accepted",
        "accepted of all right",
        "wrong",
        "copies",
    )
    parts = [
        "# Belief\n",
        f"Written by `python -m benchmarks.belief`: {len(np.unique(table.pair))} pairs, {len(table.x)} poses. Right:"
        f" within {RIGHT_M} m and {RIGHT_DEG:g} degrees. Each group is judged with weights fitted on the others."
        " Copies: accepted poses that put a scan into an exact copy of its room, storey, corridor or half of a"
        f" hall; wrong: all others that are accepted and not right. {machine()}\n",
    ]
    for title, left, groups in (
        ("By kind of place, each left out of the fit", table.kind, table.kind),
        ("By sensor, each left out of the fit", table.sensor, table.sensor),
        ("By what is known of the appearance, kinds left out", table.kind, table.seen),
    ):
        best = left_out(table, left)
        lines = list(by_group(table, best, groups[best.rows]))
        wrong, believed = int(str(lines[-1][-2])), int(accepted(table, best).sum())
        most = f"{wrong} of {believed} accepted are wrong and no copies: at most {bound(wrong, believed):.2%} at 95 %."
        parts += [f"## {title}\n", markdown(columns, lines), f"{most}\n"]
    best = left_out(table, table.kind)
    parts += ["## Probability, stated and found (kinds left out, copies aside)\n"]
    parts += [markdown(("stated", "pairs", "mean stated", "share right"), list(reliability(table, best)))]
    use = ~table.copy & ~table.gate
    w = fit(table.x[use], table.pair[use], table.right[use])
    middle = np.median(table.x[use & table.right], axis=0)
    named = [
        (name, f"{weight:.3g}", f"{value:.3g}")
        for name, weight, value in zip(("constant", *WEIGHTS), w, (np.nan, *middle), strict=True)
    ]
    parts += [
        "\n## Weights of all together\n",
        markdown(("evidence", "weight", "median of right poses"), named),
    ]
    return "\n".join(parts) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sites", type=int, default=420)
    parser.add_argument("--work", type=Path, default=WORK / "belief")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--fit-only", action="store_true")
    options = parser.parse_args()
    path = RESULTS / "belief.csv"
    if not options.fit_only:
        for name in ("rec", "prep", "sites"):
            (options.work / name).mkdir(parents=True, exist_ok=True)
        chosen = places(options.sites)
        with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
            found = list(pool.map(rows, chosen, itertools.repeat(options.work)))
        lines = [row for some in found for row in some]
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(lines[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(lines)
    text = page(Table.read(path))
    (RESULTS / "belief.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
