"""How likely the pose of a pair is right, by a model whose few weights were fitted on simulated places.

At most one of the poses that a pair offers is right, and perhaps none is. The odds of each against none are the
exponential of a weighted sum of what speaks for and against it, so its probability is the multinomial logistic one (the
conditional logit of McFadden, 1974, with "none" among the choices). docs/method.md says on what places the weights were
fitted, and shows on others how often what was stated came true.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trihedral.verdict.agreement import SMALL_SCALE, SOLID_SCALE, Agreement

Float64 = NDArray[np.float64]

# Weights of `evidence`, and what each is called where it speaks most against a pose.
WEIGHTS = {
    "little shared surface": 1.1,
    "parts of the building stand where the other scan saw empty space": -3.3,
    "things stand where the other scan saw empty space": -3.0,
    "steps, railings or thinly seen surfaces stand where the other scan saw empty space": -4.3,
    "much of the surface that both scans saw does not agree": 3.0,
    "surfaces that agree in shape do not look the same": 8.3,
}
CONSTANT = -4.3
# Evidence of a pose that nothing speaks against: 100 m2, no conflict, all but a twentieth agrees, looks the same.
BEYOND_DOUBT = (np.log(101.0), 0.0, 0.0, 0.0, 0.95, 0.25)

# Square metres of surface in conflict beside which little conflict means nothing.
_SLIVER = 2.0
# A share of conflict beyond so many times what makes a pose e times less believable says no more.
_CAP = 3.0
# Likeness that speaks neither for a pose nor against it; where nothing is known of the looks, this is put in.
_NEUTRAL = 0.65
_MOST_SIMILARITY = 1.0


def held_area(agreement: Agreement, areas: tuple[float, float]) -> float:
    """Surface that holds the first pose of `agreement` (m^2), of the station that has less; `areas` of both (m^2)."""
    return float(np.min(np.array(areas) * agreement.holding[0]))


def loose_conflict(
    agreement: Agreement, areas: tuple[float, float], sliver: float = 1e-9
) -> tuple[float, float]:
    """Loose surface in conflict under the first pose: the larger share, over both ways, and the larger area (m^2).

    The share is that of what was compared and `sliver` (m^2) more.
    """
    agreeing = agreement.agreeing_of[0, :, 0] * areas
    conflicting = agreement.conflicting_of[0, :, 0] * areas
    shares = conflicting / (agreeing + conflicting + sliver)
    return float(shares.max()), float(conflicting.max())


def evidence(agreement: Agreement, areas: tuple[float, float], similarity: float) -> Float64:
    """What speaks for the first pose of `agreement` and against it, in the order of `WEIGHTS`.

    Parameters
    ----------
    agreement
        At the tolerance that overlap is stated with.
    areas
        Surface of both stations (m^2).
    likeness
        Of the looks of surfaces that agree; NaN where nothing is known.
    """
    alike = similarity if np.isfinite(similarity) else _NEUTRAL
    return np.array(
        [
            np.log1p(held_area(agreement, areas)),
            min(float(agreement.solid_conflict[0]) / SOLID_SCALE, _CAP),
            min(float(agreement.small_conflict[0]) / SMALL_SCALE, _CAP),
            loose_conflict(agreement, areas, _SLIVER)[0],
            float(agreement.purity[0]),
            float(np.clip(alike, 0.0, _MOST_SIMILARITY)) - _NEUTRAL,
        ]
    )


def probabilities(poses: Sequence[Float64]) -> Float64:
    """Probability of each of the poses of a pair, told by its `evidence`; what is missing to 1 is that of none."""
    weights = np.array(list(WEIGHTS.values()))
    odds = np.exp([CONSTANT + float(weights @ found) for found in poses])
    probability: Float64 = odds / (1.0 + odds.sum())
    return probability


def worst(found: Float64) -> str:
    """What speaks most against a pose."""
    reference = np.array(BEYOND_DOUBT)
    if found[-1] == 0.0:  # nothing is known of the looks
        reference[-1] = 0.0
    weights = np.array(list(WEIGHTS.values()))
    return list(WEIGHTS)[int(np.argmax(weights * (reference - found)))]
