"""What an adjustment solves for: poses of scanners and places of control points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from trihedral.geometry.arrays import Float64


@dataclass(frozen=True)
class Unknowns:
    """Stations, then control points, each with what is found of it so far.

    A step of a pose is ``(omega, v)``: a rotation about axes of the frame through the scanner, and its displacement.
    """

    #: Their numbers in the job.
    stations: Sequence[int]
    points: Sequence[int]
    #: ``frame_from_scanner`` (N, 4, 4).
    poses: Float64
    #: (P, 3) metres.
    places: Float64

    @cached_property
    def of_station(self) -> dict[int, int]:
        """Number of the unknown that a station is."""
        return {station: index for index, station in enumerate(self.stations)}

    @cached_property
    def of_point(self) -> dict[int, int]:
        """Number of the unknown that a control point is."""
        return {point: len(self.stations) + index for index, point in enumerate(self.points)}

    @cached_property
    def sizes(self) -> list[int]:
        """Of each unknown."""
        return [6] * len(self.stations) + [3] * len(self.points)

    @cached_property
    def first(self) -> list[int]:
        """Row of each unknown in the normal equations; then how many there are."""
        return [0, *np.cumsum(self.sizes).tolist()]

    def pose(self, station: int) -> Float64:
        """Of a station, 4x4."""
        pose: Float64 = self.poses[self.of_station[station]]
        return pose

    def moved(self, step: Float64) -> "Unknowns":
        """After a step of all."""
        steps = step[: 6 * len(self.stations)].reshape(-1, 6)
        poses = self.poses.copy()
        poses[:, :3, :3] = Rotation.from_rotvec(steps[:, :3]).as_matrix() @ poses[:, :3, :3]
        poses[:, :3, 3] += steps[:, 3:]
        return replace(self, poses=poses, places=self.places + step[6 * len(self.stations) :].reshape(-1, 3))
