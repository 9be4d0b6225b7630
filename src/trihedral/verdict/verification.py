"""The right pose among many: compared, refined and compared again in rounds of shrinking tolerance."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from trihedral.errors import OptionError
from trihedral.final.point_to_plane import refine_coarsely
from trihedral.geometry.arrays import Float64
from trihedral.geometry.distinct import distinct
from trihedral.model.link import PoseEstimate
from trihedral.scan.prepared import Prepared
from trihedral.verdict.agreement import compare
from trihedral.verdict.appearance import AppearanceOptions, appearance_similarity, enclosed
from trihedral.verdict.evidence import EvidenceOptions, gather, probabilities


@dataclass(frozen=True)
class Round:
    """One round: poses are compared, the best are kept and refined; lengths in metres."""

    #: Distinct poses kept by each score.
    keep: int
    #: Within which two surfaces are one: poses may be off by so much.
    offset: float
    #: Before a surface, from which space counts as seen through.
    margin: float
    #: Surfels of each station that are compared.
    compared: int
    #: Towards shares of conflict, which a pose that is off has some of. These scores fill up with poses under which
    #: much surface is shared and much contradicts ...
    leniencies: tuple[float, ...]
    #: ... and those that set so much agreeing against conflicting surface keep poses under which little is shared.
    prices: tuple[float, ...]
    #: Maximum correspondence distances of the refinement.
    correspondence_distances: tuple[float, ...]
    #: Surfels of each station that the refinement uses.
    refined: int

    def __post_init__(self) -> None:
        if min(self.keep, self.compared, self.refined) < 1 or not self.correspondence_distances:
            raise OptionError("a round keeps, compares and refines at least 1, over at least one distance")
        if min(self.offset, self.margin, *self.correspondence_distances, *self.leniencies) <= 0:
            raise OptionError("lengths and leniencies of a round must be positive")


@dataclass(frozen=True)
class VerificationOptions:
    """How the right pose is told from the other hypotheses; lengths in metres."""

    #: Hypotheses that are compared.
    hypotheses: int = 600
    rounds: tuple[Round, ...] = (
        Round(30, 0.5, 0.5, 400, (10,), (1, 3), (0.6,), 400),
        Round(12, 0.4, 0.4, 500, (5,), (1, 3), (0.4,), 600),
        Round(6, 0.3, 0.3, 800, (3, 1), (2,), (0.25,), 800),
        Round(4, 0.15, 0.2, 1500, (1,), (), (0.15, 0.07), 2000),
    )
    #: Surfels of each station by which the last poses are ranked.
    ranked_by: int = 4000
    #: Two poses nearer than this, and than the angle (rad), are one.
    distinct_translation: float = 0.3
    distinct_rotation: float = np.radians(3.0)
    #: Other poses that are weighed against the best one, and the share of its score that makes one worth it.
    rivals: int = 2
    rival_score: float = 0.05
    #: The tolerance that refined poses are compared at.
    evidence: EvidenceOptions = field(default_factory=EvidenceOptions)

    def __post_init__(self) -> None:
        if min(self.hypotheses, self.ranked_by) < 1 or self.rivals < 0:
            raise OptionError("hypotheses and ranked_by must be at least 1, and rivals not negative")
        if min(self.distinct_translation, self.distinct_rotation) <= 0 or not 0 <= self.rival_score <= 1:
            raise OptionError("distinct poses lie apart, and rival_score between 0 and 1")


@dataclass(frozen=True)
class RankedPose:
    """A pose ``b_from_a`` (scanner-centred) and how far both scanners bear it out."""

    pose: Float64
    score: float


def verify(
    a: Prepared, b: Prepared, proposals: Sequence[Float64], options: VerificationOptions
) -> list[RankedPose]:
    """Distinct poses that what both scanners saw bears out, in shape and in appearance, best first."""
    return _without_strangers(a, b, rank(a, b, proposals, options), options)


def rank(
    a: Prepared, b: Prepared, proposals: Sequence[Float64], options: VerificationOptions
) -> list[RankedPose]:
    """Distinct poses that both scanners bear out in shape, best first: screened, refined, compared again."""
    poses = list(proposals[: options.hypotheses])
    for step in options.rounds:
        if not poses:
            return []
        seen = compare(a, b, poses, offset=step.offset, margin=step.margin, samples=step.compared)
        ranked = [seen.score(leniency) for leniency in step.leniencies]
        ranked += [seen.balance(price) for price in step.prices]
        kept = [_distinct(poses, score, options, step.keep) for score in ranked]
        poses = list({id(pose): pose for some in kept for pose in some}.values())
        # Few surfels of a small overlap can lead astray: a pose that was nearer before stays in the race.
        poses += refine_coarsely(a, b, poses, step.correspondence_distances, step.refined)
    fine = options.evidence
    closely = compare(a, b, poses, offset=fine.offset, margin=fine.margin, samples=options.ranked_by)
    score = closely.score()
    score_of = {id(pose): float(value) for pose, value in zip(poses, score, strict=True)}
    ranked_poses = _distinct(poses, score, options, len(poses))
    return [RankedPose(pose, score_of[id(pose)]) for pose in ranked_poses if score_of[id(pose)] > 0]


def _without_strangers(
    a: Prepared, b: Prepared, ranked: list[RankedPose], options: VerificationOptions
) -> list[RankedPose]:
    """Leave out poses under which surfaces agree in shape and do not look the same.

    Only those on which the choice depends are compared: the best one that is left, and its rivals. A score is at most
    the share of surface that holds the pose: this asks no more than the verdict will. The poses stay as they came if
    none is left, or only such as are less likely than the best one was: that is what to show.
    """
    left: list[RankedPose] = []
    for one in ranked:
        matters = not left or one.score > options.rival_score * left[0].score
        if not matters or not _strange(a, b, one, options.evidence.appearance):
            left.append(one)

    def chance(one: RankedPose) -> float:
        return float(probabilities([gather(a, b, PoseEstimate(one.pose), options.evidence)])[0])

    if not left or (left[0] is not ranked[0] and chance(left[0]) < chance(ranked[0])):
        return ranked
    return left


def _strange(a: Prepared, b: Prepared, one: RankedPose, options: AppearanceOptions) -> bool:
    """Whether surfaces under a ceiling agree in shape and do not look the same."""
    similarity = appearance_similarity(a, b, one.pose) if enclosed(a, b) else None
    return similarity is not None and similarity.value < options.least(one.score)


def _distinct(
    poses: Sequence[Float64], scores: Float64, options: VerificationOptions, count: int
) -> list[Float64]:
    """The best poses, at most `count`, best first; of poses near each other the best one."""
    kept = distinct(
        np.array(poses),
        np.argsort(-scores, kind="stable"),
        translation=options.distinct_translation,
        rotation=options.distinct_rotation,
        count=count,
    )
    return [poses[index] for index in kept]
