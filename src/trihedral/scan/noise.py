"""How far the points of a scan, and the planes through them, are off the surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.scan.surfels import Surfels

# Metres: no surfel is truer than this.
LEAST_SIGMA = 0.0003
# Nor truer than this share of the scan's surface noise (docs/method/preparation.md).
LEAST_SHARE = 0.15
# Points that the scan's surface noise counts for in a surfel's own: eight points may by chance lie on their plane.
TYPICAL_POINTS = 10.0
# Of the noise about planes of scans that were thinned in space, what a plane may be off as a whole: cubes whose face
# is a sigma from the plane put it 0.6 sigma off, most are farther.
THINNED_BIAS = 0.3
# Parameters of a plane, which its points have to tell before they tell its noise.
PLANE_UNKNOWNS = 3.0


@dataclass(frozen=True)
class NoiseModel:
    """Noise and sampling of a scan.

    Attributes
    ----------
    range_noise
        Standard deviation of a range, metres, from neighbours by their directions.
    angular_step
        Angle between neighbouring beams, radians; NaN for a scan that was thinned in space.
    surface_noise
        Median standard deviation of the points across their local plane, metres.
    """

    range_noise: float
    angular_step: float
    surface_noise: float

    def plane_variances(self, surfels: Surfels) -> NDArray[np.float32]:
        """(M,) of the offset along the normal of each planar surfel, square metres."""
        planar = surfels.planar
        rests = np.maximum(surfels.support[planar] - PLANE_UNKNOWNS, 0)
        variances = rests * surfels.thickness[planar] ** 2 + TYPICAL_POINTS * self.surface_noise**2
        variances /= rests + TYPICAL_POINTS
        # A surfel stands for its own points: neighbours that share in its plane have surfels of their own.
        variances /= np.maximum(surfels.count[planar], 1)
        # Thousands of points near the scanner do not make a surfel true to a micrometre: what a plane leaves out of
        # the surface, and of the instrument, stays.
        variances += max(LEAST_SIGMA, LEAST_SHARE * self.surface_noise) ** 2
        narrowed: NDArray[np.float32] = variances.astype(np.float32)
        return narrowed

    @property
    def plane_bias(self) -> float:
        """Standard deviation of what all points of a plane are off together, metres.

        A program that thins a scan in space keeps a point of each of its cubes: of a plane along their faces it keeps
        as many points of the tail beyond a face as of all before it.
        """
        return 0.0 if np.isfinite(self.angular_step) else THINNED_BIAS * self.surface_noise

    @property
    def beam_variance(self) -> float:
        """Of a single beam off a surface, square metres: by the noise of its range at the most."""
        noise = self.range_noise if np.isfinite(self.range_noise) else self.surface_noise
        return max(LEAST_SIGMA, noise) ** 2
