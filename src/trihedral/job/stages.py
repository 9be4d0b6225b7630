"""What a job is told to do: the steps, and what identifies their results."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from trihedral.errors import InputError
from trihedral.geometry.arrays import Float32, Floating
from trihedral.guarded import blamed_on
from trihedral.initial.visual.scan_features import Picture
from trihedral.job.hashes import digest
from trihedral.model.link import Link, PairResult
from trihedral.model.pairs import PairHistory, PairPreview, PairRequest, PassedOver
from trihedral.model.registration import Registration
from trihedral.model.station import DescribedStation
from trihedral.progress import Progress
from trihedral.scan import Scan, ScanHeader


@dataclass(frozen=True)
class PreparedStation(DescribedStation):
    """A station whose scan is prepared."""

    key: str  # of the prepared scan: hash of what it was prepared from, and how
    load: Callable[[], Any]  # gives the prepared scan, from memory or from the job folder


@dataclass(frozen=True)
class StoredScan:
    """What a job goes on with once a scan is prepared and stored."""

    sha256: str  # of its file
    key: str  # of the prepared scan
    points: int  # valid ones
    descriptor: Any  # the little that stays in memory
    header: ScanHeader  # with what the points told of it
    beacons: Float32 | None  # points by which the scan is known again


@dataclass(frozen=True, kw_only=True)
class ScanSteps:
    """The steps of one scan, which other processes can be told.

    A prepared scan knows the `scanned_points` that it was made of, has `notes` for people, and is written by
    `save(path)`: the same scan gives the same bytes.
    Programs and options are everything that a stored result depends on beside the scans.
    """

    read_scan: Callable[[ScanHeader], Scan]
    prepare: Callable[[Scan], Any]
    #: Reads what `save` wrote.
    load: Callable[[Path], Any]
    #: Fingerprint of what prepares scans, and its options.
    program: str
    prepare_options: str
    #: A little of a prepared scan that stays in memory, for `Stages.candidate_pairs` to go by.
    describe: Callable[[Any], Any] = lambda prepared: None
    #: (M, 3) points of a prepared scan by which it is known again (`scan.beacons`); None: it is not.
    beacons: Callable[[Any], Float32 | None] = lambda prepared: None
    #: Adds to a header what a prepared scan knows of where its points were seen from.
    placed: Callable[[Any, ScanHeader], ScanHeader] = lambda prepared, header: header

    def key(self, sha256: str, scan_index: int) -> str:
        """Name a prepared scan by the hash of its file and its number there."""
        return digest(sha256, str(scan_index), self.program, self.prepare_options)[:32]

    def stored_as(self, sha256: str, header: ScanHeader, prepared: Any) -> StoredScan:
        """Say of a prepared scan what the job goes on with."""
        key = self.key(sha256, header.scan_index)
        found = self.placed(prepared, header)
        return StoredScan(
            sha256, key, prepared.scanned_points, self.describe(prepared), found, self.beacons(prepared)
        )

    def store(
        self, header: ScanHeader, sha256: Callable[[], str], save: Callable[[str, Any], None]
    ) -> StoredScan:
        """Read, prepare and save one scan.

        Its file's hash is asked for last: by then it must be clear that what was hashed is what was read.
        """
        with blamed_on(header.source, "preparing it"):
            scan = self.read_scan(header)
            if len(scan) == 0:
                raise InputError(header.source, "the scan has no valid points")
            prepared = self.prepare(scan)
            del scan
        stored = self.stored_as(sha256(), header, prepared)
        save(stored.key, prepared)
        return stored


def _no_preview(a: Any, b: Any) -> PairPreview:
    raise AssertionError("a preview was asked for, and there is none")


@dataclass(frozen=True, kw_only=True)
class Stages(ScanSteps):
    """The steps of a job, and what identifies their results."""

    read_headers: Callable[[Path], Sequence[ScanHeader]]
    #: (N, 3) evenly sampled points of a prepared scan in station coordinates, metres.
    surface: Callable[[Any], Floating]
    #: Pairs worth trying next, given what came of others so far; asked again until nothing new comes.
    candidate_pairs: Callable[[Sequence[PreparedStation], PairHistory], Iterable[PairRequest]]
    #: The pose of the first scan in the frame of the second; the seed derives from their content.
    register_pair: Callable[[Any, Any, int], PairResult]
    #: Statuses, loops and poses in one frame, on so many threads; the job adds what it knows beside.
    solve: Callable[[Sequence[PreparedStation], Sequence[Link], Progress, int], Registration]
    #: Program and options of pairs.
    pair_version: str
    options: Mapping[str, object] = field(default_factory=dict)
    #: A preview of a pair, where `candidate_pairs` asks for no more.
    preview: Callable[[Any, Any], PairPreview] = _no_preview
    #: Why pairs were not registered, when `candidate_pairs` asks for no more.
    passed_over: Callable[[Sequence[PreparedStation], PairHistory], PassedOver] = lambda *_: PassedOver()
    #: Files that are no scans, though they may be taken for some.
    aside: Sequence[str] = ()
    #: (N, 3) in 0..1 of the points of `surface`, NaN where unknown; None where the scan has none.
    colors: Callable[[Any], Float32 | None] = lambda prepared: None
    #: Pictures that links' evidence speaks of by their names.
    pictures: Callable[[Any], Sequence[Picture]] = lambda prepared: ()

    @property
    def of_scan(self) -> ScanSteps:
        """Those of one scan alone."""
        return ScanSteps(**{step.name: getattr(self, step.name) for step in fields(ScanSteps)})
