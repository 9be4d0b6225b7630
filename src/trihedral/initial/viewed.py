"""Poses from features on views of what the scanner saw, whatever its tilt."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trihedral.fusion.surroundings import Surroundings
from trihedral.initial.features import FeatureOptions, detect
from trihedral.initial.matching import MatchOptions, match
from trihedral.initial.rigid_agreement import rigid_agreements
from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

# Tangent of half the angle of a view; the faces of the cube have 1. Features near the rim of a face need surroundings.
HALF_WIDTH = 1.15
# Right and down of the view along each axis: right x down = forward.
VIEWS = tuple(
    (np.cross(down, forward), np.array(down), np.array(forward))
    for forward, down in (
        ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
        ((-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
        ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
        ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
        ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
    )
)


@dataclass(frozen=True)
class ViewedOptions:
    """How features of views become poses."""

    features: FeatureOptions = field(default_factory=lambda: FeatureOptions(most=400))  # of each view
    most_pixels: int = 384  # along each side of a view
    match: MatchOptions = field(default_factory=lambda: MatchOptions(ratio=0.9))
    tolerance: float = 0.05  # metres within which two keypoints are one place, beside their footprints
    tolerance_pixels: float = 2.0  # of the views, on the surface
    poses: int = 30  # proposed at the most


def viewed_keypoints(seen: Surroundings, options: ViewedOptions) -> dict[str, NDArray[np.generic]]:
    """Fields of `Prepared` on keypoints of the six views along the axes of the scanner."""
    size = min(round(seen.side * HALF_WIDTH), options.most_pixels)
    across = (np.arange(size, dtype=np.float32) - (size - 1) / 2) / (size / 2) * HALF_WIDTH
    points, footprints, sizes, descriptors = [], [], [], []
    for right, down, forward in VIEWS:
        rays = (across[None, :, None] * right + across[:, None, None] * down + forward).astype(np.float32)
        column, row = seen.places(rays)
        cells = np.rint(row).astype(np.intp), np.rint(column).astype(np.intp)
        # A place that two views show is taken from the one it is nearer to the middle of.
        own = np.abs(across) <= 1
        mask = ~seen.edge[cells] & own[:, None] & own
        found = detect(seen.pictured(column, row), mask, options.features)
        x, y = np.interp(found.pixels.T, np.arange(size), across)
        directions = x[:, None] * right + y[:, None] * down + forward
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        column, row = seen.places(directions)
        ranges = seen.range[np.rint(row).astype(np.intp), np.rint(column).astype(np.intp)]
        points.append(directions * ranges[:, None])
        footprints.append(ranges * 2 * HALF_WIDTH / size)
        sizes.append(found.scale * footprints[-1])
        descriptors.append(found.descriptors)
    return {
        "view_points": np.concatenate(points).astype(np.float32),
        "view_footprints": np.concatenate(footprints).astype(np.float32),
        "view_sizes": np.concatenate(sizes).astype(np.float32),
        "view_descriptors": np.concatenate(descriptors).astype(np.uint8),
    }


def viewed_poses(a: Prepared, b: Prepared, options: ViewedOptions) -> list[tuple[Float64, float]]:
    """Motions that many matched keypoints agree on, with their scores, best first."""
    found = match(
        a.view_descriptors.astype(np.float32),
        b.view_descriptors.astype(np.float32),
        options.match,
        sizes=(a.view_sizes, b.view_sizes),
    )
    footprint = np.maximum(a.view_footprints[found.a], b.view_footprints[found.b]).astype(np.float64)
    agreements = rigid_agreements(
        a.view_points[found.a].astype(np.float64),
        b.view_points[found.b].astype(np.float64),
        np.hypot(options.tolerance, options.tolerance_pixels * footprint),
    )
    return [(agreement.pose, score) for agreement, score in agreements[: options.poses]]
