"""What a job is told to do: the steps, and what identifies their results."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from trihedral.initial.visual.scan_features import Picture
from trihedral.model.link import Link, PairResult
from trihedral.model.pairs import PairHistory, PairPreview, PairRequest, PassedOver
from trihedral.model.registration import Registration
from trihedral.model.station import DescribedStation
from trihedral.progress import Progress
from trihedral.scan import Scan, ScanHeader


class PreparedScan(Protocol):
    """What a job needs to know of a prepared scan."""

    @property
    def scanned_points(self) -> int:
        """Valid points that it was made of."""

    def save(self, path: Path) -> None:
        """Write it to a file; the same scan gives the same bytes."""


@dataclass(frozen=True)
class PreparedStation(DescribedStation):
    """A station whose scan is prepared.

    Attributes
    ----------
    key
        Of the prepared scan: hash of what it was prepared from, and how.
    load
        Gives the prepared scan, from memory or from the job folder.
    """

    key: str
    load: Callable[[], Any]


@dataclass(frozen=True)
class Stages:
    """The steps of a job, and what identifies their results.

    Programs and options are everything that a stored result depends on beside the scans.

    Attributes
    ----------
    load
        Reads what `PreparedScan.save` wrote.
    surface
        (N, 3) evenly sampled points of a prepared scan in station coordinates, metres.
    candidate_pairs
        Pairs worth trying next, given what came of others so far; asked again until nothing new comes.
    register_pair
        The pose of the first scan in the frame of the second; the seed derives from their content.
    solve
        Statuses, loops and poses in one frame, on so many threads; the job adds `failures`, `options` and `seed`.
    program, prepare_options
        Fingerprint of what prepares scans, and its options.
    pair_version
        Program and options of pairs.
    describe
        A little of a prepared scan that stays in memory, for `candidate_pairs` to go by.
    preview
        A preview of a pair, where `candidate_pairs` asks for no more.
    passed_over
        Why pairs were not registered, when `candidate_pairs` asks for no more.
    aside
        Files that are no scans, though they may look like some.
    colors
        (N, 3) in 0..1 of the points of `surface`, NaN where unknown; None where the scan has none.
    pictures
        Pictures that links' evidence speaks of by their names.
    """

    read_headers: Callable[[Path], Sequence[ScanHeader]]
    read_scan: Callable[[ScanHeader], Scan]
    prepare: Callable[[Scan], Any]
    load: Callable[[Path], Any]
    surface: Callable[[Any], NDArray[np.floating[Any]]]
    candidate_pairs: Callable[[Sequence[PreparedStation], PairHistory], Iterable[PairRequest]]
    register_pair: Callable[[Any, Any, int], PairResult]
    solve: Callable[[Sequence[PreparedStation], Sequence[Link], Progress, int], Registration]
    program: str
    prepare_options: str
    pair_version: str
    options: Mapping[str, object] = field(default_factory=dict)
    describe: Callable[[Any], Any] = lambda prepared: None
    preview: Callable[[Any, Any], PairPreview] | None = None
    passed_over: Callable[[Sequence[PreparedStation], PairHistory], PassedOver] = lambda stations, history: (
        PassedOver()
    )
    aside: Sequence[str] = ()
    colors: Callable[[Any], NDArray[np.float32] | None] = lambda prepared: None
    pictures: Callable[[Any], Sequence[Picture]] = lambda prepared: ()
