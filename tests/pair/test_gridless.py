"""Scans whose files keep no rows and columns are believed as those that do."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from support.room import room_scan
from trihedral.geometry.se3 import distance
from trihedral.model.link import LinkVerdict
from trihedral.pair.auto import AutoOptions, register_pair
from trihedral.scan import Scan
from trihedral.scan.preparation import prepare
from trihedral.simulate import ScannerOptions, SimulatedScan, make_site

# A phase scanner of wide beams: at edges whole rows of points lie between two surfaces.
WIDE = ScannerOptions(beam_diameter_m=0.006, beam_divergence_rad=0.0012, pulse_length_m=30.0)
WIDE = WIDE.with_beams(700_000)


def stored(made: SimulatedScan) -> Scan:
    frame = room_scan(step=10)
    content = {"intensity": made.intensity, "color": made.color, "row": made.row, "column": made.column}
    return Scan(frame.header, made.xyz, np.zeros(3), **content)


def gridless(scan: Scan, kept: np.ndarray) -> Scan:
    return replace(
        scan,
        xyz=scan.xyz[kept],
        row=None,
        column=None,
        intensity=None if scan.intensity is None else scan.intensity[kept],
        color=None if scan.color is None else scan.color[kept],
    )


def shuffled(scan: Scan) -> Scan:
    return gridless(scan, np.random.default_rng(1).permutation(len(scan)))


def thinned(scan: Scan) -> Scan:
    """One point a centimetre."""
    voxels = np.floor(scan.xyz / 0.01).astype(np.int64)
    return gridless(scan, np.unique(voxels, axis=0, return_index=True)[1])


@pytest.fixture(scope="module")
def scans() -> tuple[list[Scan], np.ndarray]:
    one, other = list(make_site("office", 11, 2, WIDE, overlap=(0.5, 0.9)))
    truth = np.linalg.inv(other.project_from_station) @ one.project_from_station
    return [stored(one), stored(other)], truth


@pytest.mark.parametrize("export", [shuffled, thinned])
def test_mixed_points_of_a_scan_without_a_grid_do_not_refuse_its_pose(
    scans: tuple[list[Scan], np.ndarray], export: Callable[[Scan], Scan]
) -> None:
    (one, other), truth = scans
    with_grid = register_pair(prepare(one), prepare(other), AutoOptions())
    assert with_grid.verdict is LinkVerdict.ACCEPTED
    without = register_pair(prepare(export(one)), prepare(export(other)), AutoOptions())
    assert without.verdict is LinkVerdict.ACCEPTED, without.reason
    metres, radians = distance(without.estimate.transform, truth)
    assert metres < 0.002 and radians < np.radians(0.02)
