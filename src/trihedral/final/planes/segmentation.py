"""Planes of a scan, one after the other, the largest first."""

from dataclasses import dataclass

import numpy as np

from trihedral import _core
from trihedral.final.planes.options import PlaneMatchingOptions
from trihedral.geometry.arrays import Floating, Uint32
from trihedral.geometry.se3 import Matrix


@dataclass(frozen=True)
class Plane:
    """A plane ``normal . x = distance`` and the points that it was fitted to."""

    #: (3,) unit.
    normal: Matrix
    #: Metres.
    distance: float
    #: Standard deviation of the inliers across it, metres.
    thickness: float
    #: (3,) of the inliers, metres.
    centroid: Matrix
    #: (K,) indices of the points.
    inliers: Uint32

    @property
    def points(self) -> int:
        """How many points lie on it: its area where the cloud is evenly sampled."""
        return len(self.inliers)


def segment(points: Floating, seed: int, options: PlaneMatchingOptions | None = None) -> list[Plane]:
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
        Plane(
            normal=one.normal,
            distance=one.distance,
            thickness=one.thickness,
            centroid=points[one.inliers].mean(axis=0, dtype=np.float64),
            inliers=one.inliers,
        )
        for one in found
    ]
