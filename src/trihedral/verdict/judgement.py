"""Which poses of a pair may be believed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.model.link import LinkVerdict
from trihedral.verdict.agreement import Agreement
from trihedral.verdict.evidence import evidence, held_area, loose_conflict, worst

Float64 = NDArray[np.float64]

_EMPTY = "where the other scan saw empty space"


@dataclass(frozen=True)
class JudgementOptions:
    """Limits of belief; docs/method.md says which data set them."""

    probability: float = 0.8  # that the pose is right, by `verdict.evidence`
    # The same under a ceiling, where nothing is known of the looks: rooms have copies.
    unseen_probability: float = 0.88
    rival: float = (
        0.95  # the same of another pose, if it were the only one, from which it stands beside this one
    )
    refused_held: float = (
        5.0  # square metres, evenly of all facings, below which a pose is no more than a guess
    )
    solid_conflict: float = 0.02  # share of the building's surface in space seen to be empty
    refused_conflict: float = 0.04  # the same, beyond which the pose is wrong, not doubtful
    loose_conflict: float = (
        0.15  # the same share of surface that is of no planar patch: stairs, thinly seen things ...
    )
    loose_area: float = 4.0  # ... if it is more square metres than what moves about in a building
    # Under a ceiling, where places may have copies and less moves than on a street: share in conflict of all that is
    # not the building's, and where nothing is known of the looks, if so many square metres of it are loose.
    enclosed_conflict: float = 0.03
    unseen_conflict: float = 0.02
    enclosed_loose_area: float = 2.0
    refused_similarity: float = (
        0.45  # of the looks of surfaces that agree in shape, below which they are different ones
    )
    # Copies share some of their looks; but the more surface two scans share, the more alike it looks if it is one.
    partly_held: float = 0.2  # share of surface that holds a pose, up to which that likeness is enough
    similarity_a_share: float = 0.5  # asked besides for all of the surface beyond, in proportion
    weakest_sigma: float = 0.0015  # metres in the direction that the pair knows least
    weakest_rotation: float = np.radians(0.02)  # radians about the axis that the pair knows least
    chi_square: float = 60.0  # mean square of the offsets over the noise that the surfaces show

    def __post_init__(self) -> None:
        if not 0 < self.solid_conflict <= self.refused_conflict <= 1:
            raise OptionError("solid_conflict must be positive and not above refused_conflict")
        if min(self.refused_held, self.loose_area, self.enclosed_loose_area, self.weakest_sigma) <= 0:
            raise OptionError("limits of belief must be positive")
        if not (0 < self.probability <= self.unseen_probability < 1 and 0 < self.rival < 1):
            raise OptionError(
                "probability, unseen_probability and rival must lie between 0 and 1, the first not above the second"
            )

    def least_similarity(self, holding: float) -> float:
        """Likeness below which surfaces are different ones, where this share of them holds the pose."""
        return self.refused_similarity + self.similarity_a_share * max(0.0, holding - self.partly_held)


def contradiction(
    agreement: Agreement, areas: tuple[float, float], options: JudgementOptions | None = None
) -> str | None:
    """Say what surface of one scan stands where the other saw empty space, if it is too much to be of what moves.

    `agreement` is of one pose; `areas` is the surface of both stations (m^2).
    """
    options = options or JudgementOptions()
    solid = float(agreement.solid_conflict[0])
    if solid > options.solid_conflict:
        return f"{solid:.1%} of the building's surfaces stand {_EMPTY}"
    loose, loose_area = loose_conflict(agreement, areas)
    if loose > options.loose_conflict and loose_area > options.loose_area:
        return f"{loose_area:.0f} m2 of stairs or thinly seen things stand {_EMPTY}"
    return None


def judge(
    agreement: Agreement,
    areas: tuple[float, float],
    probability: float,
    rivals: float,
    standing: float,
    sigma: float,
    rotation_sigma: float,
    chi_square: float,
    similarity: float = np.nan,
    options: JudgementOptions | None = None,
    *,
    enclosed: bool = False,
) -> tuple[LinkVerdict, str | None]:
    """Judge one pose.

    Parameters
    ----------
    agreement
        Of that pose alone.
    areas
        Surface of both stations (m^2).
    probability, rivals
        That this pose is right, and that one of the others is (`verdict.evidence`).
    standing
        Probability of the likeliest of the others, if it were the only pose.
    sigma, rotation_sigma
        Standard deviations in the weakest direction (m) and about the weakest axis (rad).
    chi_square
        Mean square of the offsets over their variances.
    likeness
        Of the looks of the surfaces that agree (`previews.similarity`); NaN where nothing is known of it.
    enclosed
        Whether both scans have a ceiling above them (`previews.enclosed`).

    Returns
    -------
    verdict, reason
        The reason is None for an accepted pose.
    """
    options = options or JudgementOptions()
    solid = float(agreement.solid_conflict[0])
    held = held_area(agreement, areas)
    if solid > options.refused_conflict:
        return LinkVerdict.REFUSED, f"{solid:.0%} of the building's surfaces stand {_EMPTY}"
    if held < options.refused_held:
        return LinkVerdict.REFUSED, f"too little shared surface: {held:.1f} m2 hold the pose"
    if similarity < options.least_similarity(float(agreement.holding[0].mean())):
        return (
            LinkVerdict.REFUSED,
            f"surfaces that agree in shape do not look the same: likeness {similarity:.2f}",
        )
    unseen = enclosed and bool(np.isnan(similarity))
    least = options.unseen_probability if unseen else options.probability
    likelier_than_none = probability < least and rivals > 1.0 - probability - rivals
    if standing >= options.rival or likelier_than_none:
        return (
            LinkVerdict.AMBIGUOUS,
            f"another pose explains the scans too: {rivals:.0%} against {probability:.0%} that this one is right",
        )
    if against_it := contradiction(agreement, areas, options):
        return LinkVerdict.DOUBTFUL, against_it
    things, loose_area = float(agreement.small_conflict[0]), loose_conflict(agreement, areas)[1]
    most = options.unseen_conflict if unseen else options.enclosed_conflict
    if enclosed and things > most and loose_area > options.enclosed_loose_area:
        return LinkVerdict.DOUBTFUL, f"{things:.0%} of what is not of the building stands {_EMPTY}"
    if probability < least:
        decisive = probability < options.probability
        against = (
            worst(evidence(agreement, areas, similarity)) if decisive else "nothing is known of its looks"
        )
        return (
            LinkVerdict.DOUBTFUL,
            f"{probability:.0%} that it is right: {against} ({held:.0f} m2 hold the pose)",
        )
    if sigma > options.weakest_sigma:
        return LinkVerdict.DOUBTFUL, f"it can slide: {1e3 * sigma:.1f} mm (1 sigma) in the weakest direction"
    if rotation_sigma > options.weakest_rotation:
        angle = np.degrees(rotation_sigma)
        return LinkVerdict.DOUBTFUL, f"it can turn: {angle:.3f} deg (1 sigma) about the weakest axis"
    if not chi_square <= options.chi_square:
        return LinkVerdict.DOUBTFUL, f"surfaces differ by {chi_square**0.5:.1f} times their noise"
    return LinkVerdict.ACCEPTED, None
