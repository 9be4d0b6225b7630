"""Turns between the walls of two scans against the turn that the walls were drawn with."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from trihedral.initial.headings import turns, wall_headings
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.preparation import prepare

STEP = np.radians(0.3)


def scan_of(reach, turn):
    """A scan (turned by so many degrees) of upright surface at a distance `reach(azimuth)` (m), and the ground."""
    azimuth, elevation = np.meshgrid(np.arange(0, 2 * np.pi, STEP), np.arange(-0.7, 0.5, STEP))
    slope = np.tan(elevation.ravel())
    far = np.minimum(reach(azimuth.ravel()), np.where(slope < 0, 1.7 / np.maximum(-slope, 1e-9), np.inf))
    seen = (far < 100) & (far * slope < 9.0)
    far = far + 0.002 * np.random.default_rng(int(turn)).standard_normal(len(far))
    heading = azimuth.ravel() - np.radians(turn)
    xyz = np.column_stack([np.cos(heading), np.sin(heading), slope]) * far[:, None]
    header = ScanHeader(
        Path("walls.e57"), 0, "walls", "e57", int(seen.sum()), azimuth.shape, False, False, 0,
        None, np.zeros(3), True, "m", True,
    )  # fmt: skip
    row, column = np.indices(azimuth.shape)
    grid = (row.ravel()[seen].astype(np.int32), column.ravel()[seen].astype(np.int32))
    return Scan(header, xyz[seen].astype(np.float32), np.zeros(3), row=grid[0], column=grid[1])


def wall(normal_deg, distance):
    """Distance (m) along each azimuth to an endless wall whose foot lies `distance` away towards `normal_deg`."""

    def reach(azimuth):
        cosine = np.cos(azimuth - np.radians(normal_deg))
        return np.where(cosine > 0.2, distance / np.maximum(cosine, 0.2), np.inf)

    return reach


def test_far_walls_say_how_scans_are_turned_though_near_things_are_more_elements():
    # A street seen from two places: the houses are the same, a hut beside each scanner is not.
    houses = (wall(10, 45.0), wall(100, 38.0), wall(217, 50.0))

    def place(hut_deg):
        def reach(azimuth):
            far = np.minimum.reduce([house(azimuth) for house in houses])
            for side in (hut_deg, hut_deg + 90):
                off = np.abs((azimuth - np.radians(side) + np.pi) % (2 * np.pi) - np.pi)
                far = np.where(off < np.radians(46), wall(side, 3.0)(azimuth), far)
            return far

        return reach

    a, b = prepare(scan_of(place(60), 0.0)), prepare(scan_of(place(160), 70.0))
    upright = np.eye(3)

    def rank(scans, turn):
        """Where in the list of turns of the two scans the one of so many degrees comes."""
        found = np.degrees(turns(*(wall_headings(one, upright) for one in scans), 8))
        off = np.abs((found - turn + 180.0) % 360.0 - 180.0)
        return int(np.flatnonzero(off < 1.0)[0]) if (off < 1.0).any() else len(found)

    houses_turn, huts_turn = -70.0, 30.0
    assert rank((a, b), houses_turn) < rank((a, b), huts_turn)
    # Without distances an element is an element, and the huts have most of them.
    near = [
        replace(one, angular_step=np.nan, wide_points=one.wide_points[:0], wide_normals=one.wide_normals[:0])
        for one in (a, b)
    ]
    assert rank(near, huts_turn) < rank(near, houses_turn)
