"""Points of what carries the scanner are told from the place by their ranges."""

from dataclasses import replace

import numpy as np
import pytest

from support.room import room_scan
from trihedral.scan.carrier import carrier_range
from trihedral.scan.preparation import prepare


def place(rng: np.random.Generator) -> np.ndarray:
    """Ranges of a room: floor and walls, and little that is nearer than a metre."""
    return np.concatenate([rng.uniform(1.2, 5.0, 80_000), rng.uniform(0.7, 1.2, 800)])


@pytest.mark.parametrize(("nearest", "farthest"), [(0.1, 0.2), (0.35, 0.5), (0.6, 0.9)])
def test_a_robot_under_the_scanner_ends_where_its_points_do(nearest: float, farthest: float) -> None:
    rng = np.random.default_rng(1)
    body = rng.uniform(nearest, farthest, 15_000)
    beyond = rng.uniform(1.3, 6.0, 80_000)
    found = carrier_range(np.concatenate([body, beyond]))
    assert farthest <= found < 1.15 * farthest


def test_what_goes_on_into_the_place_is_of_the_place() -> None:
    rng = np.random.default_rng(2)
    desk = rng.uniform(0.3, 1.3, 20_000)
    assert carrier_range(place(rng)) == 0.0
    assert carrier_range(np.concatenate([desk, place(rng)])) == 0.0


def test_most_of_a_scan_is_never_its_carrier() -> None:
    rng = np.random.default_rng(3)
    assert carrier_range(np.concatenate([rng.uniform(0.8, 1.0, 60_000), rng.uniform(4, 5, 40_000)])) == 0.0


def test_a_carrier_is_in_no_surfel_and_hides_nothing() -> None:
    scan = room_scan()
    rng = np.random.default_rng(4)
    body = rng.normal(0, 1, (4000, 3))
    body *= rng.uniform(0.15, 0.25, (4000, 1)) / np.linalg.norm(body, axis=1, keepdims=True)
    points = np.concatenate([scan.xyz, body.astype(np.float32)])
    carried = replace(scan, xyz=points, row=None, column=None, intensity=None, color=None)
    prepared = prepare(carried)
    assert np.linalg.norm(prepared.surfels.points, axis=1).min() > 0.5
    assert prepared.free_space.nearest[prepared.free_space.nearest > 0].min() > 0.5
    assert any("what carries the scanner" in note for note in prepared.notes)
    assert not any("carries" in note for note in prepare(scan).notes)
