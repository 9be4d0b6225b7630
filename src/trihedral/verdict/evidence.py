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
from trihedral.model.link import LinkEvidence, PoseEstimate
from trihedral.scan.prepared import Prepared
from trihedral.verdict.agreement import STATIC_SCALE, Agreement, compare
from trihedral.verdict.appearance import AppearanceOptions, Similarity, appearance_similarity, enclosed
from trihedral.verdict.blocks import BlockCounts, count_blocks
from trihedral.verdict.differences import Differences, differences

# Weights of what speaks for a pose, and what each is called where it speaks most against one.
# `python -m benchmarks.belief` fits them and writes what they rest on.
WEIGHTS = {
    "its surfaces hardly hold it": 1.44,
    "rooms have copies, and nothing is known of its appearance": -2.85,
    "surfaces that agree in shape do not look the same": 6.52,
    "parts of the building stand where the other scan saw empty space": -2.86,
    "furniture or vehicles stand where the other scan saw empty space": -0.788,
    "things stand where the other scan saw empty space": -0.662,
    "things that agree are not quite the same": -4.98,
}
CONSTANT = -1.16
# Medians of right poses: what the evidence is when nothing speaks against one.
BEYOND_DOUBT = (0.758, 0.0, 0.0945, 0.0, -5.57, -4.27, 0.0562)

# Places of the appearance, of patches and of things among them.
_LOOK, _PATCHES, _LOOSE = 2, 4, 5
# A share of conflict beyond so many times what makes a pose e times less believable says no more.
_CAP = 3.0
# Appearance similarity that speaks neither for a pose nor against it, put in where nothing is known; below the
# least one it tells no more, since the law of intensity may be another.
_NEUTRAL, _LEAST_TOLD, _MOST_TOLD = 0.65, 0.45, 1.0
# Blocks in conflict, and blocks that were compared, that are taken for granted: nothing compared is no agreement.
_CONFLICTING_PRIOR, _COMPARED_PRIOR = 0.5, 1.0
# Metres between which a sigma tells how well a pose is held.
_SIGMAS = (1e-4, 1.0)


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


def gather(a: Prepared, b: Prepared, estimate: PoseEstimate, options: EvidenceOptions) -> LinkEvidence:
    """Compare both stations under a pose between scanner-centred frames, in shape and in appearance."""
    pose, offset, margin, samples = estimate.transform, options.offset, options.margin, options.samples
    return evidence_of(
        compare(a, b, [pose], offset=offset, margin=margin, samples=samples),
        count_blocks(a, b, pose, offset=offset, margin=margin, samples=samples),
        (a.surfel_map.area, b.surfel_map.area),
        appearance_similarity(a, b, pose),
        options.appearance,
        different=differences(a, b, pose),
        redundancy=_redundancy(a, b, estimate),
        enclosed=enclosed(a, b),
    )


def _redundancy(a: Prepared, b: Prepared, estimate: PoseEstimate) -> float | None:
    weakest = estimate.weakest_direction
    if weakest is None:
        return None
    return max(a.noise.surface_noise, b.noise.surface_noise) / float(np.clip(weakest.sigma_m, *_SIGMAS))


def evidence_of(
    agreement: Agreement,
    blocks: BlockCounts,
    areas: tuple[float, float],
    similarity: Similarity | None,
    options: AppearanceOptions | None = None,
    *,
    different: Differences | None = None,
    redundancy: float | None = None,
    enclosed: bool = False,
) -> LinkEvidence:
    """Sum up the first pose of an agreement.

    Parameters
    ----------
    areas
        Surface of both stations (m^2).
    similarity
        Appearance similarity of surfaces that agree; None where nothing is known.
    different
        Where they look different; None where nothing is known.
    redundancy
        Noise of the surfaces over the pose's weakest sigma.
    enclosed
        Whether both scans may have a ceiling above them.
    """
    holding = float(agreement.holding[0].mean())

    def counted(kind: int) -> tuple[float, float]:
        return float(blocks.agreeing[kind]), float(blocks.conflicting[kind])

    return LinkEvidence(
        score=float(agreement.score()[0]),
        held_area_m2=float(np.min(np.array(areas) * agreement.holding[0])),
        holding=holding,
        solid_conflict=float(agreement.static_conflict[0]),
        loose_blocks=counted(0),
        patch_blocks=counted(1),
        misfit=blocks.misfit,
        redundancy=redundancy,
        free_space_conflict=float(agreement.conflict[0]),
        overlap_from=agreement.overlap[0],
        overlap_to=agreement.overlap[1],
        appearance_similarity=None if similarity is None else similarity.value,
        least_similarity=(options or AppearanceOptions()).least(holding),
        by_intensity=similarity is not None and similarity.of == "intensity",
        enclosed=enclosed,
        cells_compared=0 if different is None else different.compared,
        cells_different=0 if different is None else len(different.places),
    )


def features(evidence: LinkEvidence) -> Float64:
    """What `WEIGHTS` weigh, in their order."""
    similarity, redundancy = evidence.appearance_similarity, evidence.redundancy
    told = _NEUTRAL if similarity is None else float(np.clip(similarity, _LEAST_TOLD, _MOST_TOLD))
    return np.array(
        [
            BEYOND_DOUBT[0] if redundancy is None else np.log10(redundancy),
            float(evidence.unseen),
            told - _NEUTRAL,
            min(evidence.solid_conflict / STATIC_SCALE, _CAP),
            _conflict(evidence.patch_blocks),
            _conflict(evidence.loose_blocks),
            evidence.misfit,
        ]
    )


def _conflict(blocks: tuple[float, float]) -> float:
    """Logarithm of the share in conflict: the more blocks agree and none contradicts, the less of it there may be."""
    agreeing, conflicting = blocks
    return float(np.log((conflicting + _CONFLICTING_PRIOR) / (agreeing + conflicting + _COMPARED_PRIOR)))


def probabilities(poses: Sequence[LinkEvidence]) -> Float64:
    """Probability of each of the poses of a pair; what is missing to 1 is that of none."""
    weights = np.array(list(WEIGHTS.values()))
    odds = np.exp([CONSTANT + float(weights @ features(evidence)) for evidence in poses])
    probability: Float64 = odds / (1.0 + odds.sum())
    return probability


def worst(evidence: LinkEvidence) -> str:
    """What speaks most against a pose."""
    found, reference = features(evidence), np.array(BEYOND_DOUBT)
    if evidence.appearance_similarity is None:
        reference[_LOOK] = 0.0
    weights = np.array(list(WEIGHTS.values()))
    which = int(np.argmax(weights * (reference - found)))
    blocks = {_PATCHES: evidence.patch_blocks, _LOOSE: evidence.loose_blocks}.get(which)
    if blocks is not None and blocks[1] < _CONFLICTING_PRIOR:
        return "little is seen by both that could speak against it"
    return list(WEIGHTS)[which]
