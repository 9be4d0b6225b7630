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

    least_held: float = 25.0  # square metres, evenly of all facings, that agree and so hold the pose
    least_holding: float = 0.2  # share of the scans that holds the pose; enough where rooms are small
    refused_held: float = 5.0  # square metres, below which a pose is no more than a guess
    least_purity: float = 0.6  # agreeing over all surface that was seen by both
    solid_conflict: float = 0.01  # share of the building's surface in space seen to be empty
    refused_conflict: float = 0.04  # the same, beyond which the pose is wrong, not doubtful
    small_conflict: float = 0.2  # the same share of everything else: things that move, but also like rooms
    runner_up: float = 0.5  # score of another pose over that of this one
    weakest_sigma: float = 0.0015  # metres in the direction that the pair knows least
    weakest_rotation: float = np.radians(0.02)  # radians about the axis that the pair knows least
    likeness: float = 0.65  # of the looks of surfaces that agree in shape: 1 for one surface seen twice
    refused_likeness: float = 0.45  # the same, below which they are different surfaces
    chi_square: float = 60.0  # mean square of the offsets over the noise that the surfaces show

    def __post_init__(self) -> None:
        if not 0 < self.solid_conflict <= self.refused_conflict <= 1:
            raise OptionError("solid_conflict must be positive and not above refused_conflict")
        if min(self.refused_held, self.least_holding, self.runner_up, self.weakest_sigma) <= 0:
            raise OptionError("limits of belief must be positive")
        if self.refused_held > self.least_held:
            raise OptionError("refused_held must not be above least_held")


def judge(
    agreement: Agreement,
    held: float,
    runner_up: float,
    sigma: float,
    rotation_sigma: float,
    chi_square: float,
    likeness: float = np.nan,
    options: JudgementOptions | None = None,
) -> tuple[LinkVerdict, str | None]:
    """Judge one pose.

    Parameters
    ----------
    agreement
        Of that pose alone.
    held
        Surface that holds the pose, of the station that has less of it, square metres.
    runner_up
        Score of the best other pose over that of this one.
    sigma, rotation_sigma
        Standard deviations in the weakest direction (m) and about the weakest axis (rad).
    chi_square
        Mean square of the offsets over their variances.
    likeness
        Of the looks of the surfaces that agree (`looks.likeness`); NaN where nothing is known of it.

    Returns
    -------
    verdict, reason
        The reason is None for an accepted pose.
    """
    options = options or JudgementOptions()
    solid = float(agreement.solid_conflict[0])
    small = float(agreement.small_conflict[0])
    purity = float(agreement.purity[0])
    holding = float(agreement.holding[0].mean())
    empty = "stand where the other scan saw empty space"
    if solid > options.refused_conflict:
        return LinkVerdict.REFUSED, f"{solid:.0%} of the building's surfaces {empty}"
    if held < options.refused_held:
        return LinkVerdict.REFUSED, f"too little shared surface: {held:.1f} m2 hold the pose"
    unlike = f"surfaces that agree in shape do not look the same: likeness {likeness:.2f}"
    if likeness < options.refused_likeness:
        return LinkVerdict.REFUSED, unlike
    if runner_up > options.runner_up:
        return LinkVerdict.AMBIGUOUS, f"another pose explains the scans {runner_up:.0%} as well"
    if likeness < options.likeness:
        return LinkVerdict.DOUBTFUL, unlike
    if solid > options.solid_conflict:
        return LinkVerdict.DOUBTFUL, f"{solid:.1%} of the building's surfaces {empty}"
    if small > options.small_conflict:
        return LinkVerdict.DOUBTFUL, f"{small:.0%} of the small things {empty}"
    if purity < options.least_purity:
        return LinkVerdict.DOUBTFUL, f"only {purity:.0%} of the surface that both scans saw agrees"
    if held < options.least_held and holding < options.least_holding:
        return (
            LinkVerdict.DOUBTFUL,
            f"little shared surface: {held:.0f} m2 hold the pose, {holding:.0%} of the scans",
        )
    if sigma > options.weakest_sigma:
        return LinkVerdict.DOUBTFUL, f"it can slide: {1e3 * sigma:.1f} mm (1 sigma) in the weakest direction"
    if rotation_sigma > options.weakest_rotation:
        angle = np.degrees(rotation_sigma)
        return LinkVerdict.DOUBTFUL, f"it can turn: {angle:.3f} deg (1 sigma) about the weakest axis"
    if not chi_square <= options.chi_square:
        return LinkVerdict.DOUBTFUL, f"surfaces differ by {chi_square**0.5:.1f} times their noise"
    return LinkVerdict.ACCEPTED, None
