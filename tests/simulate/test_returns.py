"""Several echoes of a beam: told apart by the pulse, and each where a ray of the beam meets something."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pye57
import pytest

from trihedral.simulate import ScannerOptions, make_site, write_site
from trihedral.simulate.optics import follow

EXACT = ScannerOptions(
    range_noise_m=0.0, signal_noise_m=0.0, angular_noise_arcsec=0.0, dropout_share=0.0
).with_beams(100_000)


@pytest.fixture(scope="module")
def once():
    return make_site("office", 3, 1, EXACT).scan(0)


@pytest.fixture(scope="module")
def twice():
    return make_site("office", 3, 1, replace(EXACT, returns=2))


def beams(one, echo):
    chosen = one.echo == echo
    return one.column[chosen].astype(np.int64) * one.grid[0] + one.row[chosen], one.true_range[chosen], chosen


def test_the_strongest_echoes_are_those_of_a_scanner_that_keeps_one(once, twice) -> None:
    both = twice.scan(0)
    first = beams(both, 0)[2]
    assert not once.echo.any()
    for name in ("xyz", "row", "column", "intensity", "true_range", "kind"):
        assert np.array_equal(getattr(both, name)[first], getattr(once, name)), name


def test_second_echoes_are_of_another_range_and_lie_on_what_the_beam_met(twice) -> None:
    both = twice.scan(0)
    beam, first, _ = beams(both, 0)
    other, second, chosen = beams(both, 1)
    assert len(second) > 50 and len(np.unique(other)) == len(other)
    strongest = dict(zip(beam.tolist(), first.tolist(), strict=True))
    apart = np.array(
        [abs(strongest[b] - r) for b, r in zip(other.tolist(), second, strict=True) if b in strongest]
    )
    assert (apart > EXACT.pulse_length_m * 0.99).mean() > 0.95
    # Rays all over the footprint: some of them goes that far.
    rng = np.random.default_rng(1)
    pose = both.project_from_station
    rays = (both.xyz[chosen] / second[:, None]) @ pose[:3, :3].T
    nearest = np.full(len(rays), np.inf)
    tracer = twice.still
    for _ in range(200):
        off = rng.normal(size=rays.shape)
        off -= (off * rays).sum(axis=1)[:, None] * rays
        off *= np.sqrt(rng.random(len(rays)))[:, None] / np.linalg.norm(off, axis=1)[:, None]
        start = pose[:3, 3] + EXACT.beam_diameter_m / 2 * off
        ray = rays + EXACT.beam_divergence_rad / 2 * off
        # Through panes, as beams go.
        met = follow(tracer, start, ray / np.linalg.norm(ray, axis=1)[:, None]).distance
        nearest = np.minimum(nearest, np.abs(met - second))
    still = both.fixed[chosen]
    assert np.mean(nearest[still] < 0.02) > 0.99


def test_a_file_has_a_cell_for_each_beam_and_weaker_echoes_after_them(twice, tmp_path: Path) -> None:
    one = next(iter(write_site(twice, tmp_path)))
    read = pye57.E57(str(next(tmp_path.glob("*.e57")))).read_scan_raw(0)
    valid = read["cartesianInvalidState"] == 0
    rows, columns = one.grid
    assert valid.sum() == len(one)
    assert len(valid) == rows * columns + (one.echo > 0).sum()
    cell = read["columnIndex"].astype(int) * rows + read["rowIndex"]
    assert np.array_equal(cell[: rows * columns], np.arange(rows * columns))
    xyz = np.stack([read[f"cartesian{a}"] for a in "XYZ"], axis=1)[rows * columns :]
    assert np.array_equal(xyz.astype(np.float32), one.xyz[one.echo > 0])
