"""Directions that each pattern measures in, told from the points alone, and their truth."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from trihedral.errors import OptionError
from trihedral.simulate import ScannerOptions, make_site, write_site
from trihedral.simulate.patterns import PATTERNS, RINGS
from trihedral.simulate.scanner import SimulatedScan
from trihedral.simulate.site import Site

# Thin beams and no noise: a point's direction and range are the beam's.
EXACT = ScannerOptions(
    range_noise_m=0.0, signal_noise_m=0.0, angular_noise_arcsec=0.0, mixed_pixels=False, dropout_share=0.0
).with_beams(30_000)


@pytest.fixture(scope="module", params=PATTERNS)
def scanned(request) -> tuple[Site, SimulatedScan]:
    site = make_site("office", 3, 2, EXACT, pattern=request.param)
    return site, site.scan(0)


def angles(rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth, degrees."""
    level = np.hypot(rays[:, 0], rays[:, 1])
    return np.degrees(np.arctan2(rays[:, 2], level)), np.degrees(np.arctan2(rays[:, 1], rays[:, 0]))


def test_points_are_what_a_ray_meets_from_the_true_pose(scanned) -> None:
    site, one = scanned
    length = np.linalg.norm(one.xyz.astype(np.float64), axis=1)
    assert length == pytest.approx(one.true_range, abs=1e-5)
    rays = one.xyz / length[:, None] @ one.project_from_station[:3, :3].T
    direct = (one.kind == 0) & one.fixed
    origin = np.broadcast_to(one.project_from_station[:3, 3], rays.shape)
    _, met = site.still.cast(origin[direct], rays[direct])
    # Rays of float32 points pass edges on the other side now and then.
    assert np.mean(np.abs(met - length[direct]) < 1e-3) > 0.995


def test_beams_are_about_as_many_as_were_asked_for_and_each_is_measured_once(scanned) -> None:
    site, one = scanned
    rows, columns = one.grid
    assert 0.8 * 30_000 < rows * columns < (4.0 if site.pattern == "rings" else 1.1) * 30_000
    assert len(np.unique(one.column.astype(np.int64) * rows + one.row)) == len(one)


def test_directions_are_those_of_the_pattern(scanned) -> None:
    site, one = scanned
    rays = one.xyz / np.linalg.norm(one.xyz.astype(np.float64), axis=1)[:, None]
    elevation, azimuth = angles(rays)
    step = EXACT.angular_step_deg
    rows = [elevation[one.row == row] for row in range(one.grid[0])]
    spread = np.array([np.ptp(row) for row in rows if len(row)])
    if site.pattern in ("regular", "gaps", "rings"):
        assert spread.max() < 1e-3
    if site.pattern == "gaps":
        # Some wedge of five degrees or more has no point at all.
        turn = np.sort(azimuth)
        assert np.diff(np.append(turn, turn[0] + 360.0)).max() >= 5.0 - 2 * step
    if site.pattern == "leaning":
        # A plane of directions, tilted by one to six degrees: a row's elevations swing by twice that.
        low = spread[len(spread) // 2 : -5]
        assert 2.0 * 0.9 < np.median(low) < 2.0 * 6.1
    if site.pattern == "jittered":
        assert 0.5 * step < np.median(spread) <= step * 1.01
        assert len(np.unique(np.round(elevation, 3))) > 10 * one.grid[0]
    if site.pattern == "rings":
        heights = np.array([row.mean() for row in rows if len(row)])
        assert len(heights) == RINGS
        gaps = -np.diff(heights)
        assert (gaps > 0).all() and gaps.max() > 5 * gaps.min()
        assert heights[0] == pytest.approx(15.0, abs=0.1) and heights[-1] == pytest.approx(-25.0, abs=0.1)
        # Turn after turn, never at the same azimuths.
        ring = np.sort(azimuth[one.row == 5] % 360.0)
        assert np.unique(np.round(np.diff(ring), 3)).size > 1
    if site.pattern == "tilting":
        # A half-sphere ahead of the x axis, no more than the fan to the sides.
        assert rays[:, 0].min() > -np.sin(np.radians(6.0))
        sideways = np.degrees(np.arcsin(np.clip(rays[:, 1], -1.0, 1.0)))
        assert max(np.ptp(sideways[(one.row == row) & (rays[:, 0] > 0)]) for row in range(20, 60)) < 1e-3
    if site.pattern == "sweeps":
        # The same azimuths come again in another sweep, half of the points behind the head; below is a gap.
        assert elevation.min() > -56.0
        turns = [azimuth[one.column == column] for column in range(one.grid[1])]
        assert all(
            np.ptp(np.mod(turn, 180.0)) < 1e-2 or np.ptp(np.mod(turn + 90.0, 180.0)) < 1e-2 for turn in turns
        )
        steps = np.array([np.mod(turn[0] - last[0] + 90.0, 180.0) - 90.0 for last, turn in pairwise(turns)])
        assert np.unique(np.round(steps, 2)).size > 3


def test_the_overlap_counts_what_the_pattern_covers(scanned, tmp_path: Path) -> None:
    site, one = scanned
    rays = one.xyz.astype(np.float64)
    assert site.beams(0).covers(rays).all()
    ahead = rays[rays[:, 0] > 0] * [-1.0, 1.0, 1.0]
    if site.pattern == "tilting":
        assert site.beams(0).covers(ahead).mean() < 0.2
    list(write_site(site, tmp_path))
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth.get("pattern", "regular") == site.pattern
    assert ("pattern" in truth) == (site.pattern != "regular")


def test_two_stations_have_other_random_parts_and_a_repeat_has_the_same() -> None:
    site = make_site("office", 3, 2, EXACT, pattern="leaning")
    first, second = site.beams(0).station_from_instrument, site.beams(1).station_from_instrument
    assert not np.allclose(first, second)
    assert np.array_equal(site.scan(0).xyz, site.scan(0).xyz)


def test_an_unknown_pattern_is_refused_with_what_there_is() -> None:
    with pytest.raises(OptionError, match="choose from regular"):
        make_site("office", 3, 2, EXACT, pattern="spiral")
