"""Which poses of a pair may be believed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.verdict.agreement import Agreement
from trihedral.verdict.link import LinkVerdict

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class JudgementOptions:
    """Limits of belief; docs/method.md says which data set them."""

    least_area: float = 4.0  # square metres of agreeing surface of either station
    least_share: float = 0.05  # of either station's surface that agrees
    least_purity: float = 0.5  # agreeing over all surface that was seen by both
    solid_conflict: float = 0.02  # share of large planar surface in space seen to be empty
    refused_conflict: float = 0.06  # the same, beyond which the pose is wrong, not doubtful
    small_conflict: float = 0.25  # the same share of everything else: things that move, but also like rooms
    runner_up: float = 0.6  # score of another pose over that of this one
    weakest_sigma: float = 0.0015  # metres in the direction that the pair knows least
    weakest_rotation: float = np.radians(0.02)  # radians about the axis that the pair knows least
    chi_square: float = 50.0  # mean square of the offsets over the noise that the surfaces show
    thin_share: float = 0.15  # a pair that shares less than this of either scan must convince more:
    thin_chi_square: float = 12.0
    thin_runner_up: float = 0.2

    def __post_init__(self) -> None:
        if not 0 < self.solid_conflict <= self.refused_conflict <= 1:
            raise OptionError("solid_conflict must be positive and not above refused_conflict")
        if min(self.least_area, self.least_share, self.runner_up, self.weakest_sigma) <= 0:
            raise OptionError("limits of belief must be positive")


def judge(
    agreement: Agreement,
    area: float,
    runner_up: float,
    sigma: float,
    rotation_sigma: float,
    chi_square: float,
    options: JudgementOptions | None = None,
) -> tuple[LinkVerdict, str | None]:
    """Judge one pose.

    Parameters
    ----------
    agreement
        Of that pose alone.
    area
        Agreeing surface of the station that agrees less, square metres.
    runner_up
        Score of the best other pose over that of this one.
    sigma, rotation_sigma
        Standard deviations in the weakest direction (m) and about the weakest axis (rad).
    chi_square
        Mean square of the offsets over their variances.

    Returns
    -------
    verdict, reason
        The reason is None for an accepted pose.
    """
    options = options or JudgementOptions()
    share = float(agreement.agreeing.max())
    solid = float(agreement.solid_conflict[0])
    small = float(agreement.small_conflict[0])
    purity = float(agreement.purity[0])
    if area < options.least_area or share < options.least_share:
        return LinkVerdict.REFUSED, f"too little shared surface: {area:.1f} m2, {share:.0%} of a scan"
    if solid > options.refused_conflict:
        return (
            LinkVerdict.REFUSED,
            f"{solid:.0%} of the large surfaces stand where the other scan saw empty space",
        )
    if runner_up > options.runner_up:
        return LinkVerdict.AMBIGUOUS, f"another pose explains the scans {runner_up:.0%} as well"
    if solid > options.solid_conflict:
        return (
            LinkVerdict.DOUBTFUL,
            f"{solid:.1%} of the large surfaces stand where the other scan saw empty space",
        )
    if small > options.small_conflict:
        return (
            LinkVerdict.DOUBTFUL,
            f"{small:.0%} of the small things stand where the other scan saw empty space",
        )
    if purity < options.least_purity:
        return LinkVerdict.DOUBTFUL, f"only {purity:.0%} of the surface that both scans saw agrees"
    if sigma > options.weakest_sigma:
        return LinkVerdict.DOUBTFUL, f"it can slide: {1e3 * sigma:.1f} mm (1 sigma) in the weakest direction"
    if rotation_sigma > options.weakest_rotation:
        angle = np.degrees(rotation_sigma)
        return LinkVerdict.DOUBTFUL, f"it can turn: {angle:.3f} deg (1 sigma) about the weakest axis"
    thin = share < options.thin_share
    if thin and runner_up > options.thin_runner_up:
        return (
            LinkVerdict.DOUBTFUL,
            f"little overlap, and another pose explains the scans {runner_up:.0%} as well",
        )
    if not chi_square <= (options.thin_chi_square if thin else options.chi_square):
        return LinkVerdict.DOUBTFUL, f"surfaces differ by {chi_square**0.5:.1f} times their noise"
    return LinkVerdict.ACCEPTED, None
