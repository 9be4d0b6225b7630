"""How far apart scans put the same walls of a section, and where that is most."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64
from trihedral.report.section import Clouds

# Metres: side of the cells that pieces of wall are fitted in.
_CELL = 0.5
# Points that a piece of wall needs.
_FEWEST = 8
# Metres: offsets beyond this are taken for different surfaces.
_MOST_OFFSET = 0.15
# Metres: pieces this near on the same wall have to say the same.
_SUPPORT = 1.0


@dataclass(frozen=True)
class Offset:
    """How far apart two stations put the same piece of wall."""

    stations: tuple[str, str]
    #: (2,) project x, y.
    place: Float64
    #: (2,) unit, towards the scanners.
    across: Float64
    #: Of the second station's wall over the first's, along `across`; median over about 1 m of wall.
    metres: float


def wall_offsets(slabs: Clouds, scanners: Mapping[str, Float64]) -> list[Offset]:
    """Compare the walls of every two stations, piece by piece of half a metre; largest offset first.

    Two pieces are compared when both stations look at them from the same side, they are parallel within 10
    degrees and lie in the same cell. What one place says counts only when the median over a metre of that
    wall says it too, since a cupboard before a wall is no disagreement.

    Slabs are (N, 3) points of each station, scanners (3,) their places, project coordinates, metres.
    """
    names = sorted(name for name in slabs if len(slabs[name]))
    if len(names) < 2:
        return []
    origin = np.min([slabs[name].min(axis=0) for name in names], axis=0)
    found: dict[tuple[int, int], list[Float64]] = {}
    # Two grids, half a cell apart, so that a wall on the border of one lies inside the cells of the other.
    for shift in (0.0, 0.5 * _CELL):
        pieces = [
            _pieces(slabs[name] - origin, scanners[name] - origin, shift, index)
            for index, name in enumerate(names)
        ]
        for first, second, rows in _compare(np.concatenate(pieces)):
            found.setdefault((first, second), []).append(rows)
    offsets = []
    for (first, second), parts in sorted(found.items()):
        for row in _supported(np.concatenate(parts)):
            offsets.append(
                Offset((names[first], names[second]), row[:2] + origin[:2], row[2:4], float(row[4]))
            )
    return sorted(offsets, key=lambda o: -abs(o.metres))


def _pieces(points: Float64, scanner: Float64, shift: float, index: int) -> Float64:
    """Fit planes to one station's pieces of wall: rows of cell key, station, mean, normal towards the scanner."""
    if len(points) < _FEWEST:
        return np.zeros((0, 8))
    cells = np.floor((points[:, :2] + shift) / _CELL).astype(np.int64)
    keys, inverse = np.unique(cells[:, 0] * 2**31 + cells[:, 1], return_inverse=True)
    middle = np.zeros((len(keys), 3))
    middle[:, :2] = (np.stack([keys // 2**31, keys % 2**31], axis=1) + 0.5) * _CELL - shift
    local = points - middle[inverse]  # near zero, so that the sums lose nothing
    mean, normal, across, along, count = _planes(local, inverse, np.ones(len(local)), len(keys))
    # Once more without what stands out by more than two sigmas: frames, sockets, pictures.
    height = np.abs(np.einsum("ij,ij->i", local - mean[inverse], normal[inverse]))
    kept = (height <= 2.0 * np.sqrt(across)[inverse]).astype(np.float64)
    mean, normal, across, along, count = _planes(local, inverse, kept, len(keys))
    normal[np.einsum("ij,ij->i", normal, scanner - mean - middle) < 0.0] *= -1.0
    inside = np.abs(np.einsum("ij,ij->i", normal[:, :2], mean[:, :2])) <= 0.3 * _CELL
    # Upright within 6 degrees, 0.3 m long or more (12 variances of an even spread), thinner than 8 mm (1 sigma):
    # what is rougher or leans is no wall whose place can be read to a millimetre.
    upright = np.abs(normal[:, 2]) <= 0.1
    wall = (count >= _FEWEST) & (12.0 * along >= 0.3**2) & (across <= 0.008**2) & upright & inside
    rows = np.column_stack([keys.astype(np.float64), np.full(len(keys), float(index)), mean + middle, normal])
    kept_rows: Float64 = rows[wall]
    return kept_rows


def _planes(
    points: Float64, cell: NDArray[np.int64], weight: Float64, cells: int
) -> tuple[Float64, Float64, Float64, Float64, Float64]:
    """Fit a plane to the points of each cell: mean, normal, variance across it, variance along it, weight."""
    count = np.bincount(cell, weight, cells)
    safe = np.maximum(count, 1.0)
    mean = (
        np.stack([np.bincount(cell, weight * points[:, k], cells) for k in range(3)], axis=1) / safe[:, None]
    )
    d = points - mean[cell]
    spread = np.zeros((cells, 3, 3))
    for k in range(3):
        for m in range(k, 3):
            spread[:, k, m] = spread[:, m, k] = np.bincount(cell, weight * d[:, k] * d[:, m], cells) / safe
    variances, axes = np.linalg.eigh(spread)
    normal = axes[:, :, 0]
    level = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    level /= np.maximum(np.linalg.norm(level, axis=1), 1e-12)[:, None]
    along: Float64 = np.einsum("ij,ijk,ik->i", level, spread[:, :2, :2], level)
    across: Float64 = np.maximum(variances[:, 0], 0.0)
    return mean, np.array(normal, dtype=np.float64), across, along, np.array(count, dtype=np.float64)


def _compare(pieces: Float64) -> Iterator[tuple[int, int, Float64]]:
    """Each pair of stations with rows of place x y, normal x y, offset."""
    pieces = pieces[np.lexsort((pieces[:, 1], pieces[:, 0]))]
    for lag in range(1, len(pieces)):
        a, b = pieces[:-lag], pieces[lag:]
        same = a[:, 0] == b[:, 0]
        if not same.any():
            return
        a, b = a[same], b[same]
        parallel = np.einsum("ij,ij->i", a[:, 5:8], b[:, 5:8]) > np.cos(np.radians(10.0))
        a, b = a[parallel], b[parallel]
        # Both planes are read at the point half way between the pieces, which takes out their small angle.
        half = 0.5 * (b[:, 2:5] - a[:, 2:5])
        normal = a[:, 5:8] + b[:, 5:8]
        offset = np.einsum("ij,ij->i", half, normal)
        level = normal[:, :2] / np.linalg.norm(normal[:, :2], axis=1)[:, None]
        along = half[:, 0] * level[:, 1] - half[:, 1] * level[:, 0]
        near = (np.abs(offset) <= _MOST_OFFSET) & (np.abs(along) <= 0.3 * _CELL)
        rows = np.column_stack([a[:, 2:4] + half[:, :2], level, offset])[near]
        pairs = a[near][:, 1] * 2**20 + b[near][:, 1]
        for pair in np.unique(pairs):
            yield int(pair) // 2**20, int(pair) % 2**20, rows[pairs == pair]


def _supported(rows: Float64) -> Float64:
    """Keep rows whose wall goes on for three pieces, each offset the median of those within a metre."""
    kept = []
    for row in rows:
        step = rows[:, :2] - row[:2]
        across = np.abs(step @ row[2:4])
        near = (
            (np.linalg.norm(step, axis=1) <= _SUPPORT)
            & (across <= _MOST_OFFSET)
            & (rows[:, 2:4] @ row[2:4] > 0.98)
        )
        if near.sum() >= 3:
            kept.append([*row[:4], float(np.median(rows[near, 4]))])
    return np.array(kept).reshape(-1, 5)


def worst_places(offsets: list[Offset], count: int) -> list[Offset]:
    """Choose the largest offsets, each of another pair and 2 m from the others."""
    chosen: list[Offset] = []
    for offset in offsets:
        apart = all(
            offset.stations != other.stations and np.linalg.norm(offset.place - other.place) > 2.0
            for other in chosen
        )
        if apart:
            chosen.append(offset)
        if len(chosen) == count:
            break
    return chosen
