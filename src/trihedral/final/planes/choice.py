"""Which three planes of two scans are the same: by their sizes alone, or by the motion that lays them on each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.final.planes.options import PlaneMatchingOptions
from trihedral.final.planes.pose import PlanePair, PlanesRefused, pose_of
from trihedral.final.planes.segmentation import Plane
from trihedral.geometry.arrays import Bool, Floating, Int64
from trihedral.geometry.se3 import Matrix, rotation_angle, transform
from trihedral.overlap.nearest import has_neighbour

# Pairs with alike normals that propose motions, the largest of each facing, and facings; rough ground, which is many
# planes, must not crowd out the walls. Threes of pairs grow with the cube of the first.
_MOST_PAIRS = 12
_MOST_FACINGS = 5
# Motions whose planes are compared at once, to bound memory.
_BATCH = 512
# Motions that are compared by points, and the points of `a` that they are compared by.
_COMPARED = 24
_SAMPLES = 3000
# How often pairs are fitted on the area that both scans saw, how many, the largest, and the points that each needs.
_COMMON_FITS = 2
_FITTED = 10
_LEAST_COMMON = 30


def first_three(
    planes: Sequence[Plane], options: PlaneMatchingOptions | None = None
) -> tuple[Plane, Plane, Plane]:
    """Give the first three that are linearly independent, those found earlier before others.

    Raises
    ------
    PlanesRefused
        There are no three; the text says what the planes are instead.
    """
    options = options or PlaneMatchingOptions()
    # Ordered by the last of the three: the search stops with the first plane that completes a corner.
    for i, j, k in sorted(combinations(range(len(planes)), 3), key=lambda t: t[::-1]):
        if abs(_volume([planes[i], planes[j], planes[k]])) >= options.independence:
            return planes[i], planes[j], planes[k]
    if len(planes) < 3:
        raise PlanesRefused(f"only {len(planes)} of the three planes were found that make a corner")
    best = max(abs(_volume(triple)) for triple in combinations(planes, 3))
    raise PlanesRefused(
        f"of {len(planes)} planes no three are linearly independent: they are parallel, or nearly so, or all "
        f"upright (the best three span {best:.2f} of a right corner; {options.independence:g} is needed)"
    )


def pair_by_normals(
    normals_a: Matrix, normals_b: Matrix, options: PlaneMatchingOptions | None = None
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Pair three normals of `a`, turned into the frame of `b` by the initial alignment, with three of `b`.

    A plane has two normals: signs do not count.

    Parameters
    ----------
    normals_a, normals_b
        (3, 3) unit vectors as rows.

    Returns
    -------
    order, signs
        `order[k]` is the normal of `a` that is paired with normal `k` of `b`, to be multiplied by `signs[k]`.

    Raises
    ------
    PlanesRefused
        The closest pairing turns a normal too far, or another one is nearly as close.
    """
    options = options or PlaneMatchingOptions()
    cosines = normals_a @ normals_b.T
    angles = np.arccos(np.clip(np.abs(cosines), 0.0, 1.0))
    ranked = sorted((max(float(angles[p[k], k]) for k in range(3)), p) for p in permutations(range(3)))
    (widest, order), (next_widest, _) = ranked[0], ranked[1]
    if widest > options.widest:
        raise PlanesRefused(
            f"the three largest planes of the two scans are not the same: the closest pairing leaves "
            f"{np.degrees(widest):.0f} deg between two normals"
        )
    if widest > options.distinctness * next_widest:
        raise PlanesRefused(
            f"the pairing of the planes is ambiguous: two ways leave {np.degrees(widest):.1f} and "
            f"{np.degrees(next_widest):.1f} deg between normals"
        )
    return order, tuple(1.0 if cosines[order[k], k] >= 0 else -1.0 for k in range(3))


def largest_three(
    found_a: Sequence[Plane], found_b: Sequence[Plane], start: Matrix, options: PlaneMatchingOptions
) -> list[PlanePair]:
    """Pair the first three independent planes of each scan, as the paper says."""
    three_a, three_b = _corners(found_a, found_b, options)
    normals_a = np.stack([plane.normal for plane in three_a]) @ start[:3, :3].T
    order, signs = pair_by_normals(normals_a, np.stack([plane.normal for plane in three_b]), options)
    return [PlanePair(three_a[k], plane, sign) for k, plane, sign in zip(order, three_b, signs, strict=True)]


