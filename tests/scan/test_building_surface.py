"""Which surface is told to be the building's: walls and ceilings are, the sides of vehicles are not."""

import numpy as np

from support.room import room_scan
from trihedral.scan import Scan
from trihedral.scan.preparation import prepare


def upright(x, y0, y1, z0, z1, step=0.04):
    """Points of a wall across the x axis, with a millimetre of noise."""
    y, z = np.meshgrid(np.arange(y0, y1, step), np.arange(z0, z1, step))
    noise = 0.001 * np.random.default_rng(3).standard_normal(y.size)
    return np.column_stack([x + noise, y.ravel(), z.ravel()])


def street():
    """A facade 12 m ahead, 8 m high, and the side of a van, 4 x 2.4 m, before it; ground all round."""
    x, y = np.meshgrid(np.arange(-10, 12, 0.08), np.arange(-10, 10, 0.08))
    ground = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -1.6)])
    points = np.vstack([ground, upright(12.0, -9, 9, -1.6, 6.4), upright(7.0, -2, 2, -1.3, 1.1)])
    header = room_scan(step=2.0).header
    return prepare(Scan(header, points.astype(np.float32), np.zeros(3)))


def test_a_facade_is_the_buildings_and_a_van_is_not():
    prepared = street()
    x = prepared.surfels.points[:, 0]
    facade = prepared.surfels.planar & (np.abs(x - 12.0) < 0.1) & (prepared.surfels.points[:, 2] > 0)
    van = prepared.surfels.planar & (np.abs(x - 7.0) < 0.05) & (np.abs(prepared.surfels.points[:, 2]) < 0.9)
    assert facade.sum() > 300
    assert van.sum() > 300
    assert prepared.patches.areas[prepared.surfels.patch[van]].min() > 3.0, (
        "as large as what is told to be a wall indoors"
    )
    assert prepared.surfels.static[facade].mean() > 0.95
    assert prepared.surfels.static[van].mean() == 0.0


def test_walls_that_end_at_a_ceiling_are_the_buildings():
    prepared = prepare(room_scan(step=0.25))
    level = np.abs(prepared.surfels.normals[:, 2])
    walls = prepared.surfels.planar & (level < 0.1)
    ceiling = prepared.surfels.planar & (prepared.surfels.normals[:, 2] < -0.9)
    large = prepared.patches.areas[prepared.surfels.patch] >= 3.0
    assert prepared.surfels.static[walls & large].mean() > 0.9
    assert prepared.surfels.static[ceiling & large].mean() > 0.9
