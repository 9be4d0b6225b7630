"""The default method for a pair."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from trihedral.final.point_to_plane import RefinementOptions, refine
from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import distance, motion
from trihedral.initial.hypotheses import HypothesisOptions, propose
from trihedral.model.link import PairResult, PoseEstimate
from trihedral.pair.either_way import either_way_up
from trihedral.pair.stopwatch import Stopwatch
from trihedral.scan.prepared import Prepared
from trihedral.verdict.evidence import gather
from trihedral.verdict.judgement import Judgement, JudgementOptions, judge, likeliest
from trihedral.verdict.verification import RankedPose, VerificationOptions, verify

# Metres and radians within which two refined poses are one.
SAME_TRANSLATION = 0.05
SAME_ROTATION = float(np.radians(0.5))


@dataclass(frozen=True)
class AutoOptions:
    """The default method for a pair, step by step."""

    #: Step 2: where poses come from.
    hypotheses: HypothesisOptions = field(default_factory=HypothesisOptions)
    #: Which of them both scanners bear out.
    verification: VerificationOptions = field(default_factory=VerificationOptions)
    #: Step 4: to the limit of the data.
    refinement: RefinementOptions = field(default_factory=RefinementOptions)
    #: What is believed.
    judgement: JudgementOptions = field(default_factory=JudgementOptions)


def register_pair(a: Prepared, b: Prepared, options: AutoOptions) -> PairResult:
    """Find the pose of `a` in the frame of `b` and judge it: the method for a pair.

    Both directions of a pair give one verdict, inverse poses and one covariance.
    """
    if _comes_after(a, b):
        return _in_order(b, a, options).inverted(b.scanner_origin, a.scanner_origin)
    return _in_order(a, b, options)


def _comes_after(a: Prepared, b: Prepared) -> bool:
    """Whether a pair is worked on the other way about: by what the scans hold, so that names do not matter."""
    sizes = len(a.surfels), len(b.surfels)
    if sizes[0] != sizes[1]:
        return sizes[0] > sizes[1]
    return a.surfels.points.tobytes() > b.surfels.points.tobytes()


def _in_order(a: Prepared, b: Prepared, options: AutoOptions) -> PairResult:
    def register(a: Prepared, b: Prepared) -> PairResult:
        return _as_mounted(a, b, options)

    return either_way_up(a, b, register, options.judgement.unseen_probability)


def _as_mounted(a: Prepared, b: Prepared, options: AutoOptions) -> PairResult:
    clock = Stopwatch()
    proposals = clock.lap("hypotheses", propose(a, b, options.hypotheses))
    ranked = clock.lap("selection", verify(a, b, proposals, options.verification))
    estimates = clock.lap("refinement", refine_with_rivals(a, b, ranked, options))
    looked = options.verification.evidence
    evidence = [gather(a, b, estimate, looked) for estimate in estimates]
    best = likeliest(evidence, options.judgement) if evidence else 0
    if best:
        # Rivals were refined with few surfels.
        finely = refine(a, b, estimates[best].transform, options.refinement)
        estimates = [finely, *estimates[:best], *estimates[best + 1 :]]
        evidence = [gather(a, b, finely, looked), *evidence[:best], *evidence[best + 1 :]]
    judgement = clock.lap("verdict", judge(estimates, evidence, options.judgement))
    compared = min(len(proposals), options.verification.hypotheses)
    return replace(_result(a, b, ranked, judgement), hypotheses=compared, seconds=clock.seconds)


def refine_with_rivals(
    a: Prepared, b: Prepared, ranked: Sequence[RankedPose], options: AutoOptions
) -> list[PoseEstimate]:
    """Refine the best pose, and the next best ones that are others once they are refined."""
    estimates: list[PoseEstimate] = []
    # Wrong ones take the longest to converge; one that loops choose is adjusted with all surfels.
    quickly = replace(options.refinement, fine_samples=options.refinement.coarse_samples)
    least = options.verification.rival_score * ranked[0].score if ranked else 0.0
    rivals = [one for one in ranked[1:] if one.score > least][: options.verification.rivals]
    for one in [*ranked[:1], *rivals]:
        refined = refine(a, b, one.pose, quickly if estimates else options.refinement)
        apart = [distance(refined.transform, other.transform) for other in estimates]
        if all(t > SAME_TRANSLATION or r > SAME_ROTATION for t, r in apart):
            estimates.append(refined)
    return estimates


def _result(a: Prepared, b: Prepared, ranked: Sequence[RankedPose], judgement: Judgement) -> PairResult:
    """Say what was judged between station coordinates."""

    def between_stations(pose: Float64) -> Float64:
        return motion(None, b.scanner_origin) @ pose @ motion(None, -a.scanner_origin)

    def stated(estimate: PoseEstimate) -> PoseEstimate:
        return replace(estimate, transform=between_stations(estimate.transform))

    if judgement.estimate is None or judgement.evidence is None:
        return PairResult(verdict=judgement.verdict, reason=judgement.reason)
    pose = judgement.estimate.transform
    start = min(ranked, key=lambda one: distance(one.pose, pose))
    return PairResult(
        verdict=judgement.verdict,
        reason=judgement.reason,
        method="refinement",
        estimate=stated(judgement.estimate),
        initial_transform=between_stations(start.pose),
        overlap_from=judgement.evidence.overlap_from,
        overlap_to=judgement.evidence.overlap_to,
        free_space_conflict=judgement.evidence.free_space_conflict,
        runner_up=ranked[1].score / ranked[0].score if len(ranked) > 1 else 0.0,
        alternatives=tuple(stated(rival) for rival in judgement.alternatives),
        evidence=judgement.evidence,
    )
