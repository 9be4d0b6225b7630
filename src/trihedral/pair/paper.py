"""The source paper's method for a pair, one line a step.

Kim, P., Chen, J., Cho, Y. K. (2017), "Automated Point Clouds Registration using Visual and Planar Features for
Construction Environments". docs/paper.md says where it leaves something open and what was done there.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from trihedral.errors import OptionError
from trihedral.final.planes.match import PlaneMatch, match_planes
from trihedral.final.planes.options import PlaneMatchingOptions
from trihedral.final.planes.pose import PlanesRefused
from trihedral.final.planes.segmentation import Plane
from trihedral.final.point_to_plane import point_to_plane_residuals
from trihedral.final.point_to_point import IcpOptions, align
from trihedral.geometry.arrays import Float64, Floating
from trihedral.geometry.se3 import Matrix, motion
from trihedral.initial.visual.alignment import PicturePair, VisualAlignment, VisualOptions, visual_alignment
from trihedral.initial.visual.features import FeatureOptions
from trihedral.initial.visual.scan_features import PictureFeatures, picture_features
from trihedral.model.link import LinkVerdict, PairResult, PoseEstimate
from trihedral.model.paper_evidence import (
    Ends,
    IcpEvidence,
    InitialOverlap,
    PaperEvidence,
    PictureMatches,
    PlaneEvidence,
    PlanesEvidence,
    VisualEvidence,
)
from trihedral.overlap.nearest import OverlapOptions, overlap
from trihedral.pair.stopwatch import Stopwatch
from trihedral.scan.prepared import Prepared
from trihedral.verdict.evidence import BEYOND_DOUBT, EvidenceOptions, gather
from trihedral.verdict.judgement import JudgementOptions, judge

Final = Literal["icp", "planes", "auto"]
_MOST_DRAWN = 150  # matches of a picture pair that are kept for its figure


@dataclass(frozen=True)
class PaperOptions:
    """The paper's options, step by step."""

    #: Step 2: keypoints of pictures, and the motion that their matches agree on.
    features: FeatureOptions = field(default_factory=lambda: FeatureOptions(kind="surf"))
    visual: VisualOptions = field(default_factory=VisualOptions)
    #: Step 3, and its threshold.
    overlap: OverlapOptions = field(default_factory=OverlapOptions)
    #: Step 4; "auto": by the overlap.
    final: Final = "auto"
    icp: IcpOptions = field(default_factory=IcpOptions)
    #: Of the reference scan's median range: points farther apart do not pull in ICP. What an initial alignment is off
    #: by grows with the range; the paper's were off by 2 to 3 m on a site.
    icp_reach_share: float = 0.25
    planes: PlaneMatchingOptions = field(default_factory=PlaneMatchingOptions)
    #: The paper checks no result; ours is compared with what both scanners saw, at a tolerance that suits its accuracy:
    #: metres within which two surfaces are one, and before a surface, from which space counts as seen through.
    offset: float = 0.25
    margin: float = 0.3
    judgement: JudgementOptions = field(default_factory=lambda: JudgementOptions(probability=0.8))

    def __post_init__(self) -> None:
        if self.final not in ("icp", "planes", "auto"):
            raise OptionError(f"the final alignment is 'icp', 'planes' or 'auto', not {self.final!r}")
        if min(self.offset, self.margin, self.icp_reach_share) <= 0:
            raise OptionError("offset, margin and icp_reach_share must be positive")


def register_pair_by_paper(a: Prepared, b: Prepared, seed: int, options: PaperOptions) -> PairResult:
    """Find the pose of `a` in the frame of `b`, the reference scan, as the paper does, and judge it."""
    clock = Stopwatch()
    one, two = picture_features(a), picture_features(b)
    seeded = replace(options.visual, seed=seed)
    visual = clock.lap("initial", visual_alignment(one.features, two.features, seeded))
    found = PaperEvidence(visual=_visual_evidence(visual, one, two))
    if visual.pose is None:
        reason = f"the pictures gave no pose: {visual.reason.rstrip('.')}"
        return PairResult(verdict=LinkVerdict.REFUSED, reason=reason, paper=found, seconds=clock.seconds)
    result = align_finally(a, b, visual.pose, seed, options)
    evidence = None if result.paper is None else replace(result.paper, visual=found.visual)
    return replace(result, paper=evidence, seconds={**clock.seconds, **result.seconds})


def align_finally(a: Prepared, b: Prepared, initial: Matrix, seed: int, options: PaperOptions) -> PairResult:
    """Overlap, the choice between ICP and plane matching, and its verdict, from an initial ``b_from_a``."""
    clock = Stopwatch()
    points_a, points_b = picture_features(a).points, picture_features(b).points
    shared = clock.lap("overlap", overlap(points_a, points_b, initial, options.overlap))
    use_icp = options.final == "icp" or (options.final == "auto" and shared.of_b >= options.overlap.threshold)
    align_by = _by_icp if use_icp else _by_planes
    final = clock.lap("final", align_by(a, b, initial, seed, options))
    result = PairResult(
        verdict=LinkVerdict.REFUSED,
        reason=final.reason,
        method="icp" if use_icp else "plane-matching",
        initial_transform=initial,
        paper=PaperEvidence(
            overlap_initial=InitialOverlap(shared.of_a, shared.of_b, options.overlap.slack),
            overlap_threshold=options.overlap.threshold,
            icp=final.icp,
            planes=final.planes,
        ),
        seconds=clock.seconds,
    )
    return result if final.pose is None else clock.lap("verdict", _judged(result, a, b, final.pose, options))


