"""Poses from the shape of the surface around places where it is not plane, by Fast Point Feature Histograms.

R. B. Rusu, N. Blodow and M. Beetz, "Fast Point Feature Histograms (FPFH) for 3D registration", ICRA 2009.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from trihedral.errors import OptionError
from trihedral.initial.facets import thinned
from trihedral.initial.matching import MatchOptions, match
from trihedral.initial.rigid_agreement import rigid_agreements
from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

BINS = 11  # of each of the three angles
LENGTH = 3 * BINS
# Spread of the normals around a place (1 less the length of their mean) from which it is not plane.
LEAST_SPREAD = 0.03


@dataclass(frozen=True)
class ShapeOptions:
    """How shapes are described and become poses."""

    spacings: tuple[float, ...] = (
        0.25,
        0.75,
    )  # metres between the points of each level, the same in all scans
    reach: float = 5.0  # spacings around a place that its descriptor tells of
    neighbours: int = 48  # of a place, at the most
    points: int = 8_000  # of a level, at the most; evenly drawn
    most: int = 900  # places described on a level
    match: MatchOptions = field(default_factory=lambda: MatchOptions(ratio=1.0))
    most_matches: int = 1000
    poses: int = 30  # proposed at the most

    def __post_init__(self) -> None:
        if not self.spacings or min(self.spacings) <= 0 or self.reach < 2:
            raise OptionError("spacings must be positive and reach at least 2 of them")
        if min(self.neighbours, self.points, self.most, self.most_matches, self.poses) < 3:
            raise OptionError("neighbours, points, most, most_matches and poses must be at least 3")


def shape_descriptors(prepared: Prepared, options: ShapeOptions) -> dict[str, NDArray[np.generic]]:
    """Fields of `Prepared` on the shape around places where its surface is not plane."""
    points, levels, descriptors = [], [], []
    for level, spacing in enumerate(options.spacings):
        index = thinned(prepared, spacing)
        index = index[:: max(1, -(-len(index) // options.points))]
        found = _described(
            prepared.points[index].astype(np.float64),
            prepared.normals[index].astype(np.float64),
            options.reach * spacing,
            options,
        )
        places, values = found
        points.append(prepared.points[index[places]])
        levels.append(np.full(len(places), level, dtype=np.uint8))
        descriptors.append(values)
    return {
        "shape_points": np.concatenate(points),
        "shape_levels": np.concatenate(levels),
        "shape_descriptors": np.concatenate(descriptors),
    }


def _described(
    points: Float64, normals: Float64, reach: float, options: ShapeOptions
) -> tuple[NDArray[np.intp], NDArray[np.uint8]]:
    """Indices of the places that are described, and (K, 33) descriptors whose squared length is about 512**2."""
    nothing = np.empty(0, dtype=np.intp), np.empty((0, LENGTH), dtype=np.uint8)
    if len(points) < 3:
        return nothing
    count = min(options.neighbours + 1, len(points))
    apart, near = KDTree(points).query(points, k=count, distance_upper_bound=reach)
    apart, near = apart[:, 1:], near[:, 1:]
    known = np.isfinite(apart) & (apart > 0)
    near = np.where(known, near, 0)
    simple = _simple_histograms(points, normals, near, apart, known)
    mean = (normals[near] * known[..., None]).sum(axis=1) + normals
    spread = 1 - np.linalg.norm(mean, axis=1) / (known.sum(axis=1) + 1)
    places = np.flatnonzero((spread > LEAST_SPREAD) & (known.sum(axis=1) >= 8))
    places = places[:: max(1, -(-len(places) // options.most))]
    weights = np.where(known[places], 1 / np.maximum(apart[places], 1e-6), 0.0)
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    histograms = simple[places] + np.einsum("kn,knd->kd", weights, simple[near[places]])
    # Square roots: the distance between them does not hang on the few fullest bins (Hellinger).
    unit = np.sqrt(histograms / np.maximum(histograms.sum(axis=1, keepdims=True), 1e-12))
    return places, np.minimum(np.rint(512 * unit), 255).astype(np.uint8)


def _simple_histograms(
    points: Float64, normals: Float64, near: NDArray[np.intp], apart: Float64, known: NDArray[np.bool_]
) -> Float64:
    """(N, 33) histograms of the three angles between each point's normal and those of its neighbours."""
    here, slot = np.nonzero(known)
    there = near[here, slot]
    line = (points[there] - points[here]) / apart[here, slot][:, None]
    u, other = normals[here], normals[there]
    v = np.cross(u, line)
    length = np.linalg.norm(v, axis=1)
    v /= np.maximum(length, 1e-9)[:, None]
    w = np.cross(u, v)
    angles = (
        (np.einsum("ij,ij->i", v, other) + 1) / 2,
        (np.einsum("ij,ij->i", u, line) + 1) / 2,
        np.arctan2(np.einsum("ij,ij->i", w, other), np.einsum("ij,ij->i", u, other)) / (2 * np.pi) + 0.5,
    )
    histograms: Float64 = np.zeros((len(points), LENGTH))
    for k, angle in enumerate(angles):
        bins = k * BINS + np.clip((angle * BINS).astype(np.intp), 0, BINS - 1)
        histograms += np.bincount(here * LENGTH + bins, minlength=histograms.size).reshape(histograms.shape)
    histograms /= np.maximum(known.sum(axis=1), 1)[:, None]
    return histograms


def shape_poses(a: Prepared, b: Prepared, options: ShapeOptions) -> list[tuple[Float64, float]]:
    """Motions that many places of like shape agree on, with their scores, best first."""
    points_a, points_b, tolerance, ratio = [], [], [], []
    for level, spacing in enumerate(options.spacings):
        on_a, on_b = np.flatnonzero(a.shape_levels == level), np.flatnonzero(b.shape_levels == level)
        found = match(
            a.shape_descriptors[on_a].astype(np.float32),
            b.shape_descriptors[on_b].astype(np.float32),
            options.match,
        )
        points_a.append(a.shape_points[on_a[found.a]])
        points_b.append(b.shape_points[on_b[found.b]])
        tolerance.append(np.full(len(found), spacing))
        ratio.append(found.ratio)
    order = np.argsort(np.concatenate(ratio), kind="stable")[: options.most_matches]
    agreements = rigid_agreements(
        np.concatenate(points_a)[order].astype(np.float64),
        np.concatenate(points_b)[order].astype(np.float64),
        np.concatenate(tolerance)[order],
    )
    return [(agreement.pose, score) for agreement, score in agreements[: options.poses]]
