"""The source paper's method for a pair, one line a step.

Kim, P., Chen, J., Cho, Y. K. (2017), "Automated Point Clouds Registration using Visual and Planar Features for
Construction Environments". docs/paper.md says where it leaves something open and what was done there.
"""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.final.planes.match import (
    Plane,
    PlaneMatch,
    PlaneMatchingOptions,
    PlanesRefused,
    match_planes,
)
from trihedral.final.point_to_point import IcpOptions, align
from trihedral.geometry.se3 import Matrix, motion
from trihedral.initial.visual.alignment import PicturePair, VisualAlignment, VisualOptions, visual_alignment
from trihedral.initial.visual.features import FeatureOptions
from trihedral.initial.visual.scan_features import Pictured
from trihedral.model.link import Link, LinkVerdict, Residuals
from trihedral.overlap.nearest import OverlapOptions, overlap
from trihedral.scan.prepared import Prepared
from trihedral.verdict.agreement import Agreement, compare
from trihedral.verdict.evidence import evidence, probabilities
from trihedral.verdict.judgement import JudgementOptions, judge

Final = Literal["icp", "planes", "auto"]
_MOST_DRAWN = 150  # matches of a picture pair that are kept for its figure


@dataclass(frozen=True)
class PaperOptions:
    """The paper's options, step by step."""

    features: FeatureOptions = field(default_factory=lambda: FeatureOptions(kind="surf"))
    visual: VisualOptions = field(default_factory=VisualOptions)
    overlap: OverlapOptions = field(default_factory=OverlapOptions)
    final: Final = "auto"  # "auto": by the overlap
    icp: IcpOptions = field(default_factory=IcpOptions)
    # Of the reference scan's median range: points farther apart do not pull in ICP. What an initial alignment is off by
    # grows with the range; the paper's were off by 2 to 3 m on a site.
    icp_reach_share: float = 0.25
    planes: PlaneMatchingOptions = field(default_factory=PlaneMatchingOptions)
    # The paper checks no result; ours is compared with what both scanners saw, at a tolerance that suits its accuracy.
    offset: float = 0.25  # metres within which two surfaces are one
    margin: float = 0.3  # metres before a surface from which space counts as seen through
    judgement: JudgementOptions = field(default_factory=JudgementOptions)

    def __post_init__(self) -> None:
        if self.final not in ("icp", "planes", "auto"):
            raise OptionError(f"the final alignment is 'icp', 'planes' or 'auto', not {self.final!r}")
        if min(self.offset, self.margin, self.icp_reach_share) <= 0:
            raise OptionError("offset, margin and icp_reach_share must be positive")


def register_pair_by_paper(a: Pictured, b: Pictured, seed: int, options: PaperOptions) -> Link:
    """Find the pose of `a` in the frame of `b`, the reference scan, as the paper does, and judge it."""
    began = time.perf_counter()
    visual = visual_alignment(a.features, b.features, replace(options.visual, seed=seed))
    seconds = {"initial": time.perf_counter() - began}
    evidence = _visual_evidence(visual, a, b)
    if visual.pose is None:
        reason = f"the pictures gave no pose: {visual.reason.rstrip('.')}"
        return Link("", "", LinkVerdict.REFUSED, reason, evidence=evidence, seconds=seconds)
    link = align_finally(a, b, visual.pose, seed, options)
    return replace(link, evidence={**evidence, **link.evidence}, seconds={**seconds, **link.seconds})


def align_finally(a: Pictured, b: Pictured, initial: Matrix, seed: int, options: PaperOptions) -> Link:
    """Overlap, the choice between ICP and plane matching, and its verdict, from an initial ``b_from_a``."""
    began = time.perf_counter()
    shared = overlap(a.points, b.points, initial, options.overlap)
    seconds = {"overlap": time.perf_counter() - began}
    evidence: dict[str, Any] = {
        "overlap_initial": {"from": shared.of_a, "to": shared.of_b, "slack_m": options.overlap.slack},
        "overlap_threshold": options.overlap.threshold,
    }
    use_icp = options.final == "icp" or (options.final == "auto" and shared.of_b >= options.overlap.threshold)
    method = "icp" if use_icp else "plane-matching"
    began = time.perf_counter()
    reason = None
    pose: Matrix | None
    if use_icp:
        ranges = np.linalg.norm(b.points - b.prepared.scanner_origin, axis=1)
        reach = min(options.icp.reach, options.icp_reach_share * float(np.median(ranges)))
        icp = align(a.points, b.points, initial, replace(options.icp, reach=reach))
        pose = icp.pose if icp.matched >= 3 else None
        reason = None if pose is not None else "no point has a neighbour within the reach of ICP"
        evidence["icp"] = {
            "rmse_m": icp.rmse,
            "reach_m": icp.reach,
            "matched": icp.matched,
            "iterations": icp.iterations,
            "converged": icp.converged,
        }
    else:
        try:
            pose, evidence["planes"] = _by_planes(a.points, b.points, initial, seed, options)
        except PlanesRefused as refusal:
            pose, reason = None, f"plane matching gave no pose: {refusal}"
    seconds["final"] = time.perf_counter() - began
    if pose is None:
        return Link(
            "",
            "",
            LinkVerdict.REFUSED,
            reason,
            method=method,
            initial_transform=initial,
            evidence=evidence,
            seconds=seconds,
        )
    began = time.perf_counter()
    scanners = a.prepared.scanner_origin, b.prepared.scanner_origin
    scanned = motion(None, -scanners[1]) @ pose @ motion(None, scanners[0])
    agreement = compare(
        a.prepared, b.prepared, [scanned], offset=options.offset, margin=options.margin, samples=20_000
    )
    verdict, reason = _judged(agreement, a.prepared, b.prepared, options.judgement)
    seconds["verdict"] = time.perf_counter() - began
    return Link(
        "",
        "",
        verdict,
        reason,
        method=method,
        transform=pose,
        initial_transform=initial,
        overlap_from=agreement.overlap[0],
        overlap_to=agreement.overlap[1],
        residuals=_residuals(a.prepared, b.prepared, scanned, options.offset),
        free_space_conflict=float(agreement.conflict[0]),
        evidence={**evidence, "score": float(agreement.score()[0]), "purity": float(agreement.purity[0])},
        seconds=seconds,
    )


