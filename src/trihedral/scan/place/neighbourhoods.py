"""Small planar pieces of surface and the points on them, before it is known where they were seen from."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trihedral.geometry.arrays import Float64

# Points that are searched at the most; of a larger scan, those in some of its cells (metres), each with all of them.
_MOST, _CELL = 3_000_000, 0.5


@dataclass(frozen=True)
class Neighbourhoods:
    """Pieces of surface that do not end here: for each a point, its nearest neighbours and the plane of them.

    Attributes
    ----------
    centres
        (M, 3) mean of the points, metres.
    normals
        (M, 3) unit, of no certain sign.
    radius
        (M,) metres to the farthest of the neighbours.
    members
        (M, K, 3) the neighbours, the nearest first: the piece's own point.
    """

    centres: Float64
    normals: Float64
    radius: Float64
    members: Float64

    def __len__(self) -> int:
        return len(self.centres)

    @property
    def density(self) -> Float64:
        """(M,) points per square metre."""
        around = self.members.shape[1] - 1
        return np.asarray(around / (np.pi * np.maximum(self.radius, 1e-9) ** 2))

    def of(self, chosen: NDArray[Any]) -> "Neighbourhoods":
        """Some of them."""
        return Neighbourhoods(*(getattr(self, field.name)[chosen] for field in fields(self)))


def neighbourhoods(
    points: Float64, rng: np.random.Generator, pieces: int, neighbours: int, flatness: float = 0.12
) -> Neighbourhoods:
    """Take so many points (N, 3) at random with their nearest neighbours, and keep those that lie within a plane.

    A piece is thinner than `flatness`, a share of its extent.
    """
    points = _part(points, rng)
    seeds = points[rng.choice(len(points), min(pieces, len(points)), replace=False)]
    neighbours = min(neighbours, len(points))
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    distance, index = tree.query(seeds, k=neighbours)
    members = points[index]
    centres = members.mean(axis=1)
    offset = members - centres[:, None]
    values, vectors = np.linalg.eigh(np.einsum("mki,mkj->mij", offset, offset) / neighbours)
    thickness, width = np.sqrt(np.maximum(values[:, 0], 0.0)), np.sqrt(np.maximum(values[:, 1], 1e-18))
    across = np.einsum("mki,mij->mkj", members[:, 1:] - seeds[:, None], vectors[:, :, 1:])
    around = np.sort(np.arctan2(across[:, :, 1], across[:, :, 0]), axis=1)
    gap = np.diff(around, axis=1, append=around[:, :1] + 2 * np.pi).max(axis=1)
    kept = (thickness < flatness * width) & (gap < 0.5 * np.pi)
    return Neighbourhoods(centres, vectors[:, :, 0], distance[:, -1], members).of(kept)


def _part(points: Float64, rng: np.random.Generator) -> Float64:
    if len(points) <= _MOST:
        return points
    cell = np.floor(points / _CELL).astype(np.int64) @ np.array([73_856_093, 19_349_663, 83_492_791])
    draw = rng.random(1 << 16) < _MOST / len(points)
    return np.asarray(points[draw[cell & 0xFFFF]])
