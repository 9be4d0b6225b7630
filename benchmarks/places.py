"""Where scanners stood, found from points alone, against the truth of simulated scans; what merged scans are taken for.

    python -m benchmarks.places [--scans N] [-o FILE]

Each scan is of a scene, density, tilt and place of its own, and is tried in several forms: in project coordinates up to
1,000 km from the origin, rounded to a millimetre as LAS files are. Two stations of a place make a merged scan.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.table import RESULTS, machine, markdown
from trihedral.geometry.arrays import Float64
from trihedral.scan.place import find_place, hidden_from, second_place
from trihedral.simulate import ScannerOptions, SimulatedScan, make_site

SCENES = (
    "office",
    "corridor",
    "facade",
    "warehouse",
    "gallery",
    "hall",
    "site",
    "estate",
    "building",
    "rooms",
)
Form = Callable[[SimulatedScan, np.random.Generator], Float64]


def _cells(points: Float64, edge: float) -> Float64:
    first = np.unique(np.floor(points / edge), axis=0, return_index=True)[1]
    return points[np.sort(first)]


def _shaky(points: Float64, arc_seconds: float, rng: np.random.Generator) -> Float64:
    sigma = np.linalg.norm(points, axis=1, keepdims=True) * np.radians(arc_seconds / 3600.0)
    return np.asarray(points + sigma * rng.standard_normal(points.shape))


def _xyz(scan: SimulatedScan) -> Float64:
    return scan.xyz.astype(np.float64)


FORMS: dict[str, Form] = {
    "as it is": lambda scan, rng: _xyz(scan),
    "directions shake by 10 arc seconds": lambda scan, rng: _shaky(_xyz(scan), 10.0, rng),
    "every second row": lambda scan, rng: _xyz(scan)[scan.row % 2 == 0],
    "every third column": lambda scan, rng: _xyz(scan)[scan.column % 3 == 0],
    "a window of half the circle": lambda scan, rng: _xyz(scan)[scan.column < scan.grid[1] // 2],
    "cut at 12 m": lambda scan, rng: _xyz(scan)[np.linalg.norm(scan.xyz, axis=1) < 12.0],
    "on its side": lambda scan, rng: _xyz(scan)[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0]),
    "upside down": lambda scan, rng: _xyz(scan) * np.array([1.0, -1.0, -1.0]),
    "a random fifth": lambda scan, rng: _xyz(scan)[rng.random(len(scan)) < 0.2],
    "one a centimetre": lambda scan, rng: _cells(_xyz(scan), 0.01),
    "one every 3 cm": lambda scan, rng: _cells(_xyz(scan), 0.03),
    "one every 5 cm": lambda scan, rng: _cells(_xyz(scan), 0.05),
}


@dataclass
class Tally:
    """What came of the scans of one form."""

    tried: int = 0
    refused: int = 0
    near: int = 0
    within: int = 0
    worst: float = 0.0
    hidden: float = 0.0
    taken_for_several: int = 0
    seconds: float = 0.0

    def row(self) -> list[str]:
        found = self.tried - self.refused
        return [
            str(self.tried), str(self.refused), f"{self.near}/{self.tried}", f"{self.within}/{found}",
            f"{self.worst * 1e3:.2f}", f"{self.hidden:.3f}", str(self.taken_for_several),
            f"{self.seconds / max(self.tried, 1):.1f}",
        ]  # fmt: skip


def sites(count: int) -> Iterator[tuple[str, list[SimulatedScan]]]:
    for k in range(count):
        rng = np.random.default_rng((20, k))
        scene = SCENES[k % len(SCENES)]
        tilt = float(rng.choice([0.0, 0.0, 3.0, 10.0]))
        options = replace(
            ScannerOptions().with_beams(int(rng.integers(200_000, 900_000))), tilt_deg=tilt, color=False
        )
        try:
            site = make_site(scene, seed=100 + k, stations=2, scanner=options)
        except ValueError:
            continue
        yield scene, list(site)


def in_project(scan: SimulatedScan, points: Float64, shift: Float64) -> tuple[Float64, Float64]:
    """Points less a local origin, rounded to a millimetre, and where the scanner is among them."""
    pose = scan.project_from_station
    moved = np.round(points @ pose[:3, :3].T + pose[:3, 3] + shift, 3)
    local = np.round(moved[0] / 100.0) * 100.0
    return (moved - local).astype(np.float32).astype(np.float64), pose[:3, 3] + shift - local


def measure(tally: Tally, points: Float64, truth: Float64) -> None:
    rng = np.random.default_rng(len(points))
    start = time.perf_counter()
    found = find_place(points, rng)
    tally.seconds += time.perf_counter() - start
    tally.tried += 1
    tally.hidden = max(tally.hidden, hidden_from(points, truth, rng).share)
    if found is None:
        tally.refused += 1
        return
    off = np.abs(found.place - truth)
    tally.near += bool(np.linalg.norm(off) < 0.005)
    tally.within += bool((off < 3.0 * found.sigma).all())
    tally.worst = max(tally.worst, float(np.linalg.norm(off)))
    tally.taken_for_several += second_place(points, found, rng) is not None


def merged(scans: list[SimulatedScan], shift: Float64) -> str:
    parts = [_xyz(s) @ s.project_from_station[:3, :3].T + s.project_from_station[:3, 3] for s in scans]
    points = np.round(np.concatenate(parts) + shift, 3)
    local = np.round(points[0] / 100.0) * 100.0
    rng = np.random.default_rng(1)
    found = find_place(points - local, rng)
    if found is None:
        return "no place found"
    return "one scan" if second_place(points - local, found, rng) is None else "several"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scans", type=int, default=20)
    parser.add_argument("-o", "--out", type=Path, default=RESULTS / "places.md")
    given = parser.parse_args()
    load = machine()
    tallies = {name: Tally() for name in FORMS}
    of_merged: dict[str, int] = {}
    for k, (scene, scans) in enumerate(sites(given.scans)):
        rng = np.random.default_rng((21, k))
        shift = np.append(rng.uniform(-1e6, 1e6, 2), rng.uniform(-100.0, 3000.0))
        for name, form in FORMS.items():
            measure(tallies[name], *in_project(scans[0], form(scans[0], rng), shift))
        verdict = merged(scans, shift)
        of_merged[verdict] = of_merged.get(verdict, 0) + 1
        print(f"{k + 1} {scene}: merged: {verdict}", flush=True)
    heading = ["form", "scans", "refused", "within 5 mm", "within 3 sigma of found", "worst, mm"]
    heading += ["most hidden from the true place", "taken for several", "s a scan"]
    rows = [[name, *tally.row()] for name, tally in tallies.items()]
    several = "; ".join(f"{verdict}: {count}" for verdict, count in sorted(of_merged.items()))
    text = f"# Where scanners stood\n\nWritten by `python -m benchmarks.places`. Machine: {load}.\n\n"
    text += (
        f"{markdown(heading, rows)}\nTwo stations of a place merged into one file are taken for: {several}.\n"
    )
    given.out.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