def _by_planes(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    initial: Matrix,
    seed: int,
    options: PaperOptions,
) -> tuple[Matrix, dict[str, Any]]:
    """Match planes of the whole scans, then of the overlapping area that this pose tells, and say which they were.

    The paper's conclusion wants the three planes on the overlapping area, which an initial alignment that is metres off
    does not tell: planes of the whole scans come first. Where the overlapping area lacks three, they stand.
    """
    seeds = (2 * seed, 2 * seed + 1)
    planes = options.planes
    found = match_planes(a, b, initial, seeds, planes)
    if planes.choice == "consistent":
        near = replace(planes, farthest=min(1.0, planes.farthest), widest=min(np.radians(5.0), planes.widest))
        shared = overlap(a, b, found.pose, options.overlap)
        with suppress(PlanesRefused):
            found = match_planes(a[shared.shared_a], b[shared.shared_b], found.pose, seeds, near)
    return found.pose, plane_evidence(found, planes)


def plane_evidence(found: PlaneMatch, options: PlaneMatchingOptions) -> dict[str, Any]:
    """What the figure of a plane match needs, and where each of the three stood among all, as JSON has it."""

    def described(planes: Sequence[Plane], ranks: Sequence[int]) -> list[dict[str, Any]]:
        return [
            {
                "normal": plane.normal.tolist(),
                "distance_m": plane.distance,
                "points": plane.points,
                "rank": rank,
                "thickness_m": plane.thickness,
            }
            for plane, rank in zip(planes, ranks, strict=True)
        ]

    return {
        "from": described(found.planes_a, found.ranks_a),
        "to": described(found.planes_b, found.ranks_b),
        "corner_from": found.corner_a.tolist(),
        "corner_to": found.corner_b.tolist(),
        "segmented": {"from": len(found.found_a), "to": len(found.found_b)},
        "leftover_deg": np.degrees(found.leftover).tolist(),
        "tolerance_m": options.tolerance,
    }


def _visual_evidence(visual: VisualAlignment, a: Pictured, b: Pictured) -> dict[str, Any]:
    return {
        "visual": {
            "gate": visual.gate,
            "note": visual.reason,
            "picture_pairs": visual.picture_pairs,
            "matches": visual.matches,
            "planar": visual.planar,
            "agreeing": visual.agreeing,
            "rmse_m": visual.rmse,
            "rendered": {"from": a.rendered, "to": b.rendered},
            "features": {
                "from": sum(len(f) for f in a.features),
                "to": sum(len(f) for f in b.features),
            },
            "pairs": [_drawn(pair) for pair in visual.pairs],
        }
    }


def _drawn(pair: PicturePair) -> Mapping[str, Any]:
    """A picture pair's matches for its figure: those that agree first, then the others, the most distinct first."""
    order = np.argsort(~pair.agreeing, kind="stable")[:_MOST_DRAWN]
    return {
        "from_picture": pair.view_a,
        "to_picture": pair.view_b,
        "matches": len(pair),
        "planar": int(pair.planar.sum()),
        "agreeing": int(pair.agreeing.sum()),
        "from_pixels": np.round(pair.pixels_a[order], 1).tolist(),
        "to_pixels": np.round(pair.pixels_b[order], 1).tolist(),
        "drawn_agreeing": pair.agreeing[order].tolist(),
    }


def _judged(
    agreement: Agreement, a: Prepared, b: Prepared, options: JudgementOptions
) -> tuple[LinkVerdict, str | None]:
    """Judge a pose by free space and shared surface; the paper gives no covariance and no other pose."""
    areas = (a.station.area, b.station.area)
    probability = float(probabilities([evidence(agreement, areas, np.nan)])[0])
    return judge(agreement, areas, probability, 0.0, 0.0, 0.0, 0.0, 0.0, options=options)


def _residuals(a: Prepared, b: Prepared, pose: Matrix, reach: float) -> Residuals | None:
    """Point-to-plane distances under the pose: the refinement's, at its start."""
    return Residuals.of(_core.refine_one(a.station, b.station, pose, [(reach, 40_000, 0, False)])[5])
