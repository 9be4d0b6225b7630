"""The default final alignment: point to plane, both ways, over stages of shrinking maximum correspondence distance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trihedral import _core
from trihedral._core import Stage
from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float64
from trihedral.model.link import PoseEstimate, Residuals
from trihedral.scan.prepared import Prepared


@dataclass(frozen=True)
class RefinementOptions:
    """Stages of a refinement."""

    #: Maximum correspondence distances (m), stage by stage; poses come from verification, good to a decimetre.
    correspondence_distances: tuple[float, ...] = (0.15, 0.07, 0.03)
    #: None is less than this many times the pair's surface noise.
    least_noises: float = 5.0
    #: Surfels a station, all stages but the last.
    coarse_samples: int = 4_000
    #: Surfels a station, last stage.
    fine_samples: int = 40_000
    #: A stage at the most.
    iterations: int = 12

    def __post_init__(self) -> None:
        distances = self.correspondence_distances
        if not distances or any(distance <= 0 for distance in distances):
            raise OptionError("correspondence_distances must be positive")
        if list(distances) != sorted(distances, reverse=True):
            raise OptionError(f"correspondence_distances must shrink: {distances}")
        if self.least_noises < 0 or min(self.coarse_samples, self.fine_samples, self.iterations) < 1:
            raise OptionError("least_noises must not be negative; samples and iterations must be at least 1")


def pair_noise(a: Prepared, b: Prepared) -> float:
    """Standard deviation (m) to expect between two surfaces of a pair."""
    return float(np.hypot(a.noise.surface_noise, b.noise.surface_noise))


def refine(
    a: Prepared, b: Prepared, start: Float64, options: RefinementOptions | None = None
) -> PoseEstimate:
    """Refine a pose ``b_from_a`` between scanner-centred frames to the limit of the data."""
    options = options or RefinementOptions()
    least = options.least_noises * pair_noise(a, b)
    distances = [distance for distance in options.correspondence_distances if distance > least]
    distances = [*distances, max(least, options.correspondence_distances[-1])]
    coarse, fine, iterations = options.coarse_samples, options.fine_samples, options.iterations
    stages = [Stage(distance, coarse, iterations, by_variance=False) for distance in distances[:-1]]
    stages += [Stage(distances[-1], samples, iterations, by_variance=True) for samples in (coarse, fine)]
    return _estimate(a, b, start, stages)


def linearised(
    a: Prepared, b: Prepared, pose: Float64, options: RefinementOptions | None = None
) -> PoseEstimate:
    """One step of the last stage from a pose: where the surfaces, as they are compared there, want it.

    With its covariance it is the surfaces' say in an adjustment of all scans at once.
    """
    options = options or RefinementOptions()
    distance = max(options.least_noises * pair_noise(a, b), options.correspondence_distances[-1])
    return _estimate(a, b, pose, [Stage(distance, options.fine_samples, 1, by_variance=True)])


def point_to_plane_residuals(
    a: Prepared, b: Prepared, pose: Float64, correspondence_distance: float, samples: int = 40_000
) -> Residuals | None:
    """Distances of surfels from the planes of the other scan under a pose that is left as it is."""
    stage = Stage(correspondence_distance, samples, 0, by_variance=False)
    return _estimate(a, b, pose, [stage]).residuals


def _estimate(a: Prepared, b: Prepared, start: Float64, stages: Sequence[Stage]) -> PoseEstimate:
    fit = _core.refine_one(a.surfel_map, b.surfel_map, start, stages)
    bias = float(np.hypot(a.noise.plane_bias, b.noise.plane_bias))
    covariance = pose_covariance(
        fit.information, fit.scatter, fit.places, fit.chi_square, bias**2 * fit.planes
    )
    return PoseEstimate(fit.pose, covariance, Residuals.of(fit.offsets), fit.chi_square, len(fit.offsets))


def pose_covariance(
    information: Float64, scatter: Float64, places: int, chi_square: float, biased: Float64
) -> Float64:
    """Covariance (6, 6) of a least-squares pose from how its gradients scatter from place to place.

    The inverse of the normal matrix holds for offsets that scatter independently by their variances. Real ones do not:
    a warped wall or a badly seen patch errs as a whole. So what the places' gradients scatter, between the inverse on
    either side (Huber 1967; clusters after Liang and Zeger 1986), is added to it: the scatter of few places may by
    chance be small.

    Parameters
    ----------
    information
        (6, 6) normal matrix, either way of comparing counted half.
    scatter
        (6, 6) sum over places of the outer product of their gradients, both ways.
    places
        How many; where they are hardly more than the six unknowns, the normal matrix's inverse is scaled by
        `chi_square` instead.
    chi_square
        Mean square of the offsets over their variances.
    biased
        (6, 6) scatter of the gradients, both ways, of planes that are off as a whole, which a pose follows and hides.

    Returns
    -------
    (6, 6) array
        A direction without information gets a sigma of 1 km or 1 rad by way of a prior.
    """
    prior = np.diag([1.0] * 3 + [1e-6] * 3)
    inverse = np.asarray(np.linalg.inv(information + prior), dtype=np.float64)
    spread = biased / 4.0
    if places < 2 * len(prior):
        return inverse * max(1.0, chi_square) + inverse @ spread @ inverse
    spread = spread + scatter / 4.0 * (places / (places - len(prior)))
    return inverse + inverse @ spread @ inverse


def refine_coarsely(
    a: Prepared, b: Prepared, starts: Sequence[Float64], distances: Sequence[float], samples: int
) -> list[Float64]:
    """Refine many poses with few surfels: enough to tell which of them are one and which are right."""
    if not starts:
        return []
    stages = [Stage(distance, samples, 6, by_variance=False) for distance in distances]
    return _core.refine_many(a.surfel_map, b.surfel_map, np.array(starts), stages)
