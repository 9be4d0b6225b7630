"""The paper's final alignment of scans that overlap much: point-to-point ICP with Levenberg-Marquardt.

After Fitzgibbon (2003) and Fantoni et al. (2012). Outliers are told by the X84 rule (Hampel et al. 1986), as Fusiello
et al. (2002) do in ICP. docs/paper.md says why the kernel is ours.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.geometry.se3 import Matrix, transform


@dataclass(frozen=True)
class IcpOptions:
    """When points pull on each other, and when it ends."""

    reach: float = np.inf  # metres: farther points do not pull
    samples: int = 20_000  # points of the moving scan, evenly drawn; all of the reference scan are searched
    iterations: int = 200
    translation: float = 1e-5  # metres; a step below this and the next ends it
    rotation: float = 1e-6  # radians
    # Median deviations from the median distance beyond which points are outliers; 5.2 are 3.5 sigma of a Gaussian.
    outliers: float = 5.2
    rounds: int = 10  # of leaving them out, at the most

    def __post_init__(self) -> None:
        if not min(self.reach, self.outliers) > 0 or self.samples < 3 or self.iterations < 1:
            raise OptionError("ICP needs a positive reach and limit of outliers, 3 samples and 1 iteration")


@dataclass(frozen=True)
class IcpAlignment:
    """What ICP ended with.

    Attributes
    ----------
    pose
        ``b_from_a``, 4x4.
    rmse
        Root mean square distance (m) to the nearest points; fit, not accuracy. NaN where no point had one.
    matched
        Points that had a neighbour within reach.
    reach
        Metres beyond which points were outliers in the end.
    """

    pose: Matrix
    rmse: float
    matched: int
    iterations: int
    converged: bool
    reach: float


def align(
    a: NDArray[np.floating], b: NDArray[np.floating], start: Matrix, options: IcpOptions | None = None
) -> IcpAlignment:
    """Align the points `a` (N, 3) with the points `b` (M, 3), metres, from a start ``b_from_a``.

    Aligned once within the reach, then again and again within that which the distances themselves call inliers, until
    that stays the same.
    """
    options = options or IcpOptions()
    drawn = np.linspace(0, len(a), min(options.samples, len(a)), endpoint=False).astype(np.int64)
    moving = np.ascontiguousarray(a[drawn], dtype=np.float32)
    fixed = np.ascontiguousarray(b, dtype=np.float32)
    pose, reach, iterations = start, options.reach, 0
    for rounds_left in range(options.rounds, -1, -1):
        found, rmse, matched, steps, converged = _core.align_points(
            moving,
            fixed,
            pose,
            reach=reach,
            iterations=options.iterations,
            translation=options.translation,
            rotation=options.rotation,
        )
        pose, iterations = np.array(found), iterations + steps
        if matched < 3 or not rounds_left:
            break
        inliers = min(options.reach, _inlier_reach(moving, fixed, pose, options))
        if abs(inliers - reach) < 0.01 * reach:
            break
        reach = inliers
    return IcpAlignment(pose, rmse, matched, iterations, converged, reach)


def _inlier_reach(
    moving: NDArray[np.float32], fixed: NDArray[np.float32], pose: Matrix, options: IcpOptions
) -> float:
    """X84: the median distance of neighbours within reach, and so many median deviations from it."""
    moved = np.ascontiguousarray(transform(pose, moving), dtype=np.float32)
    distances = _core.nearest_distances(fixed, moved, options.reach)
    distances = distances[np.isfinite(distances)]
    if not len(distances):
        return options.reach
    median = float(np.median(distances))
    return median + options.outliers * float(np.median(np.abs(distances - median)))
