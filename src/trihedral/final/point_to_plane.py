"""The default final alignment: point to plane, both ways, over stages of shrinking reach."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class RefinementOptions:
    """Stages of a refinement; `noise` below is the pair's surface noise."""

    reaches: tuple[float, ...] = (0.15, 0.07, 0.03)  # metres; poses come from selection, good to a decimetre
    noise_reach: float = 5.0  # no stage reaches less than this many times the noise
    coarse_samples: int = 4_000  # elements a station, all stages but the last
    fine_samples: int = 40_000  # elements a station, last stage
    iterations: int = 12  # a stage at the most

    def __post_init__(self) -> None:
        if not self.reaches or any(reach <= 0 for reach in self.reaches):
            raise OptionError("reaches must be positive")
        if list(self.reaches) != sorted(self.reaches, reverse=True):
            raise OptionError(f"reaches must shrink: {self.reaches}")


@dataclass(frozen=True)
class Refinement:
    """A refined pose, ``b_from_a`` in scanner-centred coordinates.

    Attributes
    ----------
    covariance
        (6, 6) of ``(omega, v)`` on the left: `pose_covariance`.
    chi_square
        Mean square of the offsets over that noise; above 1 where surfaces differ by more.
    offsets
        (M,) signed distances (m) along the normals of the elements compared.
    """

    pose: Float64
    covariance: Float64
    chi_square: float
    offsets: NDArray[np.float32]
    converged: bool


def pair_noise(a: Prepared, b: Prepared) -> float:
    """Standard deviation (m) to expect between two surfaces of a pair."""
    return float(np.hypot(a.surface_noise, b.surface_noise))


def refine(a: Prepared, b: Prepared, start: Float64, options: RefinementOptions | None = None) -> Refinement:
    """Refine a pose to the limit of the data."""
    options = options or RefinementOptions()
    least = options.noise_reach * pair_noise(a, b)
    reaches = [reach for reach in options.reaches if reach > least]
    reaches = [*reaches, max(least, options.reaches[-1])]
    stages = [(reach, options.coarse_samples, options.iterations, False) for reach in reaches[:-1]]
    stages += [(reaches[-1], options.coarse_samples, options.iterations, True)]
    stages += [(reaches[-1], options.fine_samples, options.iterations, True)]
    pose, information, scatter, places, chi_square, offsets, converged = _core.refine_one(
        a.station, b.station, start, stages
    )
    covariance = pose_covariance(information, scatter, places, chi_square)
    return Refinement(np.array(pose), covariance, chi_square, offsets, converged)


def linearised(
    a: Prepared, b: Prepared, pose: Float64, options: RefinementOptions | None = None
) -> tuple[Float64, Float64]:
    """One step of the last stage from a pose: where the surfaces, as they are compared there, want it.

    Returns
    -------
    pose, covariance
        As those of `Refinement`; together the surfaces' say in an adjustment of all scans at once.
    """
    options = options or RefinementOptions()
    reach = max(options.noise_reach * pair_noise(a, b), options.reaches[-1])
    stages = [(reach, options.fine_samples, 1, True)]
    stepped, information, scatter, places, chi_square, _, _ = _core.refine_one(
        a.station, b.station, pose, stages
    )
    return np.array(stepped), pose_covariance(information, scatter, places, chi_square)


def pose_covariance(information: Float64, scatter: Float64, places: int, chi_square: float) -> Float64:
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

    Returns
    -------
    (6, 6) array
        A direction without information gets a sigma of 1 km or 1 rad by way of a prior.
    """
    prior = np.diag([1.0] * 3 + [1e-6] * 3)
    inverse = np.asarray(np.linalg.inv(information + prior), dtype=np.float64)
    if places < 2 * len(prior):
        return inverse * max(1.0, chi_square)
    spread = scatter / 4.0 * (places / (places - len(prior)))
    covariance: Float64 = inverse + inverse @ spread @ inverse
    return covariance


def refine_coarsely(
    a: Prepared, b: Prepared, starts: Sequence[Float64], reaches: Sequence[float], samples: int
) -> list[Float64]:
    """Refine many poses with few elements: enough to tell which of them are one and which are right."""
    if not starts:
        return []
    stages = [(reach, samples, 6, False) for reach in reaches]
    return [np.array(pose) for pose in _core.refine_many(a.station, b.station, np.array(starts), stages)]
