"""Options of plane matching."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trihedral.errors import OptionError


@dataclass(frozen=True)
class PlaneMatchingOptions:
    """How planes are found and when three of them will do."""

    #: "largest": the first three independent planes of each scan, whether or not they are the same walls;
    #: "consistent": the largest three of those that one motion near the initial alignment lays on each other.
    choice: Literal["consistent", "largest"] = "consistent"
    #: Metres from a plane within which points are its inliers.
    tolerance: float = 0.03
    #: Planes through three points that are tried for each that is found.
    candidates: int = 3000
    #: Planes that are segmented at the most before the search for three gives up.
    planes: int = 16
    #: Share of the points that a plane holds at least.
    least_share: float = 0.01
    #: Volume of the box that three unit normals span, at least: 1 for a right corner, 0 for planes without a corner.
    independence: float = 0.35
    #: Radians between paired normals after the initial alignment, at most.
    widest: float = np.radians(30.0)
    #: Metres between paired planes after the initial alignment, at most.
    farthest: float = 9.0
    #: The best pairing of three turns the normals by less than this share of what the next one does.
    distinctness: float = 0.7
    #: Planes that one motion lays on each other are within this angle of each other then, radians ...
    near_angle: float = np.radians(2.0)
    #: ... and within this distance, metres.
    near: float = 0.3

    def __post_init__(self) -> None:
        if self.choice not in ("consistent", "largest"):
            raise OptionError(f"planes are chosen as 'consistent' or 'largest', not {self.choice!r}")
        if min(self.tolerance, self.farthest, self.near) <= 0 or self.candidates < 1 or self.planes < 3:
            raise OptionError("plane matching needs positive distances, candidates, and at least 3 planes")
        if min(self.widest, self.near_angle) <= 0:
            raise OptionError("plane matching needs positive angles")
        if not (0 < self.independence < 1 and 0 < self.distinctness < 1 and 0 < self.least_share < 1):
            raise OptionError("independence, distinctness and least_share lie between 0 and 1")
