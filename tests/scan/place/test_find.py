"""Where a scanner stood, found from points alone, against where the simulator had it."""

import numpy as np
import pytest

from support.stations import in_project, one_a_cell, scanner_of, stations
from trihedral.scan.place import find_place, hidden_from, pattern_at, second_place

SHIFT = np.array([312.4, -87.6, 41.3])


def found_in(points):
    return find_place(points, np.random.default_rng(0))


def assert_right(found, truth):
    assert found is not None
    off = found.place - truth
    assert np.linalg.norm(off) < 0.005
    assert (np.abs(off) < 3 * found.sigma).all() and (found.sigma < 0.005).all()


@pytest.mark.parametrize(
    ("scene", "tilt"), [("office", 0.0), ("facade", 0.0), ("site", 0.0), ("gallery", 8.0), ("warehouse", 3.0)]
)
def test_place_of_a_scan_in_project_coordinates_to_the_millimetre(scene, tilt):
    scan = stations(scene, 7, tilt_deg=tilt)[0]
    assert_right(found_in(np.round(in_project(scan, SHIFT), 3)), scanner_of(scan, SHIFT))


def shaky(scan, rng):
    """Recorded directions that are off by ten arc seconds, as an encoder's are."""
    own = scan.xyz.astype(np.float64)
    size = np.linalg.norm(own, axis=1, keepdims=True) * np.radians(10 / 3600)
    return own + size * rng.standard_normal(own.shape)


FORMS = {
    "shaky": shaky,
    "a random fifth": lambda scan, rng: scan.xyz.astype(np.float64)[rng.random(len(scan)) < 0.2],
    "half the circle": lambda scan, rng: scan.xyz.astype(np.float64)[scan.column < scan.grid[1] // 2],
    "cut at a range": lambda scan, rng: scan.xyz.astype(np.float64)[np.linalg.norm(scan.xyz, axis=1) < 7],
    "rows twice as far apart": lambda scan, rng: scan.xyz.astype(np.float64)[scan.row % 2 == 0],
    "on its side": lambda scan, rng: scan.xyz.astype(np.float64)[:, [0, 2, 1]] * [1, -1, 1],
    "upside down": lambda scan, rng: scan.xyz.astype(np.float64) * [1, -1, -1],
    "shuffled": lambda scan, rng: rng.permutation(scan.xyz.astype(np.float64)),
}


@pytest.mark.parametrize("form", FORMS)
def test_place_whatever_became_of_the_points(form):
    scan = stations("office", 7)[0]
    own = FORMS[form](scan, np.random.default_rng(3))
    assert_right(found_in(np.round(in_project(scan, SHIFT, own), 3)), scanner_of(scan, SHIFT))


def test_no_place_where_points_keep_no_directions():
    scan = stations("office", 7)[0]
    cells = one_a_cell(in_project(scan), 0.05)
    centres = (np.floor(cells / 0.05) + 0.5) * 0.05
    assert found_in(centres) is None
    rng = np.random.default_rng(1)
    assert found_in(rng.uniform(-5, 5, (50_000, 3))) is None
    assert found_in(np.column_stack([rng.uniform(-5, 5, (50_000, 2)), np.zeros(50_000)])) is None


def test_sigma_grows_with_what_directions_err_by():
    scan = stations("facade", 7)[0]
    rng, own = np.random.default_rng(3), scan.xyz.astype(np.float64)
    noise = np.linalg.norm(own, axis=1, keepdims=True) * np.radians(90 / 3600)
    coarse = found_in(in_project(scan, SHIFT, own + noise * rng.standard_normal(own.shape)))
    assert_right(coarse, scanner_of(scan, SHIFT))
    assert coarse.sigma.max() > found_in(in_project(scan, SHIFT)).sigma.max()


@pytest.mark.parametrize("scene", ["facade", "site", "warehouse"])
def test_two_stations_merged_have_two_places(scene):
    scans = stations(scene, 7)
    points = np.round(np.concatenate([in_project(scan) for scan in scans]), 3)
    first = pattern_at(points, scanner_of(scans[0]), np.random.default_rng(0))
    assert first is not None
    second = second_place(points, first, np.random.default_rng(0))
    assert second is not None
    assert np.linalg.norm(second.place - scanner_of(scans[1])) < 0.005


@pytest.mark.parametrize("scene", ["office", "facade", "site", "gallery"])
def test_one_scan_has_one_place(scene):
    scan = stations(scene, 7)[0]
    points = np.round(in_project(scan), 3)
    first = pattern_at(points, scanner_of(scan), np.random.default_rng(0))
    assert first is not None and second_place(points, first, np.random.default_rng(0)) is None


@pytest.mark.parametrize("edge", [0.0, 0.02, 0.05, 0.1])
def test_little_is_hidden_from_where_the_scanner_stood_and_much_from_elsewhere(edge):
    scan = stations("office", 7)[0]
    points = one_a_cell(scan.xyz.astype(np.float64), edge) if edge else scan.xyz.astype(np.float64)
    rng = np.random.default_rng(0)
    assert hidden_from(points, np.zeros(3), rng).share < 0.01
    elsewhere = hidden_from(points, np.array([6.0, -4.0, 0.5]), rng)
    assert elsewhere.share > 0.3 and elsewhere.opaque > 0.004


def test_noise_of_centimetres_hides_nothing():
    scan = stations("office", 7)[0]
    own = scan.xyz.astype(np.float64)
    rng = np.random.default_rng(0)
    noisy = own * (1 + rng.normal(0, 0.02, (len(own), 1)) / np.linalg.norm(own, axis=1, keepdims=True))
    assert hidden_from(noisy, np.zeros(3), rng).share < 0.01
