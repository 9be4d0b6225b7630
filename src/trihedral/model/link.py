"""One pair of scans: the pose found between them and what may be believed of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


class LinkVerdict(StrEnum):
    """What may be believed of a link."""

    ACCEPTED = "accepted"
    AMBIGUOUS = "ambiguous"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


@dataclass(frozen=True)
class Residuals:
    """Point-to-plane distances over the shared surface, metres. Fit, not accuracy."""

    rmse_m: float
    median_m: float
    p95_m: float
    max_m: float
    p90_m: float | None = None

    @classmethod
    def of(cls, offsets: NDArray[np.floating[Any]]) -> Self | None:
        """Sum up distances (M,) in metres, of either sign; None where there are none."""
        if not len(offsets):
            return None
        distances = np.abs(offsets, dtype=np.float64)
        median, p90, p95 = (float(value) for value in np.percentile(distances, [50, 90, 95]))
        return cls(float(np.sqrt(np.mean(distances**2))), median, p95, float(distances.max()), p90)


@dataclass(frozen=True)
class WeakestDirection:
    """The translation that the link knows least: unit axis in the frame of `to`, and its sigma."""

    axis: tuple[float, float, float]
    sigma_m: float


@dataclass(frozen=True)
class Link:
    """The outcome of one pair; `transform` is None where no pose was found at all."""

    from_station: str
    to_station: str
    verdict: LinkVerdict
    reason: str | None  # why it is not accepted; None when it is
    method: str | None = None  # "icp", "plane-matching", "refinement"
    transform: Matrix | None = None  # to_from_from, 4x4
    initial_transform: Matrix | None = None  # before refinement
    covariance: Matrix | None = None  # 6x6 of (omega, v) on the left, about the scanner of `to`
    overlap_from: float | None = None  # share of `from`'s surface that `to` saw too
    overlap_to: float | None = None
    residuals: Residuals | None = None
    free_space_conflict: float | None = None  # share of the compared surface that lies in seen-through space
    weakest_direction: WeakestDirection | None = None
    runner_up: float | None = None  # score of the best other pose over that of this one
    alternatives: tuple[Matrix, ...] = ()  # other poses that explain the data nearly as well
    # Of each of them, as `covariance`, where it was refined; loops may choose among those.
    alternative_covariances: tuple[Matrix, ...] = ()
    alternative_residuals: tuple[Residuals | None, ...] = ()
    evidence: Mapping[str, Any] = field(
        default_factory=dict
    )  # figures, and what drawings of the link need, as JSON has it
    seconds: Mapping[str, float] = field(default_factory=dict)
    tried_because: str | None = None  # why the pair was chosen among all

    @property
    def accepted(self) -> bool:
        """Whether the network may use it."""
        return self.verdict is LinkVerdict.ACCEPTED
