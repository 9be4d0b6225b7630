"""Poses from corners: where the planes of three facets meet, a scan has a point and a frame of its own."""

from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from trihedral.errors import OptionError
from trihedral.initial.facet_agreement import facet_agreement
from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

# Two planes meet well if their normals are at least this far from parallel (sine), three if their normals span at least
# this volume.
LEAST_SINE = 0.5
LEAST_VOLUME = 0.4
# Metres between a corner and the nearest element of each of its facets, beside a share of the distance to the scanner.
GAP = 2.0
GAP_SHARE = 0.2
# A facet reaches across the plane of another if this much of it (m) is on the far side.
ACROSS = 0.3


@dataclass(frozen=True)
class CornerOptions:
    """How corners become poses."""

    facets: int = 80  # the largest, of which corners are made
    corners: int = 300  # kept a scan
    angle: float = np.radians(3.0)  # by which the angles between planes may differ
    grey: float = 0.2  # by which the brightness (0..1) of a facet may differ
    matches: int = 6000  # pairs of corners that propose a pose, those of the largest facets
    candidates: int = 600  # poses that the facets are compared under
    poses: int = 100  # proposed at the most

    def __post_init__(self) -> None:
        if min(self.facets, self.corners, self.matches, self.candidates, self.poses) < 1:
            raise OptionError("facets, corners, matches, candidates and poses must be at least 1")


def find_corners(
    prepared: Prepared, elements: list[Float64], options: CornerOptions
) -> dict[str, NDArray[np.generic]]:
    """Fields of `Prepared` on its corners, those of the largest facets first, from the elements of its facets."""
    count = min(options.facets, len(elements))
    elements = elements[:count]
    normals, distances = prepared.facet_planes[:count, :3], prepared.facet_planes[:count, 3]
    trees = [KDTree(points) for points in elements]
    low, high = (np.array([f(p, axis=0) for p in elements]).reshape(-1, 3) for f in (np.min, np.max))
    beside = (low[:, None] - high).max(axis=2) < 2 * GAP
    beside &= beside.T & (np.linalg.norm(np.cross(normals[:, None], normals), axis=2) > LEAST_SINE)
    triples = np.array(
        [
            (i, j, k)
            for i, j, k in combinations(range(count), 3)
            if beside[i, j] and beside[i, k] and beside[j, k]
        ],
        dtype=np.int32,
    ).reshape(-1, 3)
    planes = normals[triples]
    volume = np.linalg.det(planes)
    kept = np.abs(volume) > LEAST_VOLUME
    triples, planes, volume = triples[kept], planes[kept], volume[kept]
    points = np.linalg.solve(planes, distances[triples][..., None])[..., 0]
    # Right-handed: what is left to match is which normal comes first.
    triples[volume < 0] = triples[volume < 0][:, [0, 2, 1]]
    limit = GAP + GAP_SHARE * np.linalg.norm(points, axis=1)
    met = np.ones(len(points), dtype=bool)
    for facet in range(count):
        of = np.flatnonzero((triples == facet).any(axis=1) & met)
        met[of] = trees[facet].query(points[of])[0] < limit[of]
    triples, points = triples[met], points[met]
    size = np.sqrt(prepared.facet_areas)[triples].min(axis=1)
    order = np.argsort(-size, kind="stable")[: options.corners]
    triples, points = triples[order], points[order]
    return {
        "corner_points": points,
        "corner_facets": triples.astype(np.int32),
        "corner_sides": _sides(prepared, triples, elements),
    }


def _sides(prepared: Prepared, triples: NDArray[np.int32], elements: list[Float64]) -> NDArray[np.int8]:
    """(C, 3, 3) on which side of the second facet of a corner the first facet lies: 1 before, -1 behind, 0 both."""
    sides = np.zeros((len(triples), 3, 3), dtype=np.int8)
    reach: dict[tuple[int, int], tuple[float, float]] = {}
    for c, triple in enumerate(triples.tolist()):
        for i, facet in enumerate(triple):
            for j, plane in enumerate(triple):
                if i == j:
                    continue
                if (facet, plane) not in reach:
                    heights = (
                        elements[facet] @ prepared.facet_planes[plane, :3] - prepared.facet_planes[plane, 3]
                    )
                    low, high = np.percentile(heights, [3, 97])
                    reach[facet, plane] = float(low), float(high)
                behind, before = reach[facet, plane]
                sides[c, i, j] = int(before > ACROSS) - int(behind < -ACROSS)
    return sides


