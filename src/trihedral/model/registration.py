"""The result of a job: every station, every link, every loop."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from trihedral.model.link import Link
from trihedral.model.pairs import PairPreview
from trihedral.model.station import StationResult


@dataclass(frozen=True)
class Loop:
    """How far a closed walk of links misses its start."""

    stations: tuple[str, ...]
    translation_m: float
    rotation_deg: float
    #: One sigma, from the links' covariances.
    expected_translation_m: float
    ok: bool
    #: One sigma.
    expected_rotation_deg: float | None = None


@dataclass(frozen=True)
class LinkCheck:
    """How far the rest of the network bears an accepted link out."""

    #: 0: nothing else checks it; 6: it decides nothing.
    redundancy: float
    #: Of the link against the adjusted poses.
    residual_m: float
    residual_deg: float
    #: Largest residual over its sigma; None where nothing checks it.
    standardised: float | None
    #: Without it, the poses change by this at the most; None: a part would come off.
    moves_m: float | None
    #: Which one does.
    moves_station: str | None


@dataclass(frozen=True)
class ControlMiss:
    """Where a scan shows a control point after the adjustment, less its coordinates."""

    point: str
    station: str
    #: It took no part in the adjustment.
    check: bool
    residual_m: tuple[float, float, float]
    #: To expect of the residual.
    sigma_m: tuple[float, float, float]
    #: Largest component over its sigma.
    standardised: float


@dataclass(frozen=True)
class Frame:
    """What the project coordinates are."""

    text: str
    crs: str | None = None
    #: Of the largest component: squares of residuals over what sigmas lead to expect.
    unit_variance: float | None = None
    #: Found from loops: what links err by beside what their own covariances say, one sigma.
    systematic_translation_m: float | None = None
    systematic_rotation_deg: float | None = None
    #: By how much their own covariances are too small.
    link_variance_scale: float | None = None


@dataclass(frozen=True)
class Failure:
    """An input, or one scan of it, that could not be used; the other scans went on."""

    path: str
    #: From 0; None for the whole file.
    scan_index: int | None
    reason: str


@dataclass(frozen=True)
class PreviewRecord:
    """A pair that was previewed, and what was decided of it."""

    from_station: str
    to_station: str
    #: Why it was previewed.
    because: str
    #: Of `Registration.pairs`, from 1.
    round: int
    preview: PairPreview
    #: Whether there is a link of it.
    registered: bool
    #: Why there is none.
    reason: str | None


@dataclass(frozen=True)
class Registration:
    """The whole result; `report.result` writes it as registration.json."""

    stations: tuple[StationResult, ...]
    links: tuple[Link, ...]
    loops: tuple[Loop, ...]
    #: Of accepted links, by their ends.
    checks: Mapping[tuple[str, str], LinkCheck] = field(default_factory=dict)
    control: tuple[ControlMiss, ...] = ()
    frame: Frame | None = None
    failures: tuple[Failure, ...] = ()
    options: Mapping[str, object] = field(default_factory=dict)
    seed: int = 0
    timing: Mapping[str, float] = field(default_factory=dict)
    #: How many were possible, and tried in each round.
    pairs: Mapping[str, object] = field(default_factory=dict)
    previews: tuple[PreviewRecord, ...] = ()
