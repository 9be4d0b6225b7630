"""Why pairs are not registered, when nothing more is asked for."""

import numpy as np

from trihedral.network.candidates.previews import previews_left
from trihedral.network.candidates.state import Pair, SearchState


def why_passed_over(state: SearchState, pair: Pair) -> str:
    """Why a pair that was previewed is not registered, when `promising` asks for nothing more."""
    preview, options = state.previews[pair], state.options
    if preview.score <= 0.0:
        return "no pose was found"
    reasons = []
    if preview.score < options.least_score:
        reasons.append(
            "too little surface agrees, or too much contradicts: "
            f"score {preview.score:.3f}, {options.least_score:g} is asked"
        )
    if state.looks_strange(preview):
        reasons.append(
            "its surfaces do not look the same: appearance similarity "
            f"{preview.appearance_similarity:.2f}, {options.least_similarity:g} is asked"
        )
    return "; ".join(reasons) or (
        f"when pairs were chosen, other links tied its scans to each other, and each had {options.links} "
        "accepted ones or more"
    )


def never_previewed(state: SearchState) -> dict[str, int]:
    """How many pairs are neither previewed nor registered, by why `more_previews` does not ask for them."""
    options = state.options
    unknown = np.triu(np.ones(state.similarity.shape, dtype=np.bool_), 1)
    for pair in (*state.previews, *state.links):
        unknown[pair] = False
    together = state.component[:, None] == state.component
    left = previews_left(state)
    asks = np.array([left.get(int(label), 0) > 0 for label in state.component])
    asked_for = asks[:, None] | asks
    alike = f"neither plan is among the {options.first_previews} most like the other"
    rules = {
        f"{alike}, and when pairs were chosen links tied both scans to one part": unknown & together,
        f"{alike}; after {options.patience} previews in vain between parts, only plans more alike than most are "
        "previewed": unknown & ~together & asked_for,
        f"{alike}; the previews in vain that a part is allowed ({options.most_previews}, and one for each further "
        "scan) are spent": unknown & ~together & ~asked_for,
    }
    return {rule: int(pairs.sum()) for rule, pairs in rules.items() if pairs.any()}
