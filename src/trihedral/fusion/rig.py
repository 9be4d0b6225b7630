"""A rig: line scanners and cameras on a body that turns about an upright axis."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.se3 import Matrix
from trihedral.scan import CameraModel


@dataclass(frozen=True)
class LineScanner:
    """A line scanner on the body."""

    name: str
    #: Eq. (1): distance of its centre from the axis and height of its centre, metres.
    d: float
    h: float
    #: 4x4 that turns and shifts what Eq. (1) gives at body angle zero; a scanner on another arm is turned about
    #: z, a scanner that leans is turned about x or y.
    body_from_mounting: Matrix = field(default_factory=lambda: np.eye(4))

    @property
    def centre(self) -> Matrix:
        """(3,) the scanner's centre on the body, metres."""
        return np.asarray(self.body_from_mounting[:3] @ np.array([self.d, 0.0, self.h, 1.0]))

    @property
    def arm(self) -> float:
        """Direction of the arm on the body (rad)."""
        return math.atan2(self.body_from_mounting[1, 0], self.body_from_mounting[0, 0])


@dataclass(frozen=True)
class Profiles:
    """What one line scanner measured while the body turned."""

    scanner: LineScanner
    #: (P,) of each profile, rad.
    body_angles: NDArray[np.float64]
    #: (B,) of each beam, rad.
    beam_angles: NDArray[np.float64]
    #: (P, B) float32, metres; 0 where there was no return.
    ranges: NDArray[np.float32]
    #: (P, B) float32, any scale, or None.
    intensity: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class RigCamera:
    """A camera on the body."""

    name: str
    model: CameraModel
    #: 4x4; camera axes x right, y down, z along the view.
    body_from_camera: Matrix


def same_grid(scanners: list[LineScanner], beam_step: float) -> bool:
    """Whether scanners that differ in their arm sweep the same directions, within a step between beams (rad).

    Then their profiles interleave by the direction of the arm, and neighbours in that order are neighbours in space.
    """
    first = scanners[0]

    def upright(one: LineScanner) -> Matrix:
        c, s = math.cos(-one.arm), math.sin(-one.arm)
        turned: Matrix = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.column_stack(
            [one.body_from_mounting[:3, :3], one.centre]
        )
        return turned

    reference = upright(first)
    for one in scanners[1:]:
        difference = np.abs(upright(one) - reference)
        # Centres that are a hand apart look along different rays at what is near.
        if difference[:, :3].max() > beam_step or difference[:, 3].max() > 0.02:
            return False
    return True
