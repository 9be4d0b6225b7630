"""The paper's final alignment of scans that overlap much: point-to-point ICP with Levenberg-Marquardt.

After Fitzgibbon (2003) and Fantoni et al. (2012). docs/paper.md says why the kernel is ours.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.geometry.motion import Matrix


@dataclass(frozen=True)
class IcpOptions:
    """When points pull on each other, and when it ends."""

    reach: float = np.inf  # metres: farther points do not pull
    samples: int = 20_000  # points of the moving scan, evenly drawn; all of the reference scan are searched
    iterations: int = 200
    translation: float = 1e-5  # metres; a step below this and the next ends it
    rotation: float = 1e-6  # radians

    def __post_init__(self) -> None:
        if not self.reach > 0 or self.samples < 3 or self.iterations < 1:
            raise OptionError("ICP needs a positive reach, at least 3 samples and at least 1 iteration")


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
    """

    pose: Matrix
    rmse: float
    matched: int
    iterations: int
    converged: bool


def align(
    a: NDArray[np.floating], b: NDArray[np.floating], start: Matrix, options: IcpOptions | None = None
) -> IcpAlignment:
    """Align the points `a` (N, 3) with the points `b` (M, 3), metres, from a start ``b_from_a``."""
    options = options or IcpOptions()
    drawn = np.linspace(0, len(a), min(options.samples, len(a)), endpoint=False).astype(np.int64)
    pose, rmse, matched, iterations, converged = _core.align_points(
        np.ascontiguousarray(a[drawn], dtype=np.float32),
        np.ascontiguousarray(b, dtype=np.float32),
        start,
        reach=options.reach,
        iterations=options.iterations,
        translation=options.translation,
        rotation=options.rotation,
    )
    return IcpAlignment(np.array(pose), rmse, matched, iterations, converged)
