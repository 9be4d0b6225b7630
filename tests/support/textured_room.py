"""A room whose surfaces have a random texture, scanned from anywhere inside at any tilt."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import motion
from trihedral.scan import Scan, ScanHeader

SIZE = np.array([7.0, 5.0, 3.0])  # metres
STEP = 0.3  # degrees


def scan_room(position, rotation_deg, seed=1, look="color", texture_seed=0):
    """A scan and its project_from_station; `look` is "color", "intensity" or None."""
    elevation = np.radians(np.arange(-88.0, 88.0, STEP))
    azimuth = np.radians(np.arange(0.0, 360.0, STEP))
    rows, columns = np.meshgrid(np.arange(len(elevation)), np.arange(len(azimuth)), indexing="ij")
    up, round_ = elevation[rows.ravel()], azimuth[columns.ravel()]
    directions = np.column_stack([np.cos(up) * np.cos(round_), np.cos(up) * np.sin(round_), np.sin(up)])
    rotation = Rotation.from_euler("zyx", rotation_deg, degrees=True).as_matrix()
    position = np.array(position, dtype=np.float64)
    rays = directions @ rotation.T
    distances, grey = looked_at(position, rays, texture_seed)
    rng = np.random.default_rng(seed)
    distances = distances + 0.002 * rng.standard_normal(len(distances))
    grey = np.clip(grey + 0.01 * rng.standard_normal(len(grey)), 0, 1)
    header = ScanHeader(
        Path("room.e57"), 0, "room", "e57", len(rays), None, look == "color", look == "intensity", 0,
        None, np.zeros(3), True, "m", True,
    )  # fmt: skip
    scan = Scan(
        header,
        (directions * distances[:, None]).astype(np.float32),
        np.zeros(3),
        intensity=grey.astype(np.float32) if look == "intensity" else None,
        color=np.rint(255 * grey)[:, None].repeat(3, axis=1).astype(np.uint8) if look == "color" else None,
        row=rows.ravel().astype(np.int32),
        column=columns.ravel().astype(np.int32),
    )
    return scan, motion(rotation, position)


def looked_at(position, rays, texture_seed=0):
    """Distance to the walls and their grey value along rays from a place in the room."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distances = (np.sign(rays) * SIZE / 2 - position) / rays
    wall = np.nan_to_num(distances, nan=np.inf).argmin(axis=1)
    distances = distances[np.arange(len(wall)), wall]
    places = position + rays * distances[:, None]
    grey = np.empty(len(places))
    for axis in range(3):
        for side in (-1, 1):
            on = (wall == axis) & (np.sign(rays[:, axis]) == side)
            grey[on] = texture(np.delete(places[on], axis, axis=1), 10 * texture_seed + 2 * axis + (side > 0))
    return distances, grey


def texture(places, seed):
    """Smooth random values 0..1 at places (N, 2), metres."""
    rng = np.random.default_rng(1000 + seed)
    values = np.full(len(places), 0.5)
    for wavelength, strength in ((0.6, 0.35), (0.25, 0.3), (0.1, 0.15)):
        lattice = rng.uniform(-1, 1, (128, 128))
        scaled = places / wavelength + 64
        cell = np.floor(scaled).astype(int)
        u, v = (3 * (scaled - cell) ** 2 - 2 * (scaled - cell) ** 3).T
        x, y = cell.T
        values += strength * (
            (1 - u) * (1 - v) * lattice[x, y]
            + u * (1 - v) * lattice[x + 1, y]
            + (1 - u) * v * lattice[x, y + 1]
            + u * v * lattice[x + 1, y + 1]
        )
    return np.clip(values, 0, 1)
