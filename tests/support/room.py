"""A closed room whose scan is known in every beam."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import motion
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.preparation import prepare

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


def room_view(position, turn_deg, tilt_deg=(0.0, 0.0), seed=1, box=True, origin=(0.0, 0.0, 0.0), paint=None):
    """The room, prepared, from `position` (m from its middle), and project_from_scanner.

    Parameters
    ----------
    box
        Whether a box stands in a corner.
    origin
        Where the scanner stands in the coordinates of its station.
    paint
        Seed of waves of half a metre that its intensity shows; None for a scan without one.
    """
    frame = room_scan(step=0.25, seed=seed, origin=origin, local_origin=origin)
    directions = frame.xyz.astype(np.float64)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rotation = Rotation.from_euler("zyx", [turn_deg, *tilt_deg], degrees=True).as_matrix()
    position = np.array(position)
    rays = directions @ rotation.T
    rays[rays == 0] = 1e-12
    distances = np.min((np.sign(rays) * HALF - position) / rays, axis=1)
    low, high = np.array([1.5, 0.5, -1.5]), np.array([3.0, 2.0, 0.2])
    near = np.minimum((low - position) / rays, (high - position) / rays).max(axis=1)
    far = np.maximum((low - position) / rays, (high - position) / rays).min(axis=1)
    if box:
        distances = np.where((near > 0) & (near < far), np.minimum(near, distances), distances)
    rng = np.random.default_rng(seed)
    distances += 0.002 * rng.standard_normal(len(distances))
    intensity = None
    if paint is not None:
        waves = np.random.default_rng(paint).normal(size=(6, 3))
        waves *= 2 * np.pi / 0.5 / np.linalg.norm(waves, axis=1, keepdims=True)
        shade = np.sin((rays * distances[:, None] + position) @ waves.T).sum(axis=1)
        intensity = (0.45 + 0.05 * shade + 0.02 * rng.standard_normal(len(rays))).astype(np.float32)
    xyz = (directions * distances[:, None]).astype(np.float32)
    scan = Scan(
        frame.header, xyz, frame.local_origin, intensity=intensity, row=frame.row, column=frame.column
    )
    return prepare(scan), motion(rotation, position)


def off_wall(points, half=HALF):
    """Distance of points from the nearest wall, metres."""
    return np.min(np.abs(np.abs(points) - half), axis=1)
