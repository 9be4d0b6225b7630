"""A scan of the job, and the pose that was found for it."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from trihedral.geometry.arrays import Float64
from trihedral.scan import ScanHeader


@dataclass(frozen=True)
class Station:
    """A scan before it has a pose."""

    #: Unique in the job.
    name: str
    header: ScanHeader
    #: Valid points read.
    points: int
    #: Hash of its file and its number there; decides where names and the order of files must not.
    content: str


@dataclass(frozen=True)
class DescribedStation(Station):
    """A station with the little of its scan that stays in memory, by which pairs are chosen."""

    #: An `initial.plan.descriptor.PlanDescriptor` where the default method runs.
    descriptor: Any


class StationStatus(StrEnum):
    """How far a station's pose may be believed."""

    VERIFIED = "verified"  # at least two independent paths of links agree
    SINGLE_LINKED = "single-linked"  # one path
    AMBIGUOUS = "ambiguous"  # two poses explain the data nearly as well
    NOT_PLACED = "not-placed"


@dataclass(frozen=True)
class StationResult:
    """One scan and the pose found for it."""

    name: str
    header: ScanHeader
    points: int
    #: (4, 4) project_from_station; None if not placed.
    pose: Float64 | None
    #: Whether it is linked to at least one other station.
    tied: bool
    #: Which connected component of the job, the largest first; None if not placed.
    component: int | None
    status: StationStatus
    #: Why it is not verified.
    reason: str | None
    sigma_translation_m: tuple[float, float, float] | None = None
    sigma_rotation_deg: tuple[float, float, float] | None = None
