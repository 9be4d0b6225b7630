"""Simulated scans of a place, made once a session, and how they look in files of other programs."""

from dataclasses import replace
from functools import cache

import numpy as np

from trihedral.simulate import ScannerOptions, SimulatedScan, make_site


@cache
def stations(
    scene: str, seed: int, beams: int = 200_000, tilt_deg: float = 0.0, count: int = 2
) -> tuple[SimulatedScan, ...]:
    options = replace(ScannerOptions().with_beams(beams), tilt_deg=tilt_deg, color=False)
    return tuple(make_site(scene, seed=seed, stations=count, scanner=options))


def in_project(scan: SimulatedScan, shift=(0.0, 0.0, 0.0), points=None) -> np.ndarray:
    """(N, 3) float64 in project coordinates, as another program registers and shifts them."""
    pose = scan.project_from_station
    own = scan.xyz.astype(np.float64) if points is None else points
    return own @ pose[:3, :3].T + pose[:3, 3] + np.asarray(shift)


def scanner_of(scan: SimulatedScan, shift=(0.0, 0.0, 0.0)) -> np.ndarray:
    return scan.project_from_station[:3, 3] + np.asarray(shift)


def one_a_cell(points: np.ndarray, edge: float) -> np.ndarray:
    """Points thinned in space: the first of each cell stays."""
    first = np.unique(np.floor(points / edge), axis=0, return_index=True)[1]
    return points[np.sort(first)]
