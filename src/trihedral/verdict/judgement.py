"""Which poses of a pair may be believed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trihedral.errors import OptionError
from trihedral.model.link import LinkEvidence, LinkVerdict, PoseEstimate
from trihedral.verdict.evidence import probabilities, worst

_EMPTY = "where the other scan saw empty space"


@dataclass(frozen=True)
class JudgementOptions:
    """Limits of belief; docs/method/verdict.md says what they rest on."""

    #: Probability that the pose is right (`verdict.evidence`).
    probability: float = 0.97
    #: The same under a ceiling, where nothing is known of the appearance: rooms have copies.
    unseen_probability: float = 0.98
    #: The same of another pose, if it were the only one, from which it stands beside this one.
    rival: float = 0.99
    #: Probability below which another pose is none that explains the data nearly as well.
    least_probability: float = 0.02
    #: Square metres, evenly of all facings, below which a pose is no more than a guess.
    refused_held: float = 5.0
    #: Share of the building's surface in space seen to be empty.
    solid_conflict: float = 0.02
    #: The same, beyond which the pose is wrong, not doubtful.
    refused_conflict: float = 0.04
    #: Cells, and share of those compared, that may differ in colour between two scans of one room.
    different_cells: int = 3
    different_share: float = 0.005
    #: Metres and radians (1 sigma) beyond which a pose is open in a direction; a better one is only more or less
    #: precise.
    open_translation: float = 0.05
    open_rotation: float = np.radians(0.5)

    def __post_init__(self) -> None:
        if not 0 < self.solid_conflict <= self.refused_conflict <= 1:
            raise OptionError("solid_conflict must be positive and not above refused_conflict")
        if self.different_cells < 0 or not 0 <= self.different_share <= 1:
            raise OptionError("different_cells must not be negative, and different_share lie between 0 and 1")
        if min(self.refused_held, self.open_translation, self.open_rotation) <= 0:
            raise OptionError("limits of belief must be positive")
        if not (0 < self.probability <= self.unseen_probability < 1 and 0 < self.rival < 1):
            raise OptionError(
                "probability, unseen_probability and rival must lie between 0 and 1, the first not above the second"
            )


@dataclass(frozen=True)
class Judgement:
    """What is believed of a pair."""

    verdict: LinkVerdict
    reason: str | None
    #: The first pose, and what speaks for it, judged; None where there is no pose.
    estimate: PoseEstimate | None = None
    evidence: LinkEvidence | None = None
    #: The others that explain the data nearly as well.
    alternatives: tuple[PoseEstimate, ...] = ()


def likeliest(evidence: Sequence[LinkEvidence], options: JudgementOptions) -> int:
    """Which of the poses of a pair is most likely right; the first if all would be refused."""
    possible = [k for k, found in enumerate(evidence) if _refused(found, options) is None]
    if not possible:
        return 0
    return possible[int(np.argmax(probabilities([evidence[k] for k in possible])))]


def judge(
    estimates: Sequence[PoseEstimate],
    evidence: Sequence[LinkEvidence],
    options: JudgementOptions | None = None,
) -> Judgement:
    """Judge the first of the poses of a pair against the others and against none of them.

    A pose whose covariance is not known is not asked how well it is known.
    """
    options = options or JudgementOptions()
    if not estimates:
        return Judgement(LinkVerdict.REFUSED, "no pose was found")
    # A rival that would be refused whatever else there is stands beside nothing.
    possible = [0, *(k for k in range(1, len(evidence)) if _refused(evidence[k], options) is None)]
    estimates, evidence = [estimates[k] for k in possible], [evidence[k] for k in possible]
    probability, *others = probabilities(evidence).tolist()
    standing = max((float(probabilities([rival])[0]) for rival in evidence[1:]), default=0.0)
    against = _contradiction(evidence[0], options)
    found = replace(evidence[0], probability=probability, contradicted=against is not None)
    objections = (
        (LinkVerdict.REFUSED, _refused(found, options)),
        (LinkVerdict.AMBIGUOUS, _ambiguous(found, sum(others), standing, options)),
        (LinkVerdict.DOUBTFUL, against or _doubtful(found, options) or _open(estimates[0], options)),
    )
    verdict, reason = next((one for one in objections if one[1]), (LinkVerdict.ACCEPTED, None))
    alternatives = tuple(
        rival
        for rival, chance in zip(estimates[1:], others, strict=True)
        if chance > options.least_probability
    )
    return Judgement(verdict, reason, estimates[0], found, alternatives)


def _contradiction(evidence: LinkEvidence, options: JudgementOptions) -> str | None:
    """Say what stands where the other scan saw empty space, if it is too much to be of what moves."""
    if evidence.solid_conflict > options.solid_conflict:
        return f"{evidence.solid_conflict:.1%} of the building's surfaces stand {_EMPTY}"
    return None


def _refused(evidence: LinkEvidence, options: JudgementOptions) -> str | None:
    """Find what no loop could make good."""
    if evidence.solid_conflict > options.refused_conflict:
        return f"{evidence.solid_conflict:.0%} of the building's surfaces stand {_EMPTY}"
    if evidence.held_area_m2 < options.refused_held:
        return f"too little shared surface: {evidence.held_area_m2:.1f} m2 hold the pose"
    if evidence.strange and not evidence.by_intensity:
        return _strange(evidence)
    if different(evidence, options):
        found = f"{evidence.cells_different} of {evidence.cells_compared} small places differ in colour"
        return f"another room, or other light: {found}"
    return None


def different(evidence: LinkEvidence, options: JudgementOptions) -> bool:
    """Whether surfaces that agree in shape differ in more small places than two scans of one room do."""
    most = options.different_cells + options.different_share * evidence.cells_compared
    return evidence.cells_different > most


def _strange(evidence: LinkEvidence) -> str:
    of = "intensity" if evidence.by_intensity else "colour"
    similarity = evidence.appearance_similarity
    return f"surfaces that agree in shape do not look the same: similarity of {of} {similarity:.2f}"


def _ambiguous(
    evidence: LinkEvidence, rivals: float, standing: float, options: JudgementOptions
) -> str | None:
    """Find another pose that explains the scans nearly as well.

    `rivals`: probability that one of the others is right; `standing`: the likeliest of them, were it the only pose.
    """
    probability = evidence.probability or 0.0
    likelier_than_none = (
        probability < _least_probability(evidence, options) and rivals > 1.0 - probability - rivals
    )
    if standing >= options.rival or likelier_than_none:
        return f"another pose explains the scans too: {rivals:.0%} against {probability:.0%} that this one is right"
    return None


def _doubtful(evidence: LinkEvidence, options: JudgementOptions) -> str | None:
    """Find intensity that differs, or too little that speaks for the pose."""
    if evidence.strange:
        return _strange(evidence)
    probability = evidence.probability or 0.0
    if probability < _least_probability(evidence, options):
        held = f"{evidence.held_area_m2:.0f} m2 hold the pose"
        return f"{probability:.0%} that it is right: {worst(evidence)} ({held})"
    return None


def _open(estimate: PoseEstimate, options: JudgementOptions) -> str | None:
    """Find a direction in which the pose is hardly known at all."""
    weakest, rotation = estimate.weakest_direction, estimate.weakest_rotation
    if weakest is not None and weakest.sigma_m > options.open_translation:
        return f"it can slide: {1e3 * weakest.sigma_m:.0f} mm (1 sigma) in the weakest direction"
    if rotation is not None and rotation > options.open_rotation:
        return f"it can turn: {np.degrees(rotation):.2f} deg (1 sigma) about the weakest axis"
    return None


def _least_probability(evidence: LinkEvidence, options: JudgementOptions) -> float:
    return options.unseen_probability if evidence.unseen else options.probability
