"""What the steps of the paper's method found, for its figures and tables."""

from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Ends(Generic[T]):
    """One thing of each scan of a pair."""

    from_: T
    to: T


@dataclass(frozen=True)
class PictureMatches:
    """Matches between a picture of each scan, those that agree with the pose first; pixels are (x, y)."""

    from_picture: str
    to_picture: str
    matches: int
    planar: int
    agreeing: int
    from_pixels: tuple[tuple[float, float], ...]
    to_pixels: tuple[tuple[float, float], ...]
    drawn_agreeing: tuple[bool, ...]


@dataclass(frozen=True)
class VisualEvidence:
    """Step 2: matched keypoints and the motion that they agree on."""

    gate: str
    note: str
    picture_pairs: int
    matches: int
    planar: int
    agreeing: int
    rmse_m: float | None
    rendered: Ends[bool]
    features: Ends[int]
    pairs: tuple[PictureMatches, ...]


@dataclass(frozen=True)
class InitialOverlap(Ends[float]):
    """Step 3: shares of the scans that lie within `slack_m` of each other under the initial pose."""

    slack_m: float


@dataclass(frozen=True)
class IcpEvidence:
    """Step 4 by ICP; points farther apart than `reach_m` did not pull."""

    rmse_m: float
    reach_m: float
    matched: int
    iterations: int
    converged: bool


@dataclass(frozen=True)
class PlaneEvidence:
    """One of the three planes; its rank is by points among all that were segmented."""

    normal: tuple[float, float, float]
    distance_m: float
    points: int
    rank: int
    thickness_m: float


@dataclass(frozen=True)
class PlanesEvidence(Ends[tuple[PlaneEvidence, ...]]):
    """Step 4 by planes: three of each scan, the corner where they meet, and the angles left between them."""

    corner_from: tuple[float, float, float]
    corner_to: tuple[float, float, float]
    segmented: Ends[int]
    leftover_deg: tuple[float, ...]
    tolerance_m: float


@dataclass(frozen=True)
class PaperEvidence:
    """All of it, as far as the pair came."""

    visual: VisualEvidence | None = None
    overlap_initial: InitialOverlap | None = None
    overlap_threshold: float | None = None
    icp: IcpEvidence | None = None
    planes: PlanesEvidence | None = None
