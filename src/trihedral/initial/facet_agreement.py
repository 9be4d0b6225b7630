"""How well the facets of two scans agree under poses, at a glance: hundreds of poses in a blink."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

MOST = 80  # largest facets that are compared
SAME_NORMAL = np.cos(np.radians(6.0))
SAME_PLANE = 0.25  # metres between a facet's centroid and the plane of the other scan
# Normals farther apart than this do not turn a rotation.
NEAR_NORMAL = np.cos(np.radians(12.0))
CHUNK = 200  # poses compared at a time


@dataclass(frozen=True)
class _Planes:
    normals: Float64
    distances: Float64
    centroids: Float64
    weights: Float64
    radii: Float64


def _planes(prepared: Prepared) -> _Planes:
    areas = prepared.facet_areas[:MOST]
    return _Planes(
        prepared.facet_planes[:MOST, :3],
        prepared.facet_planes[:MOST, 3],
        prepared.facet_centroids[:MOST],
        # A root of the area: one broad floor must not outvote the walls.
        np.sqrt(areas),
        np.sqrt(areas),
    )


def facet_agreement(a: Prepared, b: Prepared, poses: Float64) -> Float64:
    """Sum over the facets of `a` of the root of the smaller area (m) of each and its best partner in `b`; (M,)."""
    one, other = _planes(a), _planes(b)
    agreement = np.zeros(len(poses))
    if not len(one.weights) or not len(other.weights):
        return agreement
    shared = np.minimum(one.weights[:, None], other.weights)
    reach = one.radii[:, None] + other.radii
    for start in range(0, len(poses), CHUNK):
        part = poses[start : start + CHUNK]
        rotation, shift = part[:, :3, :3], part[:, :3, 3]
        normals = np.einsum("mij,pj->mpi", rotation, one.normals)
        centroids = np.einsum("mij,pj->mpi", rotation, one.centroids) + shift[:, None]
        facing = normals @ other.normals.T
        offset = np.abs(centroids @ other.normals.T - other.distances)
        square = (
            (centroids**2).sum(axis=2)[..., None]
            - 2 * centroids @ other.centroids.T
            + (other.centroids**2).sum(axis=1)
        )
        same = (facing > SAME_NORMAL) & (offset < SAME_PLANE) & (square < reach**2)
        agreement[start : start + CHUNK] = np.where(same, shared, 0.0).max(axis=2).sum(axis=1)
    return agreement


def turned_onto_facets(a: Prepared, b: Prepared, rotations: Float64) -> Float64:
    """Rotations (M, 3, 3) turned so that facets which face nearly the same way face the same way."""
    one, other = _planes(a), _planes(b)
    if not len(one.weights) or not len(other.weights):
        return rotations
    facing = np.einsum("mij,pj->mpi", rotations, one.normals) @ other.normals.T
    partner = facing.argmax(axis=2)
    best = np.take_along_axis(facing, partner[..., None], axis=2)[..., 0]
    weights = np.where(
        best > NEAR_NORMAL, np.minimum(one.weights, other.weights[partner]) * (best - NEAR_NORMAL), 0.0
    )
    scatter = np.einsum("mp,mpi,pj->mij", weights, other.normals[partner], one.normals)
    # A little of the rotation itself decides what the facets leave open.
    u, _, vt = np.linalg.svd(scatter + 1e-3 * rotations)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    turned: Float64 = u @ vt
    return turned
