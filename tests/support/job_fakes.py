"""Stages that know the truth: each file of a fake scan states where its scanner stood."""

import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from support import links as made
from trihedral.errors import InputError
from trihedral.job.stages import PreparedStation, Stages
from trihedral.model.link import Link, LinkVerdict, PairResult, PoseEstimate, Residuals
from trihedral.model.pairs import PairHistory, PairPreview, PairRequest, PassedOver
from trihedral.model.registration import Registration
from trihedral.model.station import StationResult, StationStatus
from trihedral.progress import Progress
from trihedral.scan import Scan, ScanHeader

# Of processes that import these fakes.
ENVIRONMENT = os.environ | {
    "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
}


def write_scans(path: Path, *places: float, points: int = 5) -> Path:
    """A file of scans whose scanners stood at x = place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps([{"x": x, "points": points} for x in places]), encoding="utf-8")
    return path


def write_site(folder: Path, count: int) -> list[Path]:
    return [write_scans(folder / f"s{k}.e57", 10.0 * k) for k in range(count)]


@dataclass(frozen=True)
class FakePrepared:
    x: float
    scanned_points: int
    notes: tuple[str, ...] = ()

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(asdict(self)) + "." * 100_000, encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> "FakePrepared":
        return cls(**json.loads(path.read_text(encoding="utf-8").rstrip(".")))


def fake_stages(
    log: list[str] | None = None, prepare_seconds: float = 0.0, pair_seconds: float = 0.0, version: str = "1"
) -> Stages:
    """Stages that append what they do to `log` and take that long."""
    log = [] if log is None else log

    def read_headers(path: Path) -> list[ScanHeader]:
        try:
            records = json.loads(path.read_bytes())
        except ValueError:
            raise InputError(path, "it is cut short", place="byte 7", advice="Copy it again") from None
        return [
            ScanHeader(
                source=path,
                scan_index=k,
                name=path.stem if len(records) == 1 else f"setup {k}",
                format="e57",
                points=record["points"],
                grid=None,
                has_color=False,
                has_intensity=False,
                photos=0,
                file_pose=None,
                scanner_origin=np.zeros(3),
                origin_stated=True,
                units="m",
                units_stated=True,
            )
            for k, record in enumerate(records)
        ]

    def read_scan(header: ScanHeader) -> Scan:
        record = json.loads(header.source.read_bytes())[header.scan_index]
        xyz = np.full((record["points"], 3), record["x"], dtype=np.float32)
        return Scan(header, xyz, np.zeros(3))

    def prepare(scan: Scan) -> FakePrepared:
        time.sleep(prepare_seconds)
        log.append(f"prepare {scan.header.source.name} {scan.header.scan_index}")
        return FakePrepared(float(scan.xyz[0, 0]), len(scan))

    def candidate_pairs(stations: Sequence[PreparedStation], history: PairHistory) -> list[PairRequest]:
        names = [s.name for s in sorted(stations, key=lambda s: s.load().x)]
        chain = list(pairwise(names))
        # A second round once the first is known, as a network that grows does.
        pairs = chain + list(zip(names, names[2:], strict=False)) if history.links else chain
        return [PairRequest(a, b, "neighbours") for a, b in pairs]

    def register_pair(a: FakePrepared, b: FakePrepared, seed: int) -> PairResult:
        time.sleep(pair_seconds)
        log.append(f"pair {min(a.x, b.x)} {max(a.x, b.x)}")
        b_from_a = np.eye(4)
        b_from_a[0, 3] = a.x - b.x + (seed % 1000) * 1e-9
        return PairResult(
            verdict=LinkVerdict.ACCEPTED,
            method="icp",
            estimate=PoseEstimate(
                b_from_a,
                covariance=np.diag(np.arange(1.0, 7.0)) / 3.0,
                residuals=Residuals(0.001, 0.0007, 0.002, 0.009),
            ),
            initial_transform=b_from_a + 0.1 * np.eye(4),
            overlap_from=0.5,
            overlap_to=1 / 3,
            free_space_conflict=0.0,
            runner_up=0.3,
            alternatives=(PoseEstimate(np.eye(4)),),
            evidence=made.evidence(1 / 3),
            seconds={"total": pair_seconds},
        )

    def solve(
        stations: Sequence[PreparedStation], links: Sequence[Link], progress: Progress, threads: int
    ) -> Registration:
        progress.phase("Placing", len(stations), "scans", len(stations), "")
        origin = stations[0].load().x
        for station in stations:
            progress.advance(station.name, 1.0)
        return Registration(
            stations=tuple(
                StationResult(
                    name=s.name,
                    header=s.header,
                    points=s.points,
                    pose=_shift(s.load().x - origin),
                    tied=len(stations) > 1,
                    component=0,
                    status=StationStatus.VERIFIED,
                    reason=None,
                    sigma_translation_m=(1e-4, 1e-4, 1e-4),
                    sigma_rotation_deg=(1e-3, 1e-3, 1e-3),
                )
                for s in stations
            ),
            links=tuple(links),
            loops=(),
        )

    return Stages(
        read_headers=read_headers,
        read_scan=read_scan,
        prepare=prepare,
        load=FakePrepared.load,
        surface=lambda prepared: np.full((4, 3), prepared.x, dtype=np.float32),
        candidate_pairs=candidate_pairs,
        register_pair=register_pair,
        solve=solve,
        program=version,
        prepare_options="",
        pair_version=version,
    )


def previewing(stages: Stages) -> Stages:
    """The same, but pairs up to three steps apart are previewed first, and only neighbours are registered."""

    def candidate_pairs(stations: Sequence[PreparedStation], history: PairHistory) -> list[PairRequest]:
        names = [s.name for s in sorted(stations, key=lambda s: s.load().x)]
        pairs = [(a, b) for k, a in enumerate(names) for b in names[k + 1 : k + 4]]
        if not history.previews:
            return [PairRequest(a, b, "within three steps", preview_only=True) for a, b in pairs]
        return [PairRequest(a, b, "neighbours") for a, b in pairwise(names)] if not history.links else []

    def passed_over(stations: Sequence[PreparedStation], history: PairHistory) -> PassedOver:
        known = {frozenset((k.from_station, k.to_station)) for k in history.links}
        why = {
            pair: f"score {preview.score:.2f}"
            for pair, preview in history.previews.items()
            if frozenset(pair) not in known
        }
        rest = len(stations) * (len(stations) - 1) // 2 - len(history.previews)
        return PassedOver(why, {"farther than three steps": rest})

    return replace(
        stages,
        candidate_pairs=candidate_pairs,
        preview=lambda a, b: PairPreview(
            1.0 / abs(a.x - b.x), None if abs(a.x - b.x) > 20.0 else 0.9, time.time()
        ),
        passed_over=passed_over,
    )


def crashing(stages: Stages, error: BaseException) -> Stages:
    """The same, but no pair can be registered."""

    def fail(a: object, b: object, seed: int) -> PairResult:
        raise error

    return replace(stages, register_pair=fail)


def _shift(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


def command(arguments: list[str], prepare_seconds: float = 0.0, pair_seconds: float = 0.0) -> list[str]:
    """The command line `trihedral` with these stages, for another process."""
    # Shells have what they run in the background ignore Ctrl-C, and that is inherited.
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "import support.job_fakes; import trihedral.api as api; "
        f"api.stages = lambda options: support.job_fakes.fake_stages(None, {prepare_seconds}, {pair_seconds}); "
        "from trihedral.cli import main; main(sys.argv[1:])"
    )
    return [sys.executable, "-c", code, *arguments]
