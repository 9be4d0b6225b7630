"""Planes through thinly seen points against the walls that the points were drawn on."""

from pathlib import Path

import numpy as np

from trihedral.geometry.se3 import distance, motion
from trihedral.initial.plan.proposals import PlanOptions, plan_poses
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.preparation import prepare
from trihedral.scan.sparse_planes import NEAREST, sparse_planes

STEP = np.radians(0.3)
# Walls 9 m high around an open square, as corners from which and to which each runs.
WALLS = (((-70, 52), (64, 52)), ((64, 52), (64, -20)), ((-70, 52), (-70, 8)), ((-70, 8), (-96, 8)))


def wall_points(rng, distance_m, along, up):
    """Beams on a wall across the x axis, with 3 mm of noise."""
    y, z = np.meshgrid(np.arange(-20, 20, along), np.arange(-1.5, 10, up))
    points = np.column_stack([np.full(y.size, distance_m), y.ravel(), z.ravel()])
    return points * (1 + 0.003 * rng.standard_normal(len(points)) / np.linalg.norm(points, axis=1))[:, None]


def test_beams_metres_apart_tell_the_wall_that_they_lie_on():
    rng = np.random.default_rng(3)
    for along, up in ((0.4, 0.4), (1.5, 0.35), (0.35, 1.2)):
        found = sparse_planes(wall_points(rng, 80.0, along, up).astype(np.float32))
        assert len(found) > 100
        assert np.degrees(np.arccos(np.clip(-found.normals[:, 0], -1, 1))).max() < 3.0, (
            "they face the scanner"
        )


def test_bushes_and_single_points_are_on_no_plane():
    rng = np.random.default_rng(4)
    bush = (np.array([40.0, 0.0, 0.0]) + rng.uniform(-2, 2, (3000, 3))).astype(np.float32)
    assert len(sparse_planes(bush)) < 0.05 * len(bush)
    assert len(sparse_planes(bush[: NEAREST - 1])) == 0


def square_scan(place, turn):
    """An open square scanned from a place (m) and turned (degrees): its ground is near, its walls are far."""
    azimuth, elevation = np.meshgrid(np.arange(0, 2 * np.pi, STEP), np.arange(-1.0, 0.4, STEP))
    heading = azimuth.ravel() + np.radians(turn)
    level = np.column_stack([np.cos(heading), np.sin(heading)])
    slope = np.tan(elevation.ravel())
    reach = np.where(slope < 0, -1.7 / np.minimum(slope, -1e-9), 1e6)
    for start, end in WALLS:
        start, along = np.array(start) - place, np.subtract(end, start)
        across = level[:, 0] * along[1] - level[:, 1] * along[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (start[0] * along[1] - start[1] * along[0]) / across
            part = (start[0] * level[:, 1] - start[1] * level[:, 0]) / across
        hit = (far > 0) & (part >= 0) & (part <= 1) & (far * slope < 9.0)
        reach = np.where(hit, np.minimum(reach, far), reach)
    seen = reach < 120
    reach = reach + 0.003 * np.random.default_rng(int(turn)).standard_normal(len(reach))
    station = np.column_stack([np.cos(azimuth.ravel()), np.sin(azimuth.ravel()), slope]) * reach[:, None]
    header = ScanHeader(
        Path("square.e57"), 0, "square", "e57", int(seen.sum()), azimuth.shape, False, False, 0,
        None, np.zeros(3), True, "m", True,
    )  # fmt: skip
    row, column = (index.ravel()[seen].astype(np.int32) for index in np.indices(azimuth.shape))
    scan = Scan(header, station[seen].astype(np.float32), np.zeros(3), row=row, column=column)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    return scan, motion(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.array([*place, 1.7]))


def test_scans_that_share_only_walls_too_far_for_planes_are_brought_together():
    (a, a_pose), (b, b_pose) = (square_scan(*at) for at in ((np.array([-22.0, 4.0]), 20), ((18.0, -9.0), 75)))
    a, b = prepare(a), prepare(b)
    true = np.linalg.inv(b_pose) @ a_pose
    for scan in (a, b):
        above_ground = scan.surfels.points[:, 2] > -1.0
        assert scan.thin[above_ground].mean() > 0.5, "most of the walls have no planes of their own"
    off, turned = distance(plan_poses(a, b, PlanOptions())[0][0], true)
    assert off < 0.5 and np.degrees(turned) < 2.0
