"""A simulated pair of scans and the steps of a pair, as the figures call them.

Only this file knows where the steps live.
"""

import json
import tempfile
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trihedral.final.point_to_plane import refine
from trihedral.initial.hypotheses import HypothesisOptions, propose
from trihedral.io import read_headers, read_scan
from trihedral.scan import Scan
from trihedral.scan.preparation import prepare
from trihedral.scan.prepared import Prepared
from trihedral.simulate import ScannerOptions, make_site, write_site
from trihedral.verdict.agreement import compare

Float64 = NDArray[np.float64]


class Pair(NamedTuple):
    """Two scans, as they came and prepared, and the true ``b_from_a``; their scanners are at their origins."""

    scans: tuple[Scan, Scan]
    prepared: tuple[Prepared, Prepared]
    truth: Float64


@cache
def pair() -> Pair:
    """Two scans of an office floor that share half of what they see."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        site = make_site("office", 4, 2, ScannerOptions().with_beams(360_000), overlap=(0.4, 0.6))
        for _ in write_site(site, folder):
            pass
        stations = json.loads((folder / "truth.json").read_text())["stations"]
        first, second = (read_scan(read_headers(folder / f"{one['name']}.e57")[0]) for one in stations)
    a, b = (np.array(one["project_from_station"]) for one in stations)
    return Pair((first, second), (prepare(first), prepare(second)), np.linalg.solve(b, a))


def proposals() -> Float64:
    """(N, 4, 4) poses that the plans propose, best first."""
    return np.array(propose(*pair().prepared, HypothesisOptions()))


def scores(poses: Float64, offset: float, margin: float, samples: int) -> Float64:
    """(N,) what both scanners saw says of each pose, at a tolerance in metres."""
    return compare(*pair().prepared, list(poses), offset=offset, margin=margin, samples=samples).score()


def refined(start: Float64) -> Float64:
    """A refined pose."""
    return refine(*pair().prepared, start).transform
