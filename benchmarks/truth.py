"""Simulated sites and their truth: made once, prepared once, and how far a motion is from the true one."""

import argparse
import hashlib
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.table import WORK
from trihedral.geometry.se3 import inverse, motion
from trihedral.pipeline import Options, stages
from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

COMMAND = Path(sys.executable).with_name("trihedral")
# Issue of the project: every placed scan, and every pair, within these of the truth.
WRONG_MM = 10.0
WRONG_DEG = 0.05
# Median of the chi-square distribution of six degrees of freedom.
CHI_SQUARE_MEDIAN = 5.348
# What may be taken from scans: all that they tell of looks, or what a scanner without a camera does not have.
BARE, COLORLESS = ("color", "intensity"), ("color",)


@dataclass(frozen=True)
class Error:
    """How far a motion is from the true one."""

    mm: float
    deg: float

    @property
    def wrong(self) -> bool:
        return not self.within(WRONG_MM, WRONG_DEG)

    def within(self, mm: float, deg: float) -> bool:
        return self.mm <= mm and self.deg <= deg

    def __str__(self) -> str:
        return f"{self.mm:.1f} mm {self.deg:.3f} deg"


def apart(true: Float64, found: Float64) -> Error:
    """Difference of two motions; the translation is that of the station's origin."""
    turn = true[:3, :3].T @ found[:3, :3]
    sine = np.linalg.norm(turn - turn.T) / np.sqrt(8)
    angle = math.atan2(sine, (np.trace(turn) - 1) / 2)
    return Error(float(np.linalg.norm(true[:3, 3] - found[:3, 3])) * 1e3, math.degrees(angle))


def centred(a: Prepared, b: Prepared, b_from_a: Float64) -> Float64:
    """A motion between stations as one between their scanners, which covariances are told about."""
    between: Float64 = motion(None, -b.scanner_origin) @ b_from_a @ motion(None, a.scanner_origin)
    return between


def left_error(true: Float64, found: Float64) -> Float64:
    """(6,) rotation vector and translation of the motion that takes the found pose onto the true one, on the left."""
    rest = true @ inverse(found)
    return np.concatenate([Rotation.from_matrix(rest[:3, :3]).as_rotvec(), rest[:3, 3]])


def normalised_square(error: Float64, covariance: Float64) -> float:
    """Square of an error over its covariance: chi-square of as many degrees of freedom if that is right."""
    return float(error @ np.linalg.solve(covariance, error))


@dataclass(frozen=True)
class SimulatedSite:
    """A folder of scans and what `truth.json` says of them."""

    scene: str
    seed: int
    folder: Path

    @cached_property
    def truth(self) -> dict[str, Any]:
        document: dict[str, Any] = json.loads((self.folder / "truth.json").read_text())
        return document

    @cached_property
    def poses(self) -> dict[str, Float64]:
        """``project_from_station`` by name."""
        return {s["name"]: np.array(s["project_from_station"]) for s in self.truth["stations"]}

    @cached_property
    def overlaps(self) -> dict[frozenset[str], float]:
        return {frozenset((p["a"], p["b"])): float(p["overlap"]) for p in self.truth["pairs"]}

    def file(self, name: str) -> Path:
        return self.folder / next(s["file"] for s in self.truth["stations"] if s["name"] == name)

    def b_from_a(self, a: str, b: str) -> Float64:
        true: Float64 = inverse(self.poses[b]) @ self.poses[a]
        return true

    def pairs(self, least: float, most: float) -> Iterator[tuple[str, str, float]]:
        """Pairs of names whose overlap lies within the bounds, and it."""
        for a, b in combinations(sorted(self.poses), 2):
            overlap = self.overlaps[frozenset((a, b))]
            if least <= overlap <= most:
                yield a, b, overlap


def site_arguments(parser: argparse.ArgumentParser) -> None:
    """Say which sites are simulated, and where they are kept."""
    parser.add_argument("--stations", type=int, default=5)
    parser.add_argument("--points", type=int, default=1_000_000, help="beams a scan")
    parser.add_argument("--noise-mm", type=float, default=2.0)
    parser.add_argument("--tilt", type=float, default=0.0, help="degrees off the level")
    parser.add_argument("--light-changes", action="store_true", help="each scan has its own sun and lamps")
    parser.add_argument("--work", type=Path, default=WORK, help="where simulated sites are kept")


def simulate(scene: str, seed: int, options: argparse.Namespace) -> Path:
    """Make a site, or take the one that an earlier run made with the same options."""
    light = "-light" if options.light_changes else ""
    name = f"{scene}-{seed}-{options.stations}x{options.points}-{options.noise_mm:g}mm-tilt{options.tilt:g}{light}"
    folder: Path = options.work / "sites" / name
    if (folder / "truth.json").exists():
        return folder
    arguments = ("--seed", seed, "--stations", options.stations, "--points", options.points)
    noise = ("--noise-mm", options.noise_mm, "--tilt", options.tilt)
    unfinished = folder.with_name(f"{name}.part")
    unfinished.parent.mkdir(parents=True, exist_ok=True)
    light_changes = ["--light-changes"] if options.light_changes else []
    command = [COMMAND, "simulate", scene, *arguments, *noise, *light_changes, "--out", unfinished, "--quiet"]
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    unfinished.rename(folder)
    return folder


def numbers(text: str) -> list[int]:
    """Read `1-5` or `1,4,7`."""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


def prepared(
    site: SimulatedSite, name: str, work: Path, options: Options | None = None, *, without: Sequence[str] = ()
) -> Any:
    """A scan as pairs need it, `without` "color" or "intensity"; kept in the work folder by what prepared it."""
    steps = stages(options or Options())
    how = steps.prepare_options
    own = "" if how == stages(Options()).prepare_options else hashlib.sha256(how.encode()).hexdigest()[:8]
    folder = "-".join(part for part in (steps.program, own, *(f"no-{what}" for what in without)) if part)
    kept = work / "prepared" / folder / f"{site.folder.name}-{name}.npz"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        scan = steps.read_scan(steps.read_headers(site.file(name))[0])
        scan = replace(scan, **dict.fromkeys(without))
        unfinished = kept.with_suffix(f".{os.getpid()}")
        steps.prepare(scan).save(unfinished)
        unfinished.rename(kept)
    return steps.load(kept)
