"""How much of what one station sees another sees too: decided by rays, not by how densely points fell."""

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64
from trihedral.simulate.mesh import rotated
from trihedral.simulate.returns import ReturnKind
from trihedral.simulate.scanner import SimulatedScan
from trihedral.simulate.tracer import Tracer

VOXEL_M = 0.10  # each voxel with a point counts once, so that near surfaces do not outweigh far ones
WITHIN_M = 0.05  # a ray that ends this near to the point has reached it
SAMPLES = 8000  # voxels asked about in each scan


def surface_samples(points: Float64, most: int = SAMPLES) -> Float64:
    """Take at most so many of (N, 3) points, one in each of that many voxels, spread over all of them."""
    cell = np.floor(points / VOXEL_M).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    key = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    _, first = np.unique(key, return_index=True)
    # Keys run along the axes: even steps through them would favour some planes, a fixed shuffle does not.
    shuffled = np.random.default_rng(0).permutation(first)[:most]
    return np.asarray(points[np.sort(shuffled)])


def reaches(
    tracer: Tracer, origin: Float64, points: Float64, max_range: float, elevation_min: float = -np.pi / 2
) -> NDArray[np.bool_]:
    """Tell which of (N, 3) points a level scanner at `origin` sees: in range, in its field, not hidden."""
    offset = points - origin
    distance = np.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2 + offset[:, 2] ** 2)
    safe = np.maximum(distance, 1e-9)
    _, length = tracer.cast(np.broadcast_to(origin, points.shape), offset / safe[:, None])
    in_field = offset[:, 2] >= np.sin(elevation_min) * distance
    return np.asarray((np.abs(length - distance) < WITHIN_M) & (distance < max_range) & in_field)


def still_points(one: SimulatedScan) -> Float64:
    """Evenly spread samples of the standing surfaces that a scan shows, without noise, project frame."""
    good = one.fixed & (one.kind == ReturnKind.DIRECT)
    xyz = one.xyz[good].astype(np.float64)
    length = np.sqrt(xyz[:, 0] ** 2 + xyz[:, 1] ** 2 + xyz[:, 2] ** 2)
    pose = one.project_from_station
    exact = rotated(pose[:3, :3], xyz * (one.true_range[good] / length)[:, None]) + pose[:3, 3]
    return surface_samples(exact)
