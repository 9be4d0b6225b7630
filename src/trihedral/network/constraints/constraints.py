"""What a person knows beside the scans."""

from dataclasses import dataclass, field
from typing import Literal

Triple = tuple[float, float, float]
Rows = tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True)
class LevelScanners:
    """Scanners that stood level."""

    #: Radians.
    sigma: float
    #: All of them if None.
    stations: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Fixed:
    """A scan whose pose is known."""

    station: str
    #: ``project_from_station``, and its sigmas in metres and radians.
    pose: Rows
    sigma_translation: float
    sigma_rotation: float
    #: Whether the job must hold the scan.
    needed: bool = True


@dataclass(frozen=True)
class UserPair:
    """A pair that a person has decided on; `transform` is ``to_from_from`` where he gives it."""

    from_station: str
    to_station: str
    transform: Rows | None = None
    #: Of the transform, metres and radians.
    sigma_translation: float = 0.0
    sigma_rotation: float = 0.0


@dataclass(frozen=True)
class ControlPoint:
    """A point with known coordinates, metres; a check takes no part in the adjustment."""

    name: str
    place: Triple
    sigma: Triple
    check: bool = False


@dataclass(frozen=True)
class Measurement:
    """A control point as one scan shows it, in the scan's own coordinates, metres."""

    station: str
    point: str
    place: Triple
    sigma: Triple


@dataclass(frozen=True)
class Control:
    """Control points and where scans show them."""

    #: The file with the points, for messages.
    source: str
    points: tuple[ControlPoint, ...] = ()
    measurements: tuple[Measurement, ...] = ()


@dataclass(frozen=True)
class Constraints:
    """Everything that a constraints file may say."""

    #: The file, for messages.
    source: str | None = None
    #: It and those that it names, none of them a scan.
    files: tuple[str, ...] = ()
    #: Name or WKT of the project's coordinate reference system.
    crs: str | None = None
    #: Whether the result keeps the coordinates that poses in the files are in; auto: where they agree with the result.
    coordinates: Literal["auto", "keep", "new"] = "auto"
    level: LevelScanners | None = None
    fixed: tuple[Fixed, ...] = ()
    forced: tuple[UserPair, ...] = ()
    forbidden: tuple[UserPair, ...] = ()
    locked: tuple[UserPair, ...] = ()
    control: Control = field(default_factory=lambda: Control(""))
