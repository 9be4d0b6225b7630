"""Even samplings: clouds of which a share of points is a share of area."""

import numpy as np
from scipy.spatial import cKDTree

from trihedral.geometry.arrays import Float32, Float64, Floating

# Neighbours of a point on a grid of beams: rows and columns need not lie equally wide apart.
_NEIGHBOURS = 4
# Share of the points whose neighbours lie within the spacing of the even sampling: beyond, surface is so far
# from the scanner that its beams lie wider apart than any even sampling of the rest.
NEAR_ENOUGH = 0.9
_LOOKED_AT = 20_000  # points whose neighbours are looked for


def even_spacing(points: Floating) -> float:
    """Metres that the points (N, 3) lie apart at the most, but for the outermost tenth."""
    if len(points) <= _NEIGHBOURS:
        return 1.0
    distances = neighbour_distances(points, max(1, len(points) // _LOOKED_AT))
    return float(max(np.quantile(distances, NEAR_ENOUGH), 1e-3))


def neighbour_distances(points: Floating, every: int = 1) -> Float64:
    """Metres from the points (N, 3), or every so many-th of them, to their fourth nearest neighbours.

    0 where there are too few points to tell.
    """
    if len(points) <= _NEIGHBOURS:
        return np.zeros(len(points))
    return np.asarray(cKDTree(points).query(points[::every], k=[_NEIGHBOURS + 1])[0][:, 0])


def evenly(points: Floating, spacing: float) -> Float32:
    """One point for each voxel of that edge (m) that has any: the one nearest to their mean.

    Parameters
    ----------
    points
        (N, 3), metres.
    """
    if not len(points):
        return np.zeros((0, 3), dtype=np.float32)
    voxel = np.floor(np.asarray(points, dtype=np.float64) / spacing).astype(np.int64)
    _, cell = np.unique(voxel, axis=0, return_inverse=True)
    cell = cell.ravel()
    count = np.bincount(cell)
    mean = np.stack([np.bincount(cell, points[:, k]) / count for k in range(3)], axis=1)
    off = np.einsum("ij,ij->i", points - mean[cell], points - mean[cell])
    order = np.lexsort((off, cell))
    first = np.concatenate([[True], np.diff(cell[order]) > 0])
    return np.ascontiguousarray(points[np.sort(order[first])], dtype=np.float32)
