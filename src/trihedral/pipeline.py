"""The method on one page: what is done to a scan, to a pair and to the network, with which options."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from trihedral.io import ReadOptions, read_headers, read_scan
from trihedral.network import Registration, Station, StationStatus
from trihedral.scan import Scan, ScanHeader
from trihedral.verdict import Link, LinkVerdict
from trihedral.version import fingerprint


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
    content: str  # hash of what it was prepared from and how; names and file order do not enter it
    load: Callable[[], Any]  # gives the prepared scan, from memory or from the job folder


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
    # Pairs of names worth trying next, given the links found so far; asked again until nothing new comes.
    candidate_pairs: Callable[[Sequence[StationInput], Sequence[Link]], Iterable[tuple[str, str]]]
    # The link from the first to the second; the driver names its ends. The seed derives from their content.
    register_pair: Callable[[Any, Any, int], Link]
    # Statuses, loops and poses in one frame; `failures`, `options` and `seed` are filled in after it.
    solve: Callable[[Sequence[StationInput], Sequence[Link]], Registration]
    program: str  # fingerprint of what prepares scans
    prepare_options: str
    pair_version: str  # program and options
    options: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Options:
    """Everything that a person may choose about the method; it is written into the result."""

    read: ReadOptions = field(default_factory=ReadOptions)  # what the files leave open


def stages(options: Options) -> Stages:
    """Put the steps together."""

    def solve(stations: Sequence[StationInput], links: Sequence[Link]) -> Registration:
        alone = len(stations) == 1
        return Registration(
            stations=tuple(
                Station(
                    name=s.name,
                    header=s.header,
                    points=s.points,
                    pose=np.eye(4) if alone else None,
                    tied=False,
                    component=0 if alone else None,
                    status=StationStatus.SINGLE_LINKED if alone else StationStatus.NOT_PLACED,
                    reason="the only scan: it defines the frame" if alone else "no pair of scans was linked",
                )
                for s in stations
            ),
            links=tuple(links),
            loops=(),
        )

    return Stages(
        read_headers=lambda path: read_headers(path, options.read),
        read_scan=lambda header: read_scan(header, options.read),
        prepare=_Counted.of,
        load=_Counted.load,
        surface=lambda prepared: np.zeros((0, 3)),
        candidate_pairs=lambda stations, links: (),
        register_pair=lambda a, b, seed: Link("", "", LinkVerdict.REFUSED, "no pose was found"),
        solve=solve,
        program=fingerprint("geometry", "scan", "io")[:16],
        prepare_options=repr(options.read),
        pair_version=fingerprint("geometry", "scan", "initial", "overlap", "final", "verdict", "pipeline.py"),
        options=asdict(options),
    )


@dataclass(frozen=True)
class _Counted:
    scanned_points: int

    @classmethod
    def of(cls, scan: Scan) -> "_Counted":
        return cls(len(scan))

    def save(self, path: Path) -> None:
        path.write_text(str(self.scanned_points))

    @classmethod
    def load(cls, path: Path) -> "_Counted":
        return cls(int(path.read_text()))
