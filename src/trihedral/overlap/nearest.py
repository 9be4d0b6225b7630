"""Overlap as the paper counts it: the share of a scan's area that has the other scan for its nearest neighbour.

Both clouds are sampled evenly, so that a share of points is a share of area.
"""

from dataclasses import dataclass

import numpy as np

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.geometry.arrays import Bool, Float64, Floating
from trihedral.geometry.se3 import Matrix, inverse, transform
from trihedral.overlap.sampling import neighbour_distances

# Of the area of the reference scan: where ICP and plane matching cross in Table 2 and Fig. 5.
THRESHOLD = 0.89


@dataclass(frozen=True)
class OverlapOptions:
    """When a point has a neighbour, and how much overlap ICP needs."""

    #: Times what the point lies from its neighbours in its own cloud: no other scan can be asked to be denser there.
    spacings: float = 1.0
    #: Metres that the initial alignment may be off: without them a coarse start would look like little overlap.
    slack: float = 0.5
    #: Share of the reference scan's area from which ICP is used.
    threshold: float = THRESHOLD

    def __post_init__(self) -> None:
        if self.spacings < 0 or self.slack < 0 or self.spacings + self.slack <= 0:
            raise OptionError("spacings and slack of the overlap must not be negative, and not both 0")
        if not 0.0 <= self.threshold <= 1.0:
            raise OptionError(f"the overlap threshold is a share between 0 and 1, not {self.threshold:g}")

    def radii(self, points: Floating) -> Float64:
        """Give the distance (N,) within which each of the points (N, 3) looks for a neighbour, metres."""
        return self.spacings * neighbour_distances(points) + self.slack


@dataclass(frozen=True)
class Overlap:
    """What two clouds share under a pose."""

    #: Shares of each cloud's points; `of_b` is the paper's figure where `b` is the reference scan.
    of_a: float
    of_b: float
    #: (N,) and (M,) which points have a neighbour.
    shared_a: Bool
    shared_b: Bool


def overlap(a: Floating, b: Floating, b_from_a: Matrix, options: OverlapOptions | None = None) -> Overlap:
    """Count the points of either cloud that have one of the other near them.

    Parameters
    ----------
    a, b
        (N, 3) and (M, 3) evenly sampled points, metres.
    b_from_a
        4x4.
    """
    options = options or OverlapOptions()
    shared_a = has_neighbour(transform(b_from_a, a), b, options.radii(a))
    shared_b = has_neighbour(transform(inverse(b_from_a), b), a, options.radii(b))
    shares = [float(shared.mean()) if len(shared) else 0.0 for shared in (shared_a, shared_b)]
    return Overlap(shares[0], shares[1], shared_a, shared_b)


def has_neighbour(queries: Floating, points: Floating, radius: float | Floating) -> Bool:
    """(N,) whether each query (N, 3) has one of the points (M, 3) nearer than its `radius` (m, or (N,))."""
    distances = _core.nearest_distances(
        np.ascontiguousarray(points, dtype=np.float32),
        np.ascontiguousarray(queries, dtype=np.float32),
        float(np.max(radius, initial=1e-6)),
    )
    return np.asarray(distances <= radius)
