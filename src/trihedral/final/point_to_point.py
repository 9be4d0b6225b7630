"""The paper's final alignment of scans that overlap much: point-to-point ICP with Levenberg-Marquardt.

After Fitzgibbon (2003) and Fantoni et al. (2012). Outliers are told by the X84 rule (Hampel et al. 1986), as Fusiello
et al. (2002) do in ICP. docs/paper.md says why the kernel is ours.
"""

from dataclasses import dataclass

import numpy as np

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float32, Floating
from trihedral.geometry.se3 import Matrix, transform


@dataclass(frozen=True)
class IcpOptions:
    """When points pull on each other, and when it ends."""

    #: Metres: points farther apart do not pull.
    max_correspondence_distance: float = np.inf
    #: Points of the moving scan, evenly drawn; all of the reference scan are searched.
    samples: int = 20_000
    #: Steps of each round, at the most.
    iterations: int = 200
    #: Metres; a step below this and below `rotation` ends a round.
    translation: float = 1e-5
    #: Radians.
    rotation: float = 1e-6
    #: Median deviations from the median distance beyond which points are outliers; 5.2 are 3.5 sigma of a Gaussian.
    outliers: float = 5.2
    #: Of leaving outliers out, at the most.
    rounds: int = 10

    def __post_init__(self) -> None:
        limits = min(self.max_correspondence_distance, self.outliers)
        if not limits > 0 or self.samples < 3 or self.iterations < 1:
            raise OptionError(
                "ICP needs a positive max_correspondence_distance and limit of outliers, 3 samples and 1 iteration"
            )
        if min(self.translation, self.rotation, self.rounds) < 0:
            raise OptionError("translation, rotation and rounds of ICP must not be negative")


@dataclass(frozen=True)
class IcpAlignment:
    """What ICP ended with."""

    #: ``b_from_a``, 4x4.
    pose: Matrix
    #: Root mean square distance (m) to the nearest points; fit, not accuracy. NaN where no point had one.
    rmse: float
    #: Points that had a neighbour near enough.
    matched: int
    iterations: int
    converged: bool
    #: Metres beyond which points were outliers in the end.
    max_correspondence_distance: float


def align(a: Floating, b: Floating, start: Matrix, options: IcpOptions | None = None) -> IcpAlignment:
    """Align the points `a` (N, 3) with the points `b` (M, 3), metres, from a start ``b_from_a``.

    Aligned once within the maximum correspondence distance, then again and again within that which the distances
    themselves call inliers, until that stays the same.
    """
    options = options or IcpOptions()
    drawn = np.linspace(0, len(a), min(options.samples, len(a)), endpoint=False).astype(np.int64)
    moving = np.ascontiguousarray(a[drawn], dtype=np.float32)
    fixed = np.ascontiguousarray(b, dtype=np.float32)
    pose, limit, iterations = start, options.max_correspondence_distance, 0
    for rounds_left in range(options.rounds, -1, -1):
        found = _core.align_points(
            moving,
            fixed,
            pose,
            max_distance=limit,
            iterations=options.iterations,
            translation=options.translation,
            rotation=options.rotation,
        )
        pose, iterations = found.pose, iterations + found.iterations
        if found.matched < 3 or not rounds_left:
            break
        inliers = min(options.max_correspondence_distance, _inlier_distance(moving, fixed, pose, options))
        if abs(inliers - limit) < 0.01 * limit:
            break
        limit = inliers
    return IcpAlignment(pose, found.rmse, found.matched, iterations, found.converged, limit)


def _inlier_distance(moving: Float32, fixed: Float32, pose: Matrix, options: IcpOptions) -> float:
    """X84: the median distance of neighbours, and so many median deviations from it."""
    moved = np.ascontiguousarray(transform(pose, moving), dtype=np.float32)
    distances = _core.nearest_distances(fixed, moved, options.max_correspondence_distance)
    distances = distances[np.isfinite(distances)]
    if not len(distances):
        return options.max_correspondence_distance
    median = float(np.median(distances))
    return median + options.outliers * float(np.median(np.abs(distances - median)))
