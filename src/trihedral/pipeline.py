"""The method on one page: what is done to a scan, to a pair and to the network, with which options."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.final.point_to_plane import Refinement, RefinementOptions, linearised, refine
from trihedral.geometry.se3 import distance, motion
from trihedral.initial.hypotheses import HypothesisOptions, hypotheses
from trihedral.initial.plan.descriptor import descriptor
from trihedral.initial.plan.proposals import PlanOptions, plan_poses
from trihedral.initial.visual.scan_features import Picture, Pictured, prepare_pictured
from trihedral.io import ReadOptions, read_headers, read_photos, read_scan
from trihedral.model.link import Link, LinkVerdict, Residuals, WeakestDirection
from trihedral.model.registration import Registration
from trihedral.model.station import Station
from trihedral.network.candidates.search import (
    CandidateOptions,
    CandidateSearch,
    PairHistory,
    PairPreview,
    PairRequest,
    PassedOver,
    all_pairs,
)
from trihedral.network.chain import chain
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.constraints.user_links import decided, wanted_pairs
from trihedral.network.solve import NetworkOptions, believed, resolve, solve
from trihedral.pair.paper import PaperOptions, register_pair_by_paper
from trihedral.progress import Progress
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.preparation import PrepareOptions, prepare
from trihedral.scan.prepared import Prepared
from trihedral.verdict.appearance import enclosed, similarity, without_strangers
from trihedral.verdict.evidence import evidence, held_area, loose_conflict, probabilities
from trihedral.verdict.judgement import JudgementOptions, contradiction, judge
from trihedral.verdict.verification import Round, SelectionOptions, compared_closely, select
from trihedral.version import fingerprint

Float64 = NDArray[np.float64]

# Other poses of a pair that are weighed against the best one, and the share of its score that makes one worth it.
RIVALS = 2
RIVAL_SCORE = 0.05
# Metres and radians within which two refined poses are one.
SAME_TRANSLATION = 0.05
SAME_ROTATION = float(np.radians(0.5))
# A pose less likely than this is none that explains the data nearly as well.
LEAST_CHANCE = 0.02


class PreparedScan(Protocol):
    """What the driver needs to know of a prepared scan."""

    @property
    def scanned_points(self) -> int:
        """Valid points that it was made of."""

    def save(self, path: Path) -> None:
        """Write it to a file; the same scan gives the same bytes."""


@dataclass(frozen=True)
class StationInput:
    """One prepared scan as the network stages see it."""

    name: str  # unique in the job
    header: ScanHeader
    points: int  # valid points read
    content: str  # hash of its file and its number there; decides where names and the order of files must not
    key: str  # of the prepared scan: hash of what it was prepared from, and how
    load: Callable[[], Any]  # gives the prepared scan, from memory or from the job folder
    descriptor: Any = None  # what `Stages.descriptor` made of it


@dataclass(frozen=True)
class Stages:
    """The steps that the driver runs, and what identifies their results.

    Programs and options are everything that a stored result depends on beside the scans.
    """

    read_headers: Callable[[Path], Sequence[ScanHeader]]
    read_scan: Callable[[ScanHeader], Scan]
    prepare: Callable[[Scan], Any]
    # Reads what `PreparedScan.save` wrote.
    load: Callable[[Path], Any]
    # (N, 3) evenly sampled points of a prepared scan in station coordinates, metres.
    surface: Callable[[Any], NDArray[np.floating[Any]]]
    # Pairs worth trying next, given what came of others so far; asked again until nothing new comes.
    candidate_pairs: Callable[[Sequence[StationInput], PairHistory], Iterable[PairRequest]]
    # The link from the first to the second; the driver names its ends. The seed derives from their content.
    register_pair: Callable[[Any, Any, int], Link]
    # Statuses, loops and poses in one frame, on so many threads; `failures`, `options` and `seed` are filled in later.
    solve: Callable[[Sequence[StationInput], Sequence[Link], Progress, int], Registration]
    program: str  # fingerprint of what prepares scans
    prepare_options: str
    pair_version: str  # program and options
    options: Mapping[str, object] = field(default_factory=dict)
    # A little of a prepared scan that stays in memory, for `candidate_pairs` to go by.
    descriptor: Callable[[Any], Any] = lambda prepared: None
    # A quick look at a pair, where `candidate_pairs` asks for no more.
    preview: Callable[[Any, Any], PairPreview] | None = None
    # Why pairs were not registered, when `candidate_pairs` asks for no more.
    passed_over: Callable[[Sequence[StationInput], PairHistory], PassedOver] = lambda stations, history: (
        PassedOver()
    )
    # Colours (N, 3) in 0..1 of the points of `surface`, NaN where unknown; None where the scan has none.
    colors: Callable[[Any], NDArray[np.float32] | None] = lambda prepared: None
    # Files that are no scans, though they may look like some.
    aside: Sequence[str] = ()
    # Pictures that links' evidence speaks of by their names.
    pictures: Callable[[Any], Sequence[Picture]] = lambda prepared: ()


@dataclass(frozen=True)
class PreviewOptions:
    """A pair's own method, cut short: few headings on a coarse plan, few poses refined."""

    previewed: int = 3  # best poses, until one looks the same in both scans
    least_score: float = 0.04  # of a pose, below which it is not looked at
    previews: int = 4000  # elements whose looks are compared
    least_similarity: float = 0.5
    plan: PlanOptions = field(
        default_factory=lambda: PlanOptions(
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
    )
    selection: SelectionOptions = field(
        default_factory=lambda: SelectionOptions(
            hypotheses=60,
            rounds=(
                Round(
                    8,
                    offset=0.5,
                    margin=0.5,
                    compared=300,
                    leniencies=(5,),
                    prices=(3,),
                    reaches=(0.5,),
                    refined=300,
                ),
                Round(
                    3,
                    offset=0.3,
                    margin=0.3,
                    compared=600,
                    leniencies=(3,),
                    prices=(2,),
                    reaches=(0.25, 0.12),
                    refined=600,
                ),
            ),
        )
    )


@dataclass(frozen=True)
class Options:
    """Everything that a person may choose about the method; it is written into the result."""

    method: Literal["auto", "paper"] = "auto"  # as good as can be done, or the source paper's as written
    read: ReadOptions = field(default_factory=ReadOptions)  # what the files leave open
    prepare: PrepareOptions = field(default_factory=PrepareOptions)
    hypotheses: HypothesisOptions = field(default_factory=HypothesisOptions)
    selection: SelectionOptions = field(default_factory=SelectionOptions)
    refinement: RefinementOptions = field(default_factory=RefinementOptions)
    judgement: JudgementOptions = field(default_factory=JudgementOptions)
    candidates: CandidateOptions = field(default_factory=CandidateOptions)
    preview: PreviewOptions = field(default_factory=PreviewOptions)
    network: NetworkOptions = field(default_factory=NetworkOptions)
    constraints: Constraints = field(default_factory=Constraints)  # what is known beside the scans
    paper: PaperOptions = field(default_factory=PaperOptions)

    def __post_init__(self) -> None:
        if self.method not in ("auto", "paper"):
            raise OptionError(f"the method is 'auto' or 'paper', not {self.method!r}")
        if self.method == "paper" and self.constraints != Constraints():
            raise OptionError("the paper's method takes no constraints")


def stages(options: Options) -> Stages:
    """Put the steps together."""
    return paper_stages(options) if options.method == "paper" else auto_stages(options)


def paper_stages(options: Options) -> Stages:
    """The steps of the source paper."""

    def prepared(scan: Scan) -> Pictured:
        return prepare_pictured(scan, read_photos(scan.header), options.prepare, options.paper.features)

    def chained(
        stations: Sequence[StationInput], links: Sequence[Link], progress: Progress, threads: int
    ) -> Registration:
        progress.phase("Chaining links", 1, "", 1.0, "")
        registration = chain(_members(stations), links)
        progress.advance(f"{len(stations)} scans", 1.0)
        return registration

    rooms = ("geometry", "scan", "model", "initial", "overlap", "final", "verdict", "pair")
    return Stages(
        read_headers=lambda path: read_headers(path, options.read),
        read_scan=lambda header: read_scan(header, options.read),
        prepare=prepared,
        load=Pictured.load,
        surface=lambda pictured: pictured.prepared.points + pictured.prepared.scanner_origin,
        candidate_pairs=all_pairs,
        register_pair=lambda a, b, seed: register_pair_by_paper(a, b, seed, options.paper),
        solve=chained,
        program=fingerprint("geometry", "scan", "io", "fusion", "initial")[:16],
        prepare_options=f"{options.read} {options.prepare} {options.paper.features}",
        pair_version=f"{fingerprint(*rooms)} {options.paper}",
        options={
            "method": "paper",
            "read": asdict(options.read),
            "prepare": asdict(options.prepare),
            "paper": asdict(options.paper),
        },
        colors=lambda pictured: pictured.prepared.color,
        pictures=lambda pictured: pictured.pictures,
    )


def auto_stages(options: Options) -> Stages:
    """The steps of the default method."""

    def solved(
        stations: Sequence[StationInput], links: Sequence[Link], progress: Progress, threads: int
    ) -> Registration:
        def surfaces(a: int, b: int, pose: Float64) -> tuple[Float64, Float64]:
            return linearised(stations[a].load(), stations[b].load(), pose, options.refinement)

        members = _members(stations)
        return solve(members, links, options.network, options.constraints, surfaces, progress, threads)

    search = CandidateSearch(options.candidates)

    def known(stations: Sequence[StationInput], history: PairHistory) -> tuple[Constraints, PairHistory]:
        # What a person decided on needs no search.
        members = _members(stations)
        constraints = resolve(options.constraints, members)
        return constraints, PairHistory(decided(constraints, history.links, members), history.previews)

    def together(
        stations: Sequence[StationInput], constraints: Constraints, history: PairHistory
    ) -> PairHistory:
        links = believed(_members(stations), history.links, options.network, constraints)
        return PairHistory(links, history.previews)

    def wanted(stations: Sequence[StationInput], history: PairHistory) -> list[PairRequest]:
        constraints, history = known(stations, history)
        # Links that loops refuse tie nothing; to close the loops after every round would take long.
        asked = search(stations, history) or search(stations, together(stations, constraints, history))
        return wanted_pairs(constraints, asked)

    def passed_over(stations: Sequence[StationInput], history: PairHistory) -> PassedOver:
        constraints, history = known(stations, history)
        return search.passed_over(stations, together(stations, constraints, history))

    pair_options = (
        options.preview,
        options.hypotheses,
        options.selection,
        options.refinement,
        options.judgement,
    )
    rooms = ("geometry", "scan", "model", "initial", "overlap", "final", "verdict", "pair", "pipeline.py")
    return Stages(
        read_headers=lambda path: read_headers(path, options.read),
        read_scan=lambda header: read_scan(header, options.read),
        prepare=lambda scan: prepare(scan, options.prepare),
        load=Prepared.load,
        surface=lambda prepared: prepared.points + prepared.scanner_origin,
        candidate_pairs=wanted,
        register_pair=lambda a, b, seed: register_pair(a, b, options),
        solve=solved,
        program=fingerprint("geometry", "scan", "io", "fusion", "initial")[:16],
        prepare_options=f"{options.read} {options.prepare}",
        pair_version=f"{fingerprint(*rooms)} {pair_options}",
        options={key: value for key, value in asdict(options).items() if key != "paper"},
        descriptor=descriptor,
        preview=lambda a, b: preview_pair(a, b, options.preview),
        passed_over=passed_over,
        aside=options.constraints.files,
        colors=lambda prepared: prepared.color,
    )


def _members(stations: Sequence[StationInput]) -> list[Station]:
    return [Station(s.name, s.header, s.points, s.content) for s in stations]


def register_pair(a: Prepared, b: Prepared, options: Options) -> Link:
    """Find the pose of `a` in the frame of `b` and judge it: the method for a pair."""
    watch = _Stopwatch()
    proposed = hypotheses(a, b, options.hypotheses)[: options.selection.hypotheses]
    watch.lap("hypotheses")
    limits = options.judgement
    chosen = select(a, b, proposed, options.selection)
    # A score is at most the share of surface that holds the pose: this asks no more than the verdict will.
    chosen = without_strangers(
        a,
        b,
        chosen,
        limits.least_similarity,
        RIVAL_SCORE,
        lambda pose: float(probabilities([_evidence(a, b, pose, options.selection)])[0]),
    )
    watch.lap("selection")
    if not chosen:
        return Link("", "", LinkVerdict.REFUSED, "no pose was found", seconds=watch.seconds)
    initial, best_score = chosen[0]
    refinement = refine(a, b, initial, options.refinement)
    watch.lap("refinement")
    agreement = compared_closely(a, b, [refinement.pose], options.selection)
    areas = (a.station.area, b.station.area)
    alike = similarity(a, b, refinement.pose)
    rivals = _rivals(
        a, b, [p for p, score in chosen[1:] if score > RIVAL_SCORE * best_score], refinement.pose, options
    )
    probability, *others = probabilities(
        [evidence(agreement, areas, alike), *(found for _, found in rivals)]
    ).tolist()
    standing = max((float(probabilities([found])[0]) for _, found in rivals), default=0.0)

    covariance = refinement.covariance
    under_ceiling = enclosed(a, b)
    variances, axes = np.linalg.eigh(covariance[3:, 3:])
    weakest = WeakestDirection((axes[0, 2], axes[1, 2], axes[2, 2]), float(np.sqrt(variances[2])))
    turn = float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[2]))
    verdict, reason = judge(
        agreement,
        areas,
        probability,
        sum(others),
        standing,
        weakest.sigma_m,
        turn,
        refinement.chi_square,
        alike,
        limits,
        enclosed=under_ceiling,
    )
    watch.lap("verdict")
    # Loops may choose one of them.
    alternatives = [rival for (rival, _), chance in zip(rivals, others, strict=True) if chance > LEAST_CHANCE]

    def between_stations(pose: Float64) -> Float64:
        return motion(None, b.scanner_origin) @ pose @ motion(None, -a.scanner_origin)

    return Link(
        from_station="",
        to_station="",
        verdict=verdict,
        reason=reason,
        method="refinement",
        transform=between_stations(refinement.pose),
        initial_transform=between_stations(initial),
        covariance=covariance,
        overlap_from=agreement.overlap[0],
        overlap_to=agreement.overlap[1],
        residuals=Residuals.of(refinement.offsets),
        free_space_conflict=float(agreement.conflict[0]),
        weakest_direction=weakest,
        runner_up=chosen[1][1] / best_score if len(chosen) > 1 else 0.0,
        alternatives=tuple(between_stations(rival.pose) for rival in alternatives),
        alternative_covariances=tuple(rival.covariance for rival in alternatives),
        alternative_residuals=tuple(Residuals.of(rival.offsets) for rival in alternatives),
        evidence={
            "score": float(agreement.score()[0]),
            "probability": probability,
            "held_area_m2": held_area(agreement, areas),
            "holding": float(agreement.holding[0].mean()),
            "purity": float(agreement.purity[0]),
            "solid_conflict": float(agreement.solid_conflict[0]),
            "small_conflict": float(agreement.small_conflict[0]),
            "loose_conflict_m2": loose_conflict(agreement, areas)[1],
            "chi_square": refinement.chi_square,
            **({"likeness": alike} if np.isfinite(alike) else {"unseen": 1.0} if under_ceiling else {}),
            **({"contradicted": 1.0} if contradiction(agreement, areas, limits) else {}),
            "weakest_rotation_deg": float(np.degrees(turn)),
            "compared": float(len(refinement.offsets)),
            "hypotheses": float(len(proposed)),
        },
        seconds=watch.seconds,
    )