class _Final(NamedTuple):
    """What step 4 found; without a pose, the reason."""

    pose: Matrix | None
    reason: str | None = None
    icp: IcpEvidence | None = None
    planes: PlanesEvidence | None = None


def _by_icp(a: Prepared, b: Prepared, initial: Matrix, seed: int, options: PaperOptions) -> _Final:
    """Align all points."""
    moving, fixed = picture_features(a).points, picture_features(b).points
    ranges = np.linalg.norm(fixed - b.scanner_origin, axis=1)
    limit = options.icp_reach_share * float(np.median(ranges))
    limit = min(options.icp.max_correspondence_distance, limit)
    icp = align(moving, fixed, initial, replace(options.icp, max_correspondence_distance=limit))
    found = IcpEvidence(icp.rmse, icp.max_correspondence_distance, icp.matched, icp.iterations, icp.converged)
    if icp.matched < 3:
        return _Final(None, "no point has a neighbour within the reach of ICP", icp=found)
    return _Final(icp.pose, icp=found)


def _by_planes(a: Prepared, b: Prepared, initial: Matrix, seed: int, options: PaperOptions) -> _Final:
    """Match planes of the whole scans, then of the overlapping area that this pose tells, and say which they were.

    The paper's conclusion wants the three planes on the overlapping area, which an initial alignment that is metres off
    does not tell: planes of the whole scans come first. Where the overlapping area lacks three, they stand.
    """
    one, two = picture_features(a).points, picture_features(b).points
    seeds = (2 * seed, 2 * seed + 1)
    planes = options.planes
    try:
        found = match_planes(one, two, initial, seeds, planes)
        if planes.choice == "consistent":
            near = replace(
                planes, farthest=min(1.0, planes.farthest), widest=min(np.radians(5.0), planes.widest)
            )
            shared = overlap(one, two, found.pose, options.overlap)
            with suppress(PlanesRefused):
                found = match_planes(one[shared.shared_a], two[shared.shared_b], found.pose, seeds, near)
    except PlanesRefused as refusal:
        return _Final(None, f"plane matching gave no pose: {refusal}")
    return _Final(found.pose, planes=planes_evidence(found, planes))


def _judged(result: PairResult, a: Prepared, b: Prepared, pose: Matrix, options: PaperOptions) -> PairResult:
    """Judge a pose by free space and shared surface; the paper gives no covariance and no other pose."""
    scanned = motion(None, -b.scanner_origin) @ pose @ motion(None, a.scanner_origin)
    looked = EvidenceOptions(offset=options.offset, margin=options.margin)
    # Its pose is good to centimetres, in which nothing fits to the noise.
    evidence = replace(
        gather(a, b, PoseEstimate(scanned), looked),
        misfit=BEYOND_DOUBT[-1],
        appearance_similarity=None,
        enclosed=False,
    )
    estimate = PoseEstimate(pose, residuals=point_to_plane_residuals(a, b, scanned, options.offset))
    judged = judge([estimate], [evidence], options.judgement)
    return replace(
        result,
        verdict=judged.verdict,
        reason=judged.reason,
        estimate=judged.estimate,
        overlap_from=evidence.overlap_from,
        overlap_to=evidence.overlap_to,
        free_space_conflict=evidence.free_space_conflict,
        evidence=judged.evidence,
    )


def planes_evidence(found: PlaneMatch, options: PlaneMatchingOptions) -> PlanesEvidence:
    """What the figure of a plane match needs, and where each of the three stood among all."""

    def told(planes: Sequence[Plane], ranks: Sequence[int]) -> tuple[PlaneEvidence, ...]:
        return tuple(
            PlaneEvidence(_triple(plane.normal), plane.distance, plane.points, rank, plane.thickness)
            for plane, rank in zip(planes, ranks, strict=True)
        )

    return PlanesEvidence(
        told(found.planes_a, found.ranks_a),
        told(found.planes_b, found.ranks_b),
        corner_from=_triple(found.corner_a),
        corner_to=_triple(found.corner_b),
        segmented=Ends(len(found.found_a), len(found.found_b)),
        leftover_deg=tuple(np.degrees(found.leftover).tolist()),
        tolerance_m=options.tolerance,
    )


def _triple(values: Float64) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _visual_evidence(visual: VisualAlignment, a: PictureFeatures, b: PictureFeatures) -> VisualEvidence:
    return VisualEvidence(
        gate=visual.gate,
        note=visual.reason,
        picture_pairs=visual.picture_pairs,
        matches=visual.matches,
        planar=visual.planar,
        agreeing=visual.agreeing,
        rmse_m=visual.rmse,
        rendered=Ends(a.rendered, b.rendered),
        features=Ends(sum(len(f) for f in a.features), sum(len(f) for f in b.features)),
        pairs=tuple(_drawn(pair) for pair in visual.pairs),
    )


def _drawn(pair: PicturePair) -> PictureMatches:
    """A picture pair's matches for its figure: those that agree first, then the others, the most distinct first."""
    order = np.argsort(~pair.agreeing, kind="stable")[:_MOST_DRAWN]

    def pixels(of: Floating) -> tuple[tuple[float, float], ...]:
        return tuple((x, y) for x, y in np.round(of[order], 1).tolist())

    return PictureMatches(
        pair.view_a,
        pair.view_b,
        len(pair),
        int(pair.planar.sum()),
        int(pair.agreeing.sum()),
        pixels(pair.pixels_a),
        pixels(pair.pixels_b),
        tuple(pair.agreeing[order].tolist()),
    )
