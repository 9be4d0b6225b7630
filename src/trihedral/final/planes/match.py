"""The paper's final alignment of scans that overlap little: three planes of each, paired by their normals.

docs/paper.md says what the paper leaves open about the choice of the three, and what was measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trihedral.final.planes.choice import consistent_three, largest_three
from trihedral.final.planes.options import PlaneMatchingOptions
from trihedral.final.planes.pose import corner_of, paired_normals, pose_of
from trihedral.final.planes.segmentation import Plane, segment
from trihedral.geometry.arrays import Floating
from trihedral.geometry.se3 import Matrix


@dataclass(frozen=True)
class PlaneMatch:
    """A pose from three pairs of planes."""

    #: ``b_from_a``, 4x4.
    pose: Matrix
    #: The three of each scan, pair by pair, in the order of `b`'s sizes, each in its own scan's coordinates.
    planes_a: tuple[Plane, ...]
    planes_b: tuple[Plane, ...]
    #: (3,) where they meet, metres.
    corner_a: Matrix
    corner_b: Matrix
    #: Every plane that was segmented, largest first.
    found_a: tuple[Plane, ...]
    found_b: tuple[Plane, ...]
    #: Of the three among those by size, from 1.
    ranks_a: tuple[int, ...]
    ranks_b: tuple[int, ...]
    #: Angles (rad) between the paired normals after the rotation.
    leftover: tuple[float, ...]


def match_planes(
    a: Floating,
    b: Floating,
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
        three = largest_three(found_a, found_b, start, options)
    else:
        three = consistent_three(found_a, found_b, a, b, start, options)
    pose = pose_of(three, start)
    normals_a, normals_b = paired_normals(three)
    cosines = np.einsum("ij,ij->i", normals_a @ pose[:3, :3].T, normals_b)
    planes_a, planes_b = tuple(pair.a for pair in three), tuple(pair.b for pair in three)
    return PlaneMatch(
        pose=pose,
        planes_a=planes_a,
        planes_b=planes_b,
        corner_a=corner_of(planes_a),
        corner_b=corner_of(planes_b),
        found_a=tuple(found_a),
        found_b=tuple(found_b),
        ranks_a=_ranks(planes_a, found_a),
        ranks_b=_ranks(planes_b, found_b),
        leftover=tuple(np.arccos(np.clip(cosines, -1.0, 1.0)).tolist()),
    )


def _ranks(three: Sequence[Plane], found: Sequence[Plane]) -> tuple[int, ...]:
    # A plane that was fitted again has the inliers of the one that was found.
    return tuple(1 + next(k for k, p in enumerate(found) if p.inliers is one.inliers) for one in three)
