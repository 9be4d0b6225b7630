"""The default method for a pair, cut short: whether a pair is worth registering, in a fraction of its time."""

import time
from dataclasses import dataclass, replace

from trihedral.errors import OptionError
from trihedral.initial.plan.proposals import PlanOptions, plan_poses
from trihedral.model.pairs import PairPreview
from trihedral.pair.either_way import turned_over
from trihedral.scan.prepared import Prepared
from trihedral.verdict.appearance import appearance_similarity
from trihedral.verdict.verification import Round, VerificationOptions, rank

_COARSE_PLAN = PlanOptions(
    turns=4,
    shifts=24,
    places=60,
    heights=2,
    cell=0.4,
    least_side=128,
    most_side=256,
    samples=4000,
    farthest=50.0,
)
_FEW_ROUNDS = VerificationOptions(
    hypotheses=60,
    rounds=(
        Round(8, 0.5, 0.5, 300, (5,), (3,), (0.5,), 300),
        Round(3, 0.3, 0.3, 600, (3,), (2,), (0.25, 0.12), 600),
    ),
)


@dataclass(frozen=True)
class PreviewOptions:
    """Few headings on a coarse plan, few poses refined."""

    #: Best poses whose appearance is compared, until one looks the same in both scans.
    compared: int = 3
    #: Score of a pose, below which it is not compared.
    least_score: float = 0.04
    #: Surfels whose appearance is compared.
    samples: int = 4000
    #: Appearance similarity from which surfaces may be the same.
    least_similarity: float = 0.5
    #: Few headings on a coarse plan.
    plan: PlanOptions = _COARSE_PLAN
    #: Few rounds with few surfels.
    verification: VerificationOptions = _FEW_ROUNDS

    def __post_init__(self) -> None:
        if min(self.compared, self.samples) < 1:
            raise OptionError("compared and samples must be at least 1")


def preview_pair(a: Prepared, b: Prepared, options: PreviewOptions) -> PairPreview:
    """Say whether a pair is worth registering, with one of its scans turned over if that may be so."""
    found, over = _as_mounted(a, b, options), turned_over(a, b)
    if over is None or _promising(found, options):
        return found
    other = _as_mounted(*over, options)
    best = other if _promising(other, options) else found
    return replace(best, seconds=found.seconds + other.seconds)


def _promising(found: PairPreview, options: PreviewOptions) -> bool:
    alike = found.appearance_similarity is None or found.appearance_similarity >= options.least_similarity
    return found.score >= options.least_score and alike


def _as_mounted(a: Prepared, b: Prepared, options: PreviewOptions) -> PairPreview:
    began = time.perf_counter()
    seen = len(a.surfel_map) and len(b.surfel_map)
    proposed = [pose for pose, _ in plan_poses(a, b, options.plan)] if seen else []
    ranked = rank(a, b, proposed, options.verification)
    score, similarity = ranked[0].score if ranked else 0.0, None
    for one in ranked[: options.compared]:
        if one.score < options.least_score:
            break
        # Only colour passes a pair over: the law of intensity may be another in each scan.
        looked = appearance_similarity(a, b, one.pose, options.samples)
        similarity = looked.value if looked is not None and looked.of == "color" else None
        score = one.score
        if similarity is None or similarity >= options.least_similarity:
            break
    seconds = time.perf_counter() - began
    return PairPreview(score, similarity, seconds)