def consistent_three(
    found_a: Sequence[Plane],
    found_b: Sequence[Plane],
    a: Floating,
    b: Floating,
    start: Matrix,
    options: PlaneMatchingOptions,
) -> list[PlanePair]:
    """Of the pairs that one motion lays on each other, the three whose corner brings most points together."""
    _corners(found_a, found_b, options)
    pairs = consistent_pairs(found_a, found_b, a, b, start, options)
    if not pairs:
        raise PlanesRefused(
            f"of {len(found_a)} and {len(found_b)} planes no three can be laid on three of the other scan near the "
            f"initial alignment (within {np.degrees(options.widest):.0f} deg and {options.farthest:g} m)"
        )
    try:
        three_b = first_three([pair.b for pair in pairs], options)
    except PlanesRefused as refusal:
        raise PlanesRefused(f"of the planes that one motion lays on each other, {refusal}") from None
    three = [next(pair for pair in pairs if pair.b is plane) for plane in three_b]
    for _ in range(_COMMON_FITS):
        pose = pose_of(three, start)
        fitted = [_on_common_area(pair, a, b, pose, 2 * options.near) for pair in pairs[:_FITTED]]
        threes = [list(one) for one in combinations(fitted, 3) if _spans_a_corner(one, options)]
        if not threes:
            break
        three = max(threes, key=lambda one: _lying_on(a, b, pose_of(one, start), options.near))
    return three


def consistent_pairs(
    found_a: Sequence[Plane],
    found_b: Sequence[Plane],
    a: Floating,
    b: Floating,
    start: Matrix,
    options: PlaneMatchingOptions | None = None,
) -> list[PlanePair]:
    """Pair the planes that one motion near the initial alignment lays on each other.

    Closest normals alone cannot tell parallel walls apart. So every three pairs with alike normals propose their
    motion (Eq. 5 to 7); those that lay most plane on plane are compared by the points (N, 3), (M, 3) that come to lie
    on each other, and the best motion's pairs are given, the largest first, by the smaller plane of each.
    """
    options = options or PlaneMatchingOptions()
    sizes = np.minimum.outer([p.points for p in found_a], [p.points for p in found_b])
    motions = _proposed_motions(found_a, found_b, sizes, start, options)
    if not motions:
        return []
    scores = []
    for first in range(0, len(motions), _BATCH):
        off = _Differences.between(found_a, found_b, np.stack(motions[first : first + _BATCH]))
        laid = off.near(options) * sizes
        # Each plane counts once, with its best partner.
        scores.append(np.minimum(laid.max(axis=1).sum(axis=1), laid.max(axis=2).sum(axis=1)))
    ranked = np.argsort(-np.concatenate(scores), kind="stable")[:_COMPARED]
    best = max(ranked.tolist(), key=lambda k: _lying_on(a, b, motions[k], options.near))
    off = _Differences.between(found_a, found_b, motions[best][None])
    near, signs = off.near(options)[0], off.signs[0]
    cost = np.hypot(off.angles[0] / options.near_angle, off.metres[0] / options.near)
    cost = np.where(near, cost, np.inf)
    mutual = [
        (i, j) for i, j in np.argwhere(near).tolist() if cost[i, j] == cost[i].min() == cost[:, j].min()
    ]
    mutual.sort(key=lambda ij: (-sizes[ij], ij))
    return [PlanePair(found_a[i], found_b[j], float(signs[i, j])) for i, j in mutual]


def _proposed_motions(
    found_a: Sequence[Plane],
    found_b: Sequence[Plane],
    sizes: Int64,
    start: Matrix,
    options: PlaneMatchingOptions,
) -> list[Matrix]:
    """Give the motions near the initial alignment of every three pairs whose normals it leaves alike."""
    off = _Differences.between(found_a, found_b, start[None])
    alike = np.argwhere((off.angles[0] <= options.widest) & (off.metres[0] <= options.farthest))
    alike = alike[np.argsort(-sizes[alike[:, 0], alike[:, 1]], kind="stable")]
    alike = alike[_largest_of_each_facing(alike[:, 1], found_b)]
    pairs = [PlanePair(found_a[i], found_b[j], float(off.signs[0, i, j])) for i, j in alike.tolist()]
    motions = []
    for three in combinations(pairs, 3):
        distinct = min(len({id(p.a) for p in three}), len({id(p.b) for p in three})) == 3
        if distinct and _spans_a_corner(three, options):
            pose = pose_of(three, start)
            if _near_start(pose, start, three, options):
                motions.append(pose)
    return motions


def _largest_of_each_facing(planes: NDArray[np.intp], found: Sequence[Plane]) -> list[int]:
    """Places in `planes` (indices into `found`) that are kept: so many of each facing, in the order given."""
    facings: list[Matrix] = []
    counts: list[int] = []
    kept = []
    for place, index in enumerate(planes.tolist()):
        normal = found[index].normal
        facing = next((k for k, other in enumerate(facings) if abs(other @ normal) > np.cos(np.pi / 6)), None)
        if facing is None:
            if len(facings) == _MOST_FACINGS:
                continue
            facing = len(facings)
            facings.append(normal)
            counts.append(0)
        if counts[facing] < _MOST_PAIRS:
            counts[facing] += 1
            kept.append(place)
    return kept


