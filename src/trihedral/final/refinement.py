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

    reaches: tuple[float, ...] = (0.6, 0.3, 0.15, 0.07, 0.03)  # metres
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
    information
        (6, 6) inverse of the covariance of ``(omega, v)`` on the left, for the noise that the elements show.
    chi_square
        Mean square of the offsets over that noise; above 1 where surfaces differ by more.
    offsets
        (M,) signed distances (m) along the normals of the elements compared.
    """

    pose: Float64
    information: Float64
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
    pose, information, chi_square, offsets, converged = _core.refine_one(a.station, b.station, start, stages)
    return Refinement(np.array(pose), information, chi_square, offsets, converged)


def refine_coarsely(
    a: Prepared, b: Prepared, starts: Sequence[Float64], reaches: Sequence[float], samples: int
) -> list[Float64]:
    """Refine many poses with few elements: enough to tell which of them are one and which are right."""
    if not starts:
        return []
    stages = [(reach, samples, 6, False) for reach in reaches]
    return [np.array(pose) for pose in _core.refine_many(a.station, b.station, np.array(starts), stages)]
