"""A closed room whose scan is known in every beam."""

from pathlib import Path

import numpy as np

from trihedral.scan import Scan, ScanHeader

HALF = np.array([4.02, 3.03, 1.51])  # of the room, metres; the scanner stands in its middle


def room_scan(noise=0.002, step=0.2, seed=1, origin=(0.0, 0.0, 0.0), local_origin=(0.0, 0.0, 0.0), half=HALF):
    """A closed room scanned on a grid of `step` degrees."""
    rows, columns = int(150 / step), int(360 / step)
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    elevation = np.radians(-60 + step * row.ravel())
    azimuth = np.radians(step * column.ravel())
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    distance = np.min(half / np.maximum(np.abs(direction), 1e-12), axis=1)
    distance += noise * np.random.default_rng(seed).standard_normal(len(distance))
    origin, local_origin = np.array(origin), np.array(local_origin)
    xyz = direction * distance[:, None] + (origin - local_origin)
    header = ScanHeader(
        source=Path("room.e57"),
        scan_index=0,
        name="room",
        format="e57",
        points=len(xyz),
        grid=(rows, columns),
        has_color=False,
        has_intensity=False,
        photos=0,
        file_pose=None,
        scanner_origin=origin,
        origin_stated=True,
        units="m",
        units_stated=True,
    )
    return Scan(
        header,
        xyz.astype(np.float32),
        local_origin,
        row=row.ravel().astype(np.int32),
        column=column.ravel().astype(np.int32),
    )


def off_wall(points, half=HALF):
    """Distance of points from the nearest wall, metres."""
    return np.min(np.abs(np.abs(points) - half), axis=1)
