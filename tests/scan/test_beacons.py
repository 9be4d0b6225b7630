"""A scan is known again in any form, and is never taken for another measurement of the same place."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.stations import one_a_cell, stations
from trihedral.scan.beacons import beacons, same_scan
from trihedral.simulate import ScannerOptions, make_site
from trihedral.simulate.scanner import scan as measure
from trihedral.simulate.snapshot import Snapshot

TURN = Rotation.from_euler("zyx", [140, 20, -65], degrees=True).as_matrix()
OFFSET = np.array([4_000.0, -2_000.0, 300.0])


def copied(points, rng):
    """In another frame and order, rounded to a millimetre."""
    moved = np.round(rng.permutation(points) @ TURN.T + OFFSET, 3)
    return moved - OFFSET


FORMS = {
    "in another frame, rounded": lambda points, rng: points,
    "a random fifth": lambda points, rng: points[rng.random(len(points)) < 0.2],
    "one a centimetre": lambda points, rng: one_a_cell(points, 0.01),
    "one every 5 cm": lambda points, rng: one_a_cell(points, 0.05),
    "cut at a range": lambda points, rng: points[np.linalg.norm(points, axis=1) < 9],
    "one half": lambda points, rng: points[points[:, 0] > 0],
}


@pytest.mark.parametrize("scene", ["office", "facade"])
@pytest.mark.parametrize("form", FORMS)
def test_a_copy_is_known_again(scene, form):
    points, rng = stations(scene, 7)[0].xyz, np.random.default_rng(2)
    copy = copied(FORMS[form](points.astype(np.float64), rng), rng).astype(np.float32)
    assert same_scan(beacons(points), beacons(copy))
    assert same_scan(beacons(copy), beacons(points))


@pytest.mark.parametrize("scene", ["office", "facade", "corridor"])
def test_other_stations_are_others(scene):
    one, other = (beacons(scan.xyz) for scan in stations(scene, 7))
    assert not same_scan(one, other)


@pytest.mark.parametrize("noise", [0.002, 0.0005])
def test_a_second_measurement_from_the_same_tripod_is_no_copy(noise):
    """The beams are the same to the last bit, and only the noise of what they measure differs."""
    options = replace(
        ScannerOptions().with_beams(150_000), color=False, range_noise_m=noise, signal_noise_m=noise / 4
    )
    site = make_site("office", seed=7, stations=2, scanner=options)
    room = Snapshot(site.still, len(site.scene.mesh), site.scene.light, False)
    first, second = (measure(room, site.poses[0], options, (seed,), "a").xyz for seed in (1, 2))
    assert same_scan(beacons(first), beacons(first))
    assert not same_scan(beacons(first), beacons(second))
    rounded = [beacons(np.round(points, 3)) for points in (first, second)]
    assert not same_scan(*rounded)


def test_few_points_are_no_evidence():
    few = np.random.default_rng(0).normal(size=(15, 3)).astype(np.float32)
    assert not same_scan(beacons(few), beacons(few))
