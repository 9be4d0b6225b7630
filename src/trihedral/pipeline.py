"""A job on one page: its options, the steps that it is told to do, and their sequence."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from threadpoolctl import threadpool_limits

from trihedral.errors import OptionError
from trihedral.final.point_to_plane import linearised
from trihedral.geometry.se3 import Matrix
from trihedral.initial.plan.descriptor import describe_plan
from trihedral.initial.visual.scan_features import PictureFeatures, picture_features, prepare_pictured
from trihedral.io import ReadOptions, read_headers, read_photos, read_scan
from trihedral.job.executor import Executor
from trihedral.job.hashes import FileHashes
from trihedral.job.outcome import Outcome, outcome
from trihedral.job.pairing import link_stations
from trihedral.job.preparation import find_scans, prepare_scans
from trihedral.job.stages import PreparedStation, Stages
from trihedral.job.store import Store
from trihedral.model.link import Link, PoseEstimate
from trihedral.model.registration import Registration
from trihedral.network.candidates.options import CandidateOptions
from trihedral.network.candidates.search import all_pairs
from trihedral.network.candidates.selection import PairSelection
from trihedral.network.chain import chain
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.options import NetworkOptions
from trihedral.network.solve import solve
from trihedral.pair.auto import AutoOptions, register_pair
from trihedral.pair.paper import PaperOptions, register_pair_by_paper
from trihedral.pair.preview import PreviewOptions, preview_pair
from trihedral.pair.stopwatch import Stopwatch
from trihedral.progress import Progress, relayed
from trihedral.scan.preparation import PrepareOptions, prepare
from trihedral.scan.prepared import Prepared
from trihedral.version import fingerprint

_PREPARING = ("geometry", "scan", "io", "fusion", "initial", "guarded.py")
_PAIRING = ("geometry", "scan", "model", "initial", "overlap", "final", "verdict", "pair")


@dataclass(frozen=True)
class Options:
    """Everything that a person may choose about the method; it is written into the result."""

    #: "auto": as good as can be done; "paper": the source paper's as written.
    method: Literal["auto", "paper"] = "auto"
    #: What the files leave open.
    read: ReadOptions = field(default_factory=ReadOptions)
    #: How a scan is prepared.
    prepare: PrepareOptions = field(default_factory=PrepareOptions)
    #: The default method for a pair, and its preview.
    auto: AutoOptions = field(default_factory=AutoOptions)
    preview: PreviewOptions = field(default_factory=PreviewOptions)
    #: Which pairs are tried.
    candidates: CandidateOptions = field(default_factory=CandidateOptions)
    #: How links are judged together.
    network: NetworkOptions = field(default_factory=NetworkOptions)
    #: What is known beside the scans.
    constraints: Constraints = field(default_factory=Constraints)
    #: The paper's method for a pair.
    paper: PaperOptions = field(default_factory=PaperOptions)

    def __post_init__(self) -> None:
        if self.method not in ("auto", "paper"):
            raise OptionError(f"the method is 'auto' or 'paper', not {self.method!r}")
        if self.method == "paper" and self.constraints != Constraints():
            raise OptionError("the paper's method takes no constraints")


def run(
    paths: list[Path | str], steps: Stages, store: Store, executor: Executor, threads: int, progress: Progress
) -> Outcome:
    """The sequence of a job: headers, scans, links, registration.

    The result depends on what the files hold and on their names, not on their order or the number of threads.
    """
    clock = Stopwatch()
    # Scans and pairs share the processors; threads within their small products of matrices would be in the way.
    with threadpool_limits(1, "blas"), FileHashes(store, threads) as hashes:
        found = clock.lap("headers", find_scans(paths, steps, hashes, threads, progress))
        scans = clock.lap("prepare", prepare_scans(found, steps, store, executor, hashes, threads, progress))
        pairs = clock.lap("pairs", link_stations(scans.stations, steps, store, executor, progress))
        registration = clock.lap(
            "network", relayed(lambda told: steps.solve(scans.stations, pairs.links, told, threads), progress)
        )
        return outcome(registration, scans, pairs, hashes.inputs(), steps.options, clock.seconds)


def stages(options: Options) -> Stages:
    """Put the steps together."""
    return paper_stages(options) if options.method == "paper" else auto_stages(options)


def paper_stages(options: Options) -> Stages:
    """The steps of the source paper: every pair, links chained."""
    return Stages(
        read_headers=lambda path: read_headers(path, options.read),
        read_scan=lambda header: read_scan(header, options.read),
        prepare=lambda scan: prepare_pictured(
            scan, read_photos(scan.header), options.prepare, options.paper.features
        ),
        load=lambda path: Prepared.load(path, PictureFeatures),
        placed=Prepared.placed,
        beacons=lambda prepared: prepared.beacons,
        surface=lambda prepared: prepared.surfels.points + prepared.scanner_origin,
        candidate_pairs=all_pairs,
        register_pair=lambda a, b, seed: register_pair_by_paper(a, b, seed, options.paper),
        solve=lambda stations, links, progress, threads: chain(stations, links, progress),
        program=fingerprint(*_PREPARING)[:16],
        prepare_options=f"{options.read} {options.prepare} {options.paper.features}",
        pair_version=f"{fingerprint(*_PAIRING)} {options.paper}",
        options={k: v for k, v in asdict(options).items() if k in ("method", "read", "prepare", "paper")},
        colors=lambda prepared: prepared.surfels.color,
        pictures=lambda prepared: picture_features(prepared).pictures,
    )


def auto_stages(options: Options) -> Stages:
    """The steps of the default method: likely pairs, all links judged and all scans adjusted together."""
    selection = PairSelection(options.candidates, options.network, options.constraints)

    def solved(
        stations: Sequence[PreparedStation], links: Sequence[Link], progress: Progress, threads: int
    ) -> Registration:
        def surfaces(a: int, b: int, pose: Matrix) -> PoseEstimate:
            return linearised(stations[a].load(), stations[b].load(), pose, options.auto.refinement)

        return solve(stations, links, options.network, options.constraints, surfaces, progress, threads)

    return Stages(
        read_headers=lambda path: read_headers(path, options.read),
        read_scan=lambda header: read_scan(header, options.read),
        prepare=lambda scan: prepare(scan, options.prepare),
        load=Prepared.load,
        surface=lambda prepared: prepared.surfels.points + prepared.scanner_origin,
        candidate_pairs=selection.requests,
        register_pair=lambda a, b, seed: register_pair(a, b, options.auto),
        solve=solved,
        program=fingerprint(*_PREPARING)[:16],
        prepare_options=f"{options.read} {options.prepare}",
        pair_version=f"{fingerprint(*_PAIRING)} {options.auto} {options.preview}",
        options={k: v for k, v in asdict(options).items() if k != "paper"},
        describe=describe_plan,
        placed=Prepared.placed,
        beacons=lambda prepared: prepared.beacons,
        preview=lambda a, b: preview_pair(a, b, options.preview),
        passed_over=selection.passed_over,
        aside=options.constraints.files,
        colors=lambda prepared: prepared.surfels.color,
    )
