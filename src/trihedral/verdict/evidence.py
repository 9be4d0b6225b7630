"""What speaks for a pose and against it, and how likely it makes the pose.

At most one of the poses that a pair offers is right, and perhaps none is. The odds of each against none are the
exponential of a weighted sum of what speaks for and against it, so its probability is the multinomial logistic one (the
conditional logit of McFadden, 1974, with "none" among the choices). docs/method/verdict.md says on what places the
weights were fitted, and shows on others how often what was stated came true.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float64
from trihedral.model.link import LinkEvidence
from trihedral.scan.prepared import Prepared
from trihedral.verdict.agreement import SMALL_SCALE, STATIC_SCALE, Agreement, compare
from trihedral.verdict.appearance import AppearanceOptions, appearance_similarity, enclosed

# Weights of what speaks for a pose, and what each is called where it speaks most against one.
WEIGHTS = {
    "little shared surface": 1.1,
    "parts of the building stand where the other scan saw empty space": -3.3,
    "things stand where the other scan saw empty space": -3.0,
    "steps, railings or thinly seen surfaces stand where the other scan saw empty space": -4.3,
    "much of the surface that both scans saw does not agree": 3.0,
    "surfaces that agree in shape do not look the same": 8.3,
}
CONSTANT = -4.3
# A pose that nothing speaks against: 100 m2, no conflict, all but a twentieth agrees, looks the same.
BEYOND_DOUBT = (np.log(101.0), 0.0, 0.0, 0.0, 0.95, 0.25)

# Square metres of surface in conflict beside which little conflict means nothing.
_SLIVER = 2.0
# A share of conflict beyond so many times what makes a pose e times less believable says no more.
_CAP = 3.0
# Appearance similarity that speaks neither for a pose nor against it; put in where nothing is known.
_NEUTRAL = 0.65
_MOST_SIMILARITY = 1.0


@dataclass(frozen=True)
class EvidenceOptions:
    """The tolerance that overlap is stated with; lengths in metres."""

    #: Along the normal, within which two surfaces are one.
    offset: float = 0.05
    #: Before a surface, from which space counts as seen through.
    margin: float = 0.1
    #: Surfels of each station that are compared.
    samples: int = 20_000
    #: How alike surfaces that agree in shape must look.
    appearance: AppearanceOptions = field(default_factory=AppearanceOptions)

    def __post_init__(self) -> None:
        if min(self.offset, self.margin) <= 0 or self.samples < 1:
            raise OptionError("offset and margin must be positive, and samples at least 1")


def gather(a: Prepared, b: Prepared, pose: Float64, options: EvidenceOptions) -> LinkEvidence:
    """Compare both stations under a refined pose ``b_from_a`` (scanner-centred), in shape and in appearance."""
    agreement = compare(a, b, [pose], offset=options.offset, margin=options.margin, samples=options.samples)
    similarity = appearance_similarity(a, b, pose)
    return evidence_of(
        agreement,
        (a.surfel_map.area, b.surfel_map.area),
        similarity if np.isfinite(similarity) else None,
        options.appearance,
        enclosed=enclosed(a, b),
    )


def evidence_of(
    agreement: Agreement,
    areas: tuple[float, float],
    similarity: float | None,
    options: AppearanceOptions | None = None,
    *,
    enclosed: bool = False,
) -> LinkEvidence:
    """Sum up the first pose of an agreement.

    Parameters
    ----------
    areas
        Surface of both stations (m^2).
    similarity
        Appearance similarity of surfaces that agree; None where nothing is known.
    enclosed
        Whether both scans have a ceiling above them.
    """
    holding = float(agreement.holding[0].mean())
    loose, loose_area = _loose_conflict(agreement, areas)
    return LinkEvidence(
        score=float(agreement.score()[0]),
        held_area_m2=float(np.min(np.array(areas) * agreement.holding[0])),
        holding=holding,
        purity=float(agreement.purity[0]),
        solid_conflict=float(agreement.static_conflict[0]),
        small_conflict=float(agreement.small_conflict[0]),
        loose_conflict=loose,
        loose_conflict_m2=loose_area,
        loose_conflict_damped=_loose_conflict(agreement, areas, _SLIVER)[0],
        free_space_conflict=float(agreement.conflict[0]),
        overlap_from=agreement.overlap[0],
        overlap_to=agreement.overlap[1],
        appearance_similarity=similarity,
        least_similarity=(options or AppearanceOptions()).least(holding),
        enclosed=enclosed,
    )


def _loose_conflict(
    agreement: Agreement, areas: tuple[float, float], sliver: float = 1e-9
) -> tuple[float, float]:
    """Loose surface in conflict under the first pose: the larger share, over both ways, and the larger area (m^2).

    The share is that of what was compared and `sliver` (m^2) more.
    """
    agreeing = agreement.agreeing_of[0, :, 0] * areas
    conflicting = agreement.conflicting_of[0, :, 0] * areas
    shares = conflicting / (agreeing + conflicting + sliver)
    return float(shares.max()), float(conflicting.max())


def _features(evidence: LinkEvidence) -> Float64:
    """What `WEIGHTS` weigh, in their order."""
    similarity = evidence.appearance_similarity
    return np.array(
        [
            np.log1p(evidence.held_area_m2),
            min(evidence.solid_conflict / STATIC_SCALE, _CAP),
            min(evidence.small_conflict / SMALL_SCALE, _CAP),
            evidence.loose_conflict_damped,
            evidence.purity,
            float(np.clip(_NEUTRAL if similarity is None else similarity, 0.0, _MOST_SIMILARITY)) - _NEUTRAL,
        ]
    )


def probabilities(poses: Sequence[LinkEvidence]) -> Float64:
    """Probability of each of the poses of a pair; what is missing to 1 is that of none."""
    weights = np.array(list(WEIGHTS.values()))
    odds = np.exp([CONSTANT + float(weights @ _features(evidence)) for evidence in poses])
    probability: Float64 = odds / (1.0 + odds.sum())
    return probability


def worst(evidence: LinkEvidence) -> str:
    """What speaks most against a pose."""
    found, reference = _features(evidence), np.array(BEYOND_DOUBT)
    if evidence.appearance_similarity is None:
        reference[-1] = 0.0
    weights = np.array(list(WEIGHTS.values()))
    return list(WEIGHTS)[int(np.argmax(weights * (reference - found)))]
