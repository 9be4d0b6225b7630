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
from trihedral.geometry.motion import Matrix, motion, rotation_between, transform

Choice = Literal["counterparts", "largest"]


@dataclass(frozen=True)
class PlaneMatchingOptions:
    """How planes are found and when three of them will do."""

    # "largest": the first three independent planes of each scan, whether or not they are the same walls;
    # "counterparts": of the planes that have a counterpart in the other scan after the initial alignment.
    choice: Choice = "counterparts"
    tolerance: float = 0.05  # metres from a plane within which points are its inliers
    candidates: int = 3000  # planes through three points that are tried for each that is found
    planes: int = 12  # segmented at the most before the search for three gives up
    least_share: float = 0.01  # of the points; smaller planes are not looked at
    # Volume of the box that three unit normals span, at least: 1 for a right corner, 0 for planes without a corner.
    independence: float = 0.35
    widest: float = np.radians(30.0)  # radians between paired normals after the initial alignment, at most
    farthest: float = 3.0  # metres between counterparts after the initial alignment, at most
    # The best pairing is off by less than this share of what the next one is.
    distinctness: float = 0.7

    def __post_init__(self) -> None:
        if self.choice not in ("counterparts", "largest"):
            raise OptionError(f"planes are chosen as 'counterparts' or 'largest', not {self.choice!r}")
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


def counterparts(
    found_a: Sequence[Plane],
    found_b: Sequence[Plane],
    start: Matrix,
    options: PlaneMatchingOptions | None = None,
) -> list[tuple[int, int, float]]:
    """Pair planes by their normals and, among parallel ones, by their distance under the initial alignment.

    A pair is kept where each is the other's closest and nothing else is nearly as close.

    Returns
    -------
    Index in `found_a`, index in `found_b`, sign of `a`'s normal; the largest first, by the smaller of the two.
    """
    options = options or PlaneMatchingOptions()
    off = np.full((len(found_a), len(found_b)), np.inf)
    signs = np.ones_like(off)
    for i, a in enumerate(found_a):
        normal, centroid = start[:3, :3] @ a.normal, transform(start, a.centroid[None])[0]
        for j, b in enumerate(found_b):
            cosine = float(normal @ b.normal)
            angle = np.arccos(min(1.0, abs(cosine)))
            # Parts of one wall that lie far apart are seen far from it where the initial alignment is turned.
            metres = min(abs(b.normal @ centroid - b.distance), abs(normal @ (b.centroid - centroid)))
            signs[i, j] = 1.0 if cosine >= 0 else -1.0
            if angle <= options.widest and metres <= options.farthest:
                off[i, j] = np.hypot(angle / options.widest, metres / options.farthest)
    pairs = []
    for i, j in zip(*np.nonzero(np.isfinite(off)), strict=True):
        others = np.concatenate([np.delete(off[i], j), np.delete(off[:, j], i)])
        if off[i, j] < options.distinctness * others.min(initial=np.inf):
            pairs.append((int(i), int(j), float(signs[i, j])))
    return sorted(pairs, key=lambda p: (-min(found_a[p[0]].points, found_b[p[1]].points), p[:2]))


def sequential_rotation(normals_a: Matrix, normals_b: Matrix) -> Matrix:
    """Eq. 6: the rotations that take each normal of `a` in turn onto its partner, (3, 3) rows each, multiplied.

    Each is Eq. 5 (`geometry.motion.rotation_between`). The product takes the last normal onto its partner exactly;
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
    choose = _largest if options.choice == "largest" else _largest_counterparts
    three_a, three_b, signs = choose(found_a, found_b, start, options)
    paired = np.stack([sign * plane.normal for plane, sign in zip(three_a, signs, strict=True)])
    normals_b = np.stack([plane.normal for plane in three_b])
    distances = np.array([sign * plane.distance for plane, sign in zip(three_a, signs, strict=True)])
    rotation = sequential_rotation(paired @ start[:3, :3].T, normals_b) @ start[:3, :3]
    corner_a = corner(paired, distances)
    corner_b = corner(normals_b, np.array([plane.distance for plane in three_b]))
    cosines = np.einsum("ij,ij->i", paired @ rotation.T, normals_b)
    leftover = np.arccos(np.clip(cosines, -1.0, 1.0))
    return PlaneMatch(
        pose=motion(rotation, corner_b - rotation @ corner_a),
        planes_a=three_a,
        planes_b=three_b,
        corner_a=corner_a,
        corner_b=corner_b,
        found_a=tuple(found_a),
        found_b=tuple(found_b),
        leftover=(float(leftover[0]), float(leftover[1]), float(leftover[2])),
    )


Three = tuple[Plane, Plane, Plane]


def _largest(
    found_a: Sequence[Plane], found_b: Sequence[Plane], start: Matrix, options: PlaneMatchingOptions
) -> tuple[Three, Three, Sequence[float]]:
    chosen = []
    for name, found in (("moving", found_a), ("reference", found_b)):
        try:
            chosen.append(first_three(found, options))
        except PlanesRefused as refusal:
            raise PlanesRefused(f"in the {name} scan, {refusal}") from None
    three_a, three_b = chosen
    normals_a = np.stack([plane.normal for plane in three_a]) @ start[:3, :3].T
    order, signs = pair_by_normals(normals_a, np.stack([plane.normal for plane in three_b]), options)
    return (three_a[order[0]], three_a[order[1]], three_a[order[2]]), three_b, signs


def _largest_counterparts(
    found_a: Sequence[Plane], found_b: Sequence[Plane], start: Matrix, options: PlaneMatchingOptions
) -> tuple[Three, Three, Sequence[float]]:
    for name, found in (("moving", found_a), ("reference", found_b)):
        try:
            first_three(found, options)
        except PlanesRefused as refusal:
            raise PlanesRefused(f"in the {name} scan, {refusal}") from None
    pairs = counterparts(found_a, found_b, start, options)
    try:
        three_b = first_three([found_b[j] for _, j, _ in pairs], options)
    except PlanesRefused as refusal:
        raise PlanesRefused(
            f"{len(pairs)} of {len(found_a)} and {len(found_b)} planes have a counterpart that can be told from "
            f"others; of these, {refusal}"
        ) from None
    chosen = [next(pair for pair in pairs if found_b[pair[1]] is plane) for plane in three_b]
    three_a = tuple(found_a[i] for i, _, _ in chosen)
    return (three_a[0], three_a[1], three_a[2]), three_b, [sign for _, _, sign in chosen]


def _volume(planes: Sequence[Plane]) -> float:
    return float(np.linalg.det(np.stack([plane.normal for plane in planes])))