def corner_poses(a: Prepared, b: Prepared, options: CornerOptions) -> list[tuple[Float64, float]]:
    """Motions that take corners onto corners, those first under which most facets agree."""
    if not len(a.corner_points) or not len(b.corner_points):
        return []
    found = [_matched(a, b, np.roll(np.arange(3), turn), options) for turn in range(3)]
    poses = np.concatenate([poses for poses, _ in found])
    looks = np.concatenate([looks for _, looks in found])
    if not len(poses):
        return []
    # Right poses come from several corners.
    rows = np.hstack([poses[:, :3, :3].reshape(-1, 9) * 5, poses[:, :3, 3]])
    tree = KDTree(rows)
    votes = tree.query_ball_point(rows, 0.7, return_length=True).astype(np.float64) * looks
    chosen: list[int] = []
    taken = np.zeros(len(poses), dtype=bool)
    for index in np.argsort(-votes, kind="stable"):
        if taken[index]:
            continue
        chosen.append(int(index))
        taken[tree.query_ball_point(rows[index], 0.5)] = True
        if len(chosen) == options.candidates:
            break
    candidates = poses[chosen]
    agreement = facet_agreement(a, b, candidates)
    order = np.argsort(-agreement, kind="stable")[: options.poses]
    return [(candidates[k], float(agreement[k])) for k in order]


def _matched(
    a: Prepared, b: Prepared, turn: NDArray[np.intp], options: CornerOptions
) -> tuple[Float64, Float64]:
    """Poses of corners that may be the same if the first normal of `a` is number ``turn[0]`` of `b`, and how alike."""
    facets_a, facets_b = a.corner_facets, b.corner_facets[:, turn]
    normals_a, normals_b = a.facet_planes[facets_a, :3], b.facet_planes[facets_b, :3]
    alike = np.ones((len(facets_a), len(facets_b)), dtype=bool)
    for one, other in combinations(range(3), 2):
        angle_a, angle_b = (
            np.arccos(np.einsum("ck,ck->c", n[:, one], n[:, other])) for n in (normals_a, normals_b)
        )
        alike &= np.abs(angle_a[:, None] - angle_b) < options.angle
    sides_a, sides_b = a.corner_sides, b.corner_sides[:, turn][:, :, turn]
    for one, other in permutations(range(3), 2):
        alike &= sides_a[:, None, one, other] * sides_b[:, one, other] >= 0
    grey_a, grey_b = (p.facet_looks[of] for p, of in ((a, facets_a), (b, facets_b)))
    difference = np.abs(grey_a[:, None] - grey_b).max(axis=2)
    alike &= ~(difference > options.grey)
    i, j = np.nonzero(alike)
    first = np.argsort(i + j, kind="stable")[: options.matches // 3]
    i, j = i[first], j[first]
    looks = np.exp(-np.nan_to_num(difference[i, j]) / options.grey)
    rotations = _frames(normals_b)[j] @ _frames(normals_a)[i].transpose(0, 2, 1)
    shifts = b.corner_points[j] - np.einsum("mij,mj->mi", rotations, a.corner_points[i])
    poses = np.zeros((len(i), 4, 4))
    poses[:, :3, :3], poses[:, :3, 3], poses[:, 3, 3] = rotations, shifts, 1
    return poses, looks


def _frames(normals: Float64) -> Float64:
    """The right-handed orthonormal frames (C, 3, 3), by columns, nearest to three normals each (by rows)."""
    u, _, vt = np.linalg.svd(normals.transpose(0, 2, 1))
    frames: Float64 = u @ vt
    return frames
