"""Two scans' points along one piece of wall, which shows how far apart they put it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.report.axes import Axes, Colour, round_down
from trihedral.report.map import hexadecimal
from trihedral.report.section import Clouds
from trihedral.report.wall_offsets import Offset

_BOX = (400.0, 220.0)


@dataclass(frozen=True)
class WallProfile:
    """Two stations' points along a piece of wall, looked at from above, stretched across it."""

    letter: str
    #: Where it lies on the section, drawing units.
    x: float
    y: float
    names: tuple[str, str]
    colours: tuple[str, str]
    millimetres: float
    #: Metres along the wall to either side.
    half_length: float
    #: How many times larger the scale across is than along.
    stretch: float
    #: SVG, in a box of 400 by 220.
    paths: tuple[str, str]
    #: Height of each wall in that box.
    levels: tuple[float, float]
    #: Height in the box, mm.
    ticks: list[tuple[float, float]]


def wall_profile(
    offset: Offset, slabs: Clouds, axes: Axes, colours: Mapping[str, Colour], letter: str
) -> WallProfile:
    """Draw both stations' points along one piece of wall; heights count from the first station's wall."""
    half_length = 0.75
    half_range = max(0.01, 2.5 * abs(offset.metres))
    along = np.array([offset.across[1], -offset.across[0]])
    parts: list[NDArray[np.float64]] = []
    for name in offset.stations:
        step = slabs[name][:, :2] - offset.place
        local = np.stack([step @ along, step @ offset.across, slabs[name][:, 2]], axis=1)
        band = (np.abs(local[:, 0]) <= half_length) & (np.abs(local[:, 1]) <= half_range + 0.02)
        parts.append(local[band])
    base = _over_first(parts)
    width, height = _BOX
    across = 0.5 * height / half_range
    paths = []
    for part, heights in zip(parts, base, strict=True):
        stride = max(1, len(part) // 500)
        inside = np.abs(heights) <= half_range
        x = (part[inside, 0] + half_length) * 0.5 * width / half_length
        y = 0.5 * height - heights[inside] * across
        paths.append("".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[::stride], y[::stride], strict=True)))
    levels = [0.5 * height - metres * across for metres in (0.0, offset.metres)]
    tick = round_down(half_range * 1e3 / 2.0)
    count = int(half_range * 1e3 / tick + 1e-9)
    lines = [(0.5 * height - k * tick * 1e-3 * across, k * tick) for k in range(-count, count + 1)]
    ticks = [line for line in lines if 8.0 <= line[0] <= height - 8.0]
    where = axes.at(offset.place)
    names = offset.stations
    return WallProfile(
        letter,
        *where,
        names,
        (hexadecimal(colours[names[0]]), hexadecimal(colours[names[1]])),
        offset.metres * 1e3,
        half_length,
        across / (0.5 * width / half_length),
        (paths[0], paths[1]),
        (levels[0], levels[1]),
        ticks,
    )


def _over_first(parts: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Heights of both parts (rows of along, across, z) over the plane of the first part's middle metre."""
    first = parts[0][np.abs(parts[0][:, 0]) <= 0.5]
    if len(first) < 6:
        return [part[:, 1] for part in parts]
    middle = first[:, 2].mean()
    design = np.stack([np.ones(len(first)), first[:, 0], first[:, 2] - middle], axis=1)
    for _ in range(2):
        plane = np.linalg.lstsq(design, first[:, 1], rcond=None)[0]
        height = np.abs(first[:, 1] - design @ plane)
        kept = height <= max(2.0 * float(np.sqrt(np.mean(height**2))), 1e-4)
        if kept.sum() < 6:
            break
        first, design = first[kept], design[kept]
    return [
        part[:, 1] - plane[0] - plane[1] * part[:, 0] - plane[2] * (part[:, 2] - middle) for part in parts
    ]