@dataclass(frozen=True)
class _Differences:
    """(K, A, B) between every plane of `a` under K motions and every plane of `b`."""

    cosines: Matrix
    angles: Matrix
    metres: Matrix

    @classmethod
    def between(cls, found_a: Sequence[Plane], found_b: Sequence[Plane], poses: Matrix) -> "_Differences":
        """Compare under (K, 4, 4) poses."""

        def stacked(planes: Sequence[Plane], name: str) -> Matrix:
            return np.array([getattr(plane, name) for plane in planes], dtype=np.float64).reshape(-1, 3)

        turned = [
            np.einsum("kij,aj->kai", poses[:, :3, :3], stacked(found_a, k)) for k in ("normal", "centroid")
        ]
        normals, centroids = turned[0], turned[1] + poses[:, None, :3, 3]
        normals_b, centroids_b = stacked(found_b, "normal"), stacked(found_b, "centroid")
        distances_b = np.array([plane.distance for plane in found_b])
        cosines = normals @ normals_b.T
        from_b = np.abs(centroids @ normals_b.T - distances_b)
        from_a = np.abs(np.einsum("kai,kabi->kab", normals, centroids_b[None, None] - centroids[:, :, None]))
        # Parts of one wall that lie far apart are seen far from it where a motion is turned.
        return cls(cosines, np.arccos(np.clip(np.abs(cosines), 0.0, 1.0)), np.minimum(from_a, from_b))

    @property
    def signs(self) -> Matrix:
        """By which the normals of `a` get the sense of those of `b`."""
        return np.where(self.cosines >= 0, 1.0, -1.0)

    def near(self, options: PlaneMatchingOptions) -> Bool:
        """Tell which planes lie on each other."""
        return (self.angles <= options.near_angle) & (self.metres <= options.near)


def _near_start(
    pose: Matrix, start: Matrix, three: Sequence[PlanePair], options: PlaneMatchingOptions
) -> bool:
    """Whether the motion leaves the scans where the initial alignment put them, as far as that is good for."""
    centroids = np.stack([pair.a.centroid for pair in three])
    moved = np.linalg.norm(transform(pose, centroids) - transform(start, centroids), axis=1)
    return rotation_angle(pose[:3, :3] @ start[:3, :3].T) <= options.widest and bool(
        moved.mean() <= 1.5 * options.farthest
    )


def _lying_on(a: Floating, b: Floating, pose: Matrix, radius: float) -> float:
    """How many points of `a` come to lie on `b`, nearer ones counting more."""
    drawn = a[:: max(1, len(a) // _SAMPLES)]
    moved = np.ascontiguousarray(transform(pose, drawn), dtype=np.float32)
    distances = _core.nearest_distances(np.ascontiguousarray(b, dtype=np.float32), moved, radius)
    return float(np.maximum(0.0, 1.0 - distances / radius).sum())


def _on_common_area(pair: PlanePair, a: Floating, b: Floating, pose: Matrix, radius: float) -> PlanePair:
    """Fit both planes of a pair where both scans saw them: no ground and no wall is flat all over."""
    on_a, on_b = a[pair.a.inliers].astype(np.float64), b[pair.b.inliers].astype(np.float64)
    moved = transform(pose, on_a)
    shared_a, shared_b = has_neighbour(moved, on_b, radius), has_neighbour(on_b, moved, radius)
    if min(shared_a.sum(), shared_b.sum()) < _LEAST_COMMON:
        return pair
    return PlanePair(_refitted(pair.a, on_a[shared_a]), _refitted(pair.b, on_b[shared_b]), pair.sign)


def _refitted(plane: Plane, points: Matrix) -> Plane:
    centroid = points.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((points - centroid).T))
    normal = vectors[:, 0] * (1.0 if vectors[:, 0] @ plane.normal >= 0 else -1.0)
    thickness = float(np.sqrt(max(values[0], 0.0)))
    return Plane(normal, float(normal @ centroid), thickness, centroid, plane.inliers)


def _spans_a_corner(three: Sequence[PlanePair], options: PlaneMatchingOptions) -> bool:
    volumes = _volume([pair.a for pair in three]), _volume([pair.b for pair in three])
    return min(abs(volume) for volume in volumes) >= options.independence


def _corners(
    found_a: Sequence[Plane], found_b: Sequence[Plane], options: PlaneMatchingOptions
) -> list[tuple[Plane, Plane, Plane]]:
    """First three independent planes of each scan; a refusal names the scan."""
    chosen = []
    for name, found in (("moving", found_a), ("reference", found_b)):
        try:
            chosen.append(first_three(found, options))
        except PlanesRefused as refusal:
            raise PlanesRefused(f"in the {name} scan, {refusal}") from None
    return chosen


def _volume(planes: Sequence[Plane]) -> float:
    return float(np.linalg.det(np.stack([plane.normal for plane in planes])))
