"""The paper's final alignment of scans that overlap little: three planes of each, paired by their normals.

Rotation by Eq. 5 and 6, translation by the corner points of Eq. 7. Each step is a function of its own. docs/paper.md
says what the paper leaves open about the choice of the three, and what was measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import OptionError, TrihedralError
from trihedral.geometry.se3 import Matrix, motion, rotation_angle, rotation_between, transform

Choice = Literal["consistent", "largest"]


@dataclass(frozen=True)
class PlaneMatchingOptions:
    """How planes are found and when three of them will do."""

    # "largest": the first three independent planes of each scan, whether or not they are the same walls;
    # "consistent": the largest three of those that one motion near the initial alignment lays on each other.
    choice: Choice = "consistent"
    tolerance: float = 0.03  # metres from a plane within which points are its inliers
    candidates: int = 3000  # planes through three points that are tried for each that is found
    planes: int = 16  # segmented at the most before the search for three gives up
    least_share: float = 0.01  # of the points; smaller planes are not looked at
    # Volume of the box that three unit normals span, at least: 1 for a right corner, 0 for planes without a corner.
    independence: float = 0.35
    widest: float = np.radians(30.0)  # radians between paired normals after the initial alignment, at most
    farthest: float = 9.0  # metres between paired planes after the initial alignment, at most
    # The best pairing of three turns the normals by less than this share of what the next one does.
    distinctness: float = 0.7
    # Planes that one motion lays on each other are this near to each other then: radians, and metres.
    near_angle: float = np.radians(2.0)
    near: float = 0.3

    def __post_init__(self) -> None:
        if self.choice not in ("consistent", "largest"):
            raise OptionError(f"planes are chosen as 'consistent' or 'largest', not {self.choice!r}")
        if min(self.tolerance, self.farthest) <= 0 or self.candidates < 1 or self.planes < 3:
            raise OptionError("plane matching needs positive distances, candidates, and at least 3 planes")
        if not (0 < self.independence < 1 and 0 < self.distinctness < 1 and 0 < self.least_share < 1):
            raise OptionError("independence, distinctness and least_share lie between 0 and 1")


class PlanesRefused(TrihedralError):  # noqa: N818 - an outcome as much as an error
    """Three planes that fix a pose were not found; the text says why, as a clause without a final stop."""


@dataclass(frozen=True)
class Plane:
    """A plane ``normal . x = distance`` and the points that it was fitted to.

    Attributes
    ----------
    normal
        (3,) unit.
    distance
        Metres.
    thickness
        Standard deviation of the inliers across it, metres.
    centroid
        (3,) of the inliers, metres.
    inliers
        (K,) indices of the points.
    """

    normal: Matrix
    distance: float
    thickness: float
    centroid: Matrix
    inliers: NDArray[np.uint32]

    @property
    def points(self) -> int:
        """How many points lie on it: its area where the cloud is evenly sampled."""
        return len(self.inliers)


@dataclass(frozen=True)
class PlaneMatch:
    """A pose from three pairs of planes.

    Attributes
    ----------
    pose
        ``b_from_a``, 4x4.
    planes_a, planes_b
        The three of each scan, pair by pair, in the order of `b`'s sizes, each in its own scan's coordinates.
    corner_a, corner_b
        (3,) where they meet, metres.
    found_a, found_b
        Every plane that was segmented, largest first.
    ranks_a, ranks_b
        Of the three among those by size, from 1.
    leftover
        Angles (rad) between the paired normals after the rotation.
    """

    pose: Matrix
    planes_a: tuple[Plane, Plane, Plane]
    planes_b: tuple[Plane, Plane, Plane]
    corner_a: Matrix
    corner_b: Matrix
    found_a: tuple[Plane, ...]
    found_b: tuple[Plane, ...]
    ranks_a: tuple[int, int, int]
    ranks_b: tuple[int, int, int]
    leftover: tuple[float, float, float]


def segment(
    points: NDArray[np.floating], seed: int, options: PlaneMatchingOptions | None = None
) -> list[Plane]:
    """Find the planes of evenly sampled points (N, 3), metres: largest first, inliers removed before the next."""
    options = options or PlaneMatchingOptions()
    found = _core.segment_planes(
        np.ascontiguousarray(points, dtype=np.float32),
        tolerance=options.tolerance,
        candidates=options.candidates,
        least=max(3, int(options.least_share * len(points))),
        most=options.planes,
        seed=seed % 2**63,
    )
    return [
        Plane(np.array(normal), distance, thick, points[inliers].mean(axis=0, dtype=np.float64), inliers)
        for normal, distance, thick, inliers in found
    ]


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
    for triple in sorted(combinations(range(len(planes)), 3), key=lambda t: t[::-1]):
        i, j, k = triple
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
) -> tuple[tuple[int, int, int], tuple[float, float, float]]:
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
    signs = [1.0 if cosines[order[k], k] >= 0 else -1.0 for k in range(3)]
    return (order[0], order[1], order[2]), (signs[0], signs[1], signs[2])


Pair = tuple[int, int, float]  # index in `a`, index in `b`, sign of `a`'s normal


def consistent_pairs(
    found_a: Sequence[Plane],
    found_b: Sequence[Plane],
    a: NDArray[np.floating],
    b: NDArray[np.floating],
    start: Matrix,
    options: PlaneMatchingOptions | None = None,
) -> list[Pair]:
    """Pair the planes that one motion near the initial alignment lays on each other.

    Closest normals alone cannot tell parallel walls apart. So every three pairs with alike normals propose their
    motion (Eq. 5 to 7); those that lay most plane on plane are compared by the points (N, 3), (M, 3) that come to lie
    on each other, and the best motion's pairs are given, the largest first, by the smaller plane of each.
    """
    options = options or PlaneMatchingOptions()
    sizes = np.minimum.outer([p.points for p in found_a], [p.points for p in found_b])
    off = _differences(found_a, found_b, start[None])
    signs = np.where(off.cosines[0] >= 0, 1.0, -1.0)
    alike = np.argwhere((off.angles[0] <= options.widest) & (off.metres[0] <= options.farthest))
    alike = alike[np.argsort(-sizes[alike[:, 0], alike[:, 1]], kind="stable")]
    alike = alike[_largest_of_each_facing(alike[:, 1], found_b)]
    motions: list[Matrix] = []
    for triple in combinations(alike.tolist(), 3):
        if len({i for i, _ in triple}) < 3 or len({j for _, j in triple}) < 3:
            continue
        pairs = [(found_a[i], found_b[j], signs[i, j]) for i, j in triple]
        if _spans_a_corner(pairs, options):
            pose = _pose(pairs, start)
            if _near_start(pose, start, pairs, options):
                motions.append(pose)
    if not motions:
        return []
    scores = []
    for stretch in range(0, len(motions), 512):
        near = _near(_differences(found_a, found_b, np.stack(motions[stretch : stretch + 512])), options)
        # Each plane counts once, with its best partner.
        scores.append(
            np.minimum((near * sizes).max(axis=1).sum(axis=1), (near * sizes).max(axis=2).sum(axis=1))
        )
    ranked = np.argsort(-np.concatenate(scores), kind="stable")[:_COMPARED]
    best = max(ranked.tolist(), key=lambda k: _lying_on(a, b, motions[k], options.near))
    last = _differences(found_a, found_b, motions[best][None])
    near = _near(last, options)[0]
    cost = np.where(
        near, np.hypot(last.angles[0] / options.near_angle, last.metres[0] / options.near), np.inf
    )
    pairs_found = [
        (int(i), int(j), 1.0 if last.cosines[0, i, j] >= 0 else -1.0)
        for i, j in np.argwhere(near)
        if cost[i, j] == cost[i].min() == cost[:, j].min()
    ]
    return sorted(pairs_found, key=lambda p: (-sizes[p[0], p[1]], p[:2]))


# Pairs with alike normals that propose motions, the largest of each facing, and facings; rough ground, which is many
# planes, must not crowd out the walls. Threes of pairs grow with the cube of the first.
_MOST_PAIRS = 12
_MOST_FACINGS = 5
# Motions that are compared by points, and the points of `a` that they are compared by.
_COMPARED = 24
_SAMPLES = 3000


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


def _differences(found_a: Sequence[Plane], found_b: Sequence[Plane], poses: Matrix) -> _Differences:
    def stacked(planes: Sequence[Plane], name: str) -> Matrix:
        return np.array([getattr(plane, name) for plane in planes], dtype=np.float64).reshape(-1, 3)

    normals = np.einsum("kij,aj->kai", poses[:, :3, :3], stacked(found_a, "normal"))
    centroids = (
        np.einsum("kij,aj->kai", poses[:, :3, :3], stacked(found_a, "centroid")) + poses[:, None, :3, 3]
    )
    normals_b, centroids_b = stacked(found_b, "normal"), stacked(found_b, "centroid")
    distances_b = np.array([plane.distance for plane in found_b])
    cosines = normals @ normals_b.T
    from_b = np.abs(centroids @ normals_b.T - distances_b)
    from_a = np.abs(np.einsum("kai,kabi->kab", normals, centroids_b[None, None] - centroids[:, :, None]))
    # Parts of one wall that lie far apart are seen far from it where a motion is turned.
    return _Differences(cosines, np.arccos(np.clip(np.abs(cosines), 0.0, 1.0)), np.minimum(from_a, from_b))


def _near(off: _Differences, options: PlaneMatchingOptions) -> NDArray[np.bool_]:
    near: NDArray[np.bool_] = (off.angles <= options.near_angle) & (off.metres <= options.near)
    return near


def _near_start(
    pose: Matrix, start: Matrix, pairs: Sequence[tuple[Plane, Plane, float]], options: PlaneMatchingOptions
) -> bool:
    """Whether the motion leaves the scans where the initial alignment put them, as far as that is good for."""
    middles = np.stack([plane.centroid for plane, _, _ in pairs])
    moved = np.linalg.norm(transform(pose, middles) - transform(start, middles), axis=1)
    return rotation_angle(pose[:3, :3] @ start[:3, :3].T) <= options.widest and bool(
        moved.mean() <= 1.5 * options.farthest
    )


def _lying_on(a: NDArray[np.floating], b: NDArray[np.floating], pose: Matrix, reach: float) -> float:
    """How many points of `a` come to lie on `b`, nearer ones counting more."""
    drawn = a[:: max(1, len(a) // _SAMPLES)]
    moved = np.ascontiguousarray(transform(pose, drawn), dtype=np.float32)
    distances = _core.nearest_distances(np.ascontiguousarray(b, dtype=np.float32), moved, reach)
    return float(np.maximum(0.0, 1.0 - distances / reach).sum())


def sequential_rotation(normals_a: Matrix, normals_b: Matrix) -> Matrix:
    """Eq. 6: the rotations that take each normal of `a` in turn onto its partner, (3, 3) rows each, multiplied.

    Each is Eq. 5 (`geometry.se3.rotation_between`). The product takes the last normal onto its partner exactly;
    what the angles between the normals differ by stays with the others.
    """
    rotation: Matrix = np.eye(3)
    for normal_a, normal_b in zip(normals_a, normals_b, strict=True):
        rotation = rotation_between(rotation @ normal_a, normal_b) @ rotation
    return rotation


def corner(normals: Matrix, distances: Matrix) -> Matrix:
    """Eq. 7: the point (3,) that lies on three planes ``normal . x = distance``, normals (3, 3) as rows.

    Raises
    ------
    PlanesRefused
        They have no single common point.
    """
    if abs(np.linalg.det(normals)) < 1e-9:
        raise PlanesRefused("the three planes have no corner: they are parallel to one line")
    point: Matrix = np.asarray(np.linalg.solve(normals, distances), dtype=np.float64)
    return point


def match_planes(
    a: NDArray[np.floating],
    b: NDArray[np.floating],
    start: Matrix,
    seeds: tuple[int, int],
    options: PlaneMatchingOptions | None = None,
) -> PlaneMatch:
    """Align the points `a` (N, 3) with the points `b` (M, 3), metres, evenly sampled, by three planes of each.

    Parameters
    ----------
    start
        ``b_from_a`` of the initial alignment, which pairs the planes.
    seeds
        Of the random samples, for `a` and for `b`.

    Raises
    ------
    PlanesRefused
        Fewer than three independent planes, or no pairing that can be told from the others.
    """
    options = options or PlaneMatchingOptions()
    found_a, found_b = segment(a, seeds[0], options), segment(b, seeds[1], options)
    if options.choice == "largest":
        three = _largest(found_a, found_b, start, options)
    else:
        three = _best_consistent(found_a, found_b, a, b, start, options)
    pose = _pose(three, start)
    planes_a, planes_b = [plane for plane, _, _ in three], [plane for _, plane, _ in three]
    paired = np.stack([sign * plane.normal for plane, _, sign in three])
    normals_b = np.stack([plane.normal for plane in planes_b])
    cosines = np.einsum("ij,ij->i", paired @ pose[:3, :3].T, normals_b)
    leftover = np.arccos(np.clip(cosines, -1.0, 1.0))
    corner_a = _corner_of(planes_a)
    return PlaneMatch(
        pose=pose,
        planes_a=(planes_a[0], planes_a[1], planes_a[2]),
        planes_b=(planes_b[0], planes_b[1], planes_b[2]),
        corner_a=corner_a,
        corner_b=_corner_of(planes_b),
        found_a=tuple(found_a),
        found_b=tuple(found_b),
        ranks_a=_ranks(planes_a, found_a),
        ranks_b=_ranks(planes_b, found_b),
        leftover=(float(leftover[0]), float(leftover[1]), float(leftover[2])),
    )


def _pose(three: Sequence[tuple[Plane, Plane, float]], start: Matrix) -> Matrix:
    """Eq. 6 and 7 for three pairs of planes, normals turned by the initial alignment first."""
    paired = np.stack([sign * plane.normal for plane, _, sign in three])
    normals_b = np.stack([plane.normal for _, plane, _ in three])
    rotation = sequential_rotation(paired @ start[:3, :3].T, normals_b) @ start[:3, :3]
    corner_a, corner_b = _corner_of([p for p, _, _ in three]), _corner_of([q for _, q, _ in three])
    return motion(rotation, corner_b - rotation @ corner_a)


def _on_common_area(
    pair: tuple[Plane, Plane, float],
    a: NDArray[np.floating],
    b: NDArray[np.floating],
    pose: Matrix,
    reach: float,
) -> tuple[Plane, Plane, float]:
    """Fit both planes of a pair where both scans saw them: no ground and no wall is flat all over."""
    plane_a, plane_b, sign = pair
    on_a, on_b = a[plane_a.inliers].astype(np.float64), b[plane_b.inliers].astype(np.float64)
    moved = transform(pose, on_a)
    shared_a = _within(moved, on_b, reach)
    shared_b = _within(on_b, moved, reach)
    if min(shared_a.sum(), shared_b.sum()) < _LEAST_COMMON:
        return pair
    return (
        _refitted(plane_a, on_a[shared_a], plane_a.inliers),
        _refitted(plane_b, on_b[shared_b], plane_b.inliers),
        sign,
    )


# Points on the common area that a plane may be fitted to.
_LEAST_COMMON = 30


def _within(queries: Matrix, points: Matrix, reach: float) -> NDArray[np.bool_]:
    distances = _core.nearest_distances(
        np.ascontiguousarray(points, dtype=np.float32), np.ascontiguousarray(queries, dtype=np.float32), reach
    )
    return np.isfinite(distances)


def _refitted(plane: Plane, points: Matrix, inliers: NDArray[np.uint32]) -> Plane:
    centroid = points.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((points - centroid).T))
    normal = vectors[:, 0] * (1.0 if vectors[:, 0] @ plane.normal >= 0 else -1.0)
    return Plane(normal, float(normal @ centroid), float(np.sqrt(max(values[0], 0.0))), centroid, inliers)


def _ranks(three: Sequence[Plane], found: Sequence[Plane]) -> tuple[int, int, int]:
    ranks = [1 + next(k for k, plane in enumerate(found) if plane.inliers is one.inliers) for one in three]
    return ranks[0], ranks[1], ranks[2]


def _corner_of(planes: Sequence[Plane]) -> Matrix:
    return corner(np.stack([p.normal for p in planes]), np.array([p.distance for p in planes]))


def _largest(
    found_a: Sequence[Plane], found_b: Sequence[Plane], start: Matrix, options: PlaneMatchingOptions
) -> list[tuple[Plane, Plane, float]]:
    three_a, three_b = _corners(found_a, found_b, options)
    normals_a = np.stack([plane.normal for plane in three_a]) @ start[:3, :3].T
    order, signs = pair_by_normals(normals_a, np.stack([plane.normal for plane in three_b]), options)
    return [(three_a[k], plane, sign) for k, plane, sign in zip(order, three_b, signs, strict=True)]


Three = list[tuple[Plane, Plane, float]]

# How often pairs are fitted on the area that both scans saw, and how many, the largest.
_COMMON_FITS = 2
_FITTED = 10


def _best_consistent(
    found_a: Sequence[Plane],
    found_b: Sequence[Plane],
    a: NDArray[np.floating],
    b: NDArray[np.floating],
    start: Matrix,
    options: PlaneMatchingOptions,
) -> Three:
    """Of the pairs that one motion lays on each other, the three whose corner brings most points together."""
    _corners(found_a, found_b, options)
    pairs = consistent_pairs(found_a, found_b, a, b, start, options)
    if not pairs:
        raise PlanesRefused(
            f"of {len(found_a)} and {len(found_b)} planes no three can be laid on three of the other scan near the "
            f"initial alignment (within {np.degrees(options.widest):.0f} deg and {options.farthest:g} m)"
        )
    try:
        three_b = first_three([found_b[j] for _, j, _ in pairs], options)
    except PlanesRefused as refusal:
        raise PlanesRefused(f"of the planes that one motion lays on each other, {refusal}") from None
    paired = [(found_a[i], found_b[j], sign) for i, j, sign in pairs]
    three = [next(pair for pair in paired if pair[1] is plane) for plane in three_b]
    for _ in range(_COMMON_FITS):
        pose = _pose(three, start)
        fitted = [_on_common_area(pair, a, b, pose, 2 * options.near) for pair in paired[:_FITTED]]
        threes = [list(one) for one in combinations(fitted, 3) if _spans_a_corner(one, options)]
        if not threes:
            break
        three = max(threes, key=lambda one: _lying_on(a, b, _pose(one, start), options.near))
    return three


def _spans_a_corner(three: Sequence[tuple[Plane, Plane, float]], options: PlaneMatchingOptions) -> bool:
    volumes = _volume([plane for plane, _, _ in three]), _volume([plane for _, plane, _ in three])
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
