"""Planes of a scan as far as it reaches: pieces of surface that are too thinly seen to be patches count too."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

SPACING = (
    0.2  # metres; of several elements in a voxel of this size, or of twice, four times ... it, one counts
)
ELEMENTS = 25_000  # that count at the most
NEIGHBOURS = 10  # that an element may be joined with ...
FARTHEST = 10.0  # ... up to so many spacings
SAME_NORMAL = np.cos(np.radians(10.0))
# Metres that an element may lie off the plane of its neighbour, and the share of their distance.
OFF_PLANE = 0.03
OFF_PLANE_SHARE = 0.05
FEWEST = 10  # elements of a facet
MOST = 120  # facets kept, the largest


def find_facets(prepared: Prepared) -> tuple[dict[str, NDArray[np.generic]], list[Float64]]:
    """Fields of `Prepared` on its facets, the largest first, and the elements of each.

    Elements are joined with those near them that lie on one plane with them, whatever their density.
    """
    spacing = SPACING
    index = thinned(prepared, spacing)
    while len(index) > ELEMENTS:
        spacing *= 2
        index = thinned(prepared, spacing)
    points, normals = prepared.points[index].astype(np.float64), prepared.normals[index].astype(np.float64)
    label = _joined(points, normals, FARTHEST * spacing)
    order = np.argsort(label, kind="stable")
    bounds = np.flatnonzero(np.diff(label[order], prepend=-1, append=label.max(initial=-1) + 1))
    groups = [order[start:end] for start, end in pairwise(bounds) if end - start >= FEWEST]
    groups.sort(key=lambda members: (-len(members), members[0]))
    groups = groups[:MOST]
    planes = np.zeros((len(groups), 4))
    centroids = np.zeros((len(groups), 3))
    looks = np.full(len(groups), np.nan)
    # Colour where there is some, else intensity: a scan has one of the two everywhere or nowhere.
    grey = prepared.color.mean(axis=1)
    grey = (np.where(np.isfinite(grey), grey, prepared.intensity))[index]
    for k, members in enumerate(groups):
        centroids[k] = points[members].mean(axis=0)
        spread = points[members] - centroids[k]
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        normal *= np.sign(normals[members].sum(axis=0) @ normal) or 1.0
        planes[k] = [*normal, normal @ centroids[k]]
        looks[k] = grey[members].mean()
    return {
        "facet_planes": planes,
        "facet_centroids": centroids,
        "facet_areas": np.array([len(members) * spacing**2 for members in groups]).reshape(-1),
        "facet_looks": looks,
    }, [points[members] for members in groups]


def thinned(prepared: Prepared, spacing: float) -> NDArray[np.intp]:
    """Indices of planar elements, one a voxel of this size (m), in the order of the voxels."""
    planar = np.flatnonzero(prepared.planar)
    cells = np.floor(prepared.points[planar] / spacing).astype(np.int64) + (1 << 20)
    keys = (cells[:, 0] << 42) + (cells[:, 1] << 21) + cells[:, 2]
    first: NDArray[np.intp] = planar[np.unique(keys, return_index=True)[1]]
    return first


def _joined(points: Float64, normals: Float64, farthest: float) -> NDArray[np.int32]:
    """Number of the facet of each element."""
    if len(points) <= 1:
        return np.zeros(len(points), dtype=np.int32)
    distances, near = KDTree(points).query(
        points, k=min(NEIGHBOURS + 1, len(points)), distance_upper_bound=farthest
    )
    here, there = np.repeat(np.arange(len(points)), near.shape[1] - 1), near[:, 1:].ravel()
    apart = distances[:, 1:].ravel()
    found = np.isfinite(apart)
    here, there, apart = here[found], there[found], apart[found]
    between = points[there] - points[here]
    off = np.maximum(
        np.abs(np.einsum("ij,ij->i", between, normals[here])),
        np.abs(np.einsum("ij,ij->i", between, normals[there])),
    )
    joined = (np.einsum("ij,ij->i", normals[here], normals[there]) > SAME_NORMAL) & (
        off < OFF_PLANE + OFF_PLANE_SHARE * apart
    )
    count = len(points)
    graph = coo_matrix((np.ones(joined.sum(), dtype=np.int8), (here[joined], there[joined])), (count, count))
    label: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return label
