"""Overlap as the paper counts it: the share of a scan's area that has the other scan for its nearest neighbour.

Both clouds are sampled evenly, so that a share of points is a share of area.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.geometry.motion import Matrix, inverse, transform

Points = NDArray[np.floating]

# Of the area of the reference scan: where ICP and plane matching cross in Table 2 and Fig. 5.
THRESHOLD = 0.89


@dataclass(frozen=True)
class OverlapOptions:
    """When a point has a neighbour, and how much overlap ICP needs."""

    # Times the coarser of the two samplings; nothing finer can be asked of clouds that were sampled apart.
    spacings: float = 2.0
    # Metres that the initial alignment may be off: without them a coarse start would look like little overlap.
    slack: float = 0.5
    threshold: float = THRESHOLD  # share of the reference scan's area from which ICP is used

    def __post_init__(self) -> None:
        if self.spacings <= 0 or self.slack < 0:
            raise OptionError("the overlap's radius must be positive: spacings over 0, slack not below 0")
        if not 0.0 <= self.threshold <= 1.0:
            raise OptionError(f"the overlap threshold is a share between 0 and 1, not {self.threshold:g}")

    def radius(self, spacing_a: float, spacing_b: float) -> float:
        """Metres within which points of two clouds of those samplings are neighbours."""
        return self.spacings * max(spacing_a, spacing_b) + self.slack


@dataclass(frozen=True)
class Overlap:
    """What two clouds share under a pose.

    Attributes
    ----------
    of_a, of_b
        Shares of each cloud's points; `of_b` is the paper's figure where `b` is the reference scan.
    shared_a, shared_b
        (N,) and (M,) which points have a neighbour.
    radius
        Metres within which they have it.
    """

    of_a: float
    of_b: float
    shared_a: NDArray[np.bool_]
    shared_b: NDArray[np.bool_]
    radius: float


def overlap(a: Points, b: Points, b_from_a: Matrix, radius: float) -> Overlap:
    """Count the points of either cloud that have one of the other within `radius`.

    Parameters
    ----------
    a, b
        (N, 3) and (M, 3) evenly sampled points, metres.
    b_from_a
        4x4.
    radius
        Metres.

    Raises
    ------
    OptionError
        The radius is not positive.
    """
    if not radius > 0.0:
        raise OptionError(f"the radius of overlap must be positive, not {radius:g} m")
    shared_a = has_neighbour(transform(b_from_a, a), b, radius)
    shared_b = has_neighbour(transform(inverse(b_from_a), b), a, radius)
    shares = [float(shared.mean()) if len(shared) else 0.0 for shared in (shared_a, shared_b)]
    return Overlap(shares[0], shares[1], shared_a, shared_b, radius)


def has_neighbour(queries: Points, points: Points, radius: float) -> NDArray[np.bool_]:
    """(N,) whether each query (N, 3) has one of the points (M, 3) nearer than `radius` (m)."""
    distances = _core.nearest_distances(
        np.ascontiguousarray(points, dtype=np.float32),
        np.ascontiguousarray(queries, dtype=np.float32),
        radius,
    )
    return np.isfinite(distances)
