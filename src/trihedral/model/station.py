"""A scan of the job, and the pose that was found for it."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from trihedral.geometry.arrays import Float64
from trihedral.scan import ScanHeader


@dataclass(frozen=True)
class Station:
    """A scan before it has a pose.

    Attributes
    ----------
    name
        Unique in the job.
    points
        Valid points read.
    content
        Hash of its file and its number there; decides where names and the order of files must not.
    """

    name: str
    header: ScanHeader
    points: int
    content: str


@dataclass(frozen=True)
class DescribedStation(Station):
    """A station with the little of its scan that stays in memory, by which pairs are chosen.

    Attributes
    ----------
    descriptor
        An `initial.plan.descriptor.PlanDescriptor` where the default method runs.
    """

    descriptor: Any


class StationStatus(StrEnum):
    """How far a station's pose may be believed."""

    VERIFIED = "verified"  # at least two independent paths of links agree
    SINGLE_LINKED = "single-linked"  # one path
    AMBIGUOUS = "ambiguous"  # two poses explain the data nearly as well
    NOT_PLACED = "not-placed"


@dataclass(frozen=True)
class StationResult:
    """One scan and the pose found for it.

    Attributes
    ----------
    pose
        (4, 4) project_from_station; None if not placed.
    tied
        Whether it is linked to at least one other station.
    component
        Which connected component of the job, the largest first; None if not placed.
    reason
        Why it is not verified.
    """

    name: str
    header: ScanHeader
    points: int
    pose: Float64 | None
    tied: bool
    component: int | None
    status: StationStatus
    reason: str | None
    sigma_translation_m: tuple[float, float, float] | None = None
    sigma_rotation_deg: tuple[float, float, float] | None = None