def _evidence(a: Prepared, b: Prepared, pose: Float64, options: SelectionOptions) -> Float64:
    """What speaks for a pose and against it."""
    agreement = compared_closely(a, b, [pose], options)
    return evidence(agreement, (a.station.area, b.station.area), similarity(a, b, pose))


def _rivals(
    a: Prepared, b: Prepared, poses: Sequence[Float64], best: Float64, options: Options
) -> list[tuple[Refinement, Float64]]:
    """The next best poses that are others once they are refined, each with what speaks for it and against it."""
    rivals: list[tuple[Refinement, Float64]] = []
    # Wrong ones take the longest to converge; one that loops choose is adjusted with all elements.
    preview_only = replace(options.refinement, fine_samples=options.refinement.coarse_samples)
    for pose in poses[:RIVALS]:
        refined = refine(a, b, pose, preview_only)
        apart = [distance(refined.pose, other) for other in (best, *(rival.pose for rival, _ in rivals))]
        if all(t > SAME_TRANSLATION or r > SAME_ROTATION for t, r in apart):
            rivals.append((refined, _evidence(a, b, refined.pose, options.selection)))
    return rivals


def preview_pair(a: Prepared, b: Prepared, options: PreviewOptions) -> PairPreview:
    """Say in a fraction of a pair's time whether it is worth registering."""
    began = time.perf_counter()
    proposed = (
        [pose for pose, _ in plan_poses(a, b, options.plan)] if len(a.station) and len(b.station) else []
    )
    found = select(a, b, proposed[: options.selection.hypotheses], options.selection)
    score, alike = found[0][1] if found else 0.0, float("nan")
    for pose, value in found[: options.previewed]:
        if value < options.least_score:
            break
        alike = similarity(a, b, pose, options.previews)
        score = value
        if not alike < options.least_similarity:
            break
    seconds = time.perf_counter() - began
    return PairPreview(score, alike if np.isfinite(alike) else None, seconds)


class _Stopwatch:
    """Seconds of each step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        now = time.perf_counter()
        self.seconds[step] = now - self._last
        self._last = now
