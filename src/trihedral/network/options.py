"""How links are judged together."""

from dataclasses import dataclass, field

import numpy as np

from trihedral.errors import OptionError
from trihedral.network.adjustment.systematic import Systematic


@dataclass(frozen=True)
class ClosureOptions:
    """When a loop closes."""

    #: Sigmas of the expected closure error within which a loop closes.
    sigmas: float = 4.0
    #: Metres that are allowed whatever is expected: scans move while they are taken.
    translation: float = 0.03
    #: Radians that are allowed whatever is expected.
    rotation: float = np.radians(0.15)

    def __post_init__(self) -> None:
        if min(self.sigmas, self.translation, self.rotation) <= 0:
            raise OptionError("limits of closure must be positive")


@dataclass(frozen=True)
class NetworkOptions:
    """How links are judged together."""

    #: When a loop closes.
    closure: ClosureOptions = field(default_factory=ClosureOptions)
    #: Metres added to every link's covariance at the least: what moves between scans and what a scanner's calibration
    #: leaves is not in the noise of its points. Loops may show that it is more.
    systematic_translation: float = 0.0005
    #: Radians that are added in the same way.
    systematic_rotation: float = 2e-5
    #: Metres within which a link in doubt must agree with the poses that the others give to be accepted.
    confirmed_translation: float = 0.01
    #: Radians within which it must.
    confirmed_rotation: float = float(np.radians(0.05))
    #: Two scans whose appearance is less similar than this where their shapes agree are of different rooms.
    stranger_similarity: float = 0.5
    #: Probability from which a pose that loops outvote still speaks against where they put its two scans.
    outvoted_probability: float = 0.5

    def __post_init__(self) -> None:
        if min(self.systematic_translation, self.systematic_rotation) < 0:
            raise OptionError("what links err by beside their covariances must not be negative")
        if min(self.confirmed_translation, self.confirmed_rotation) <= 0:
            raise OptionError("limits within which links are confirmed must be positive")

    @property
    def systematic(self) -> Systematic:
        """What is assumed of all links."""
        return Systematic(self.systematic_translation, self.systematic_rotation)
