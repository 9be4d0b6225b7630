"""What is known beside the links, each kind with its observation equations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import skew
from trihedral.network.adjustment.unknowns import Unknowns


@dataclass(frozen=True)
class Equation:
    """An observation, made linear about the unknowns so far.

    `jacobians` are those of its `unknowns`, `residual` is observed less adjusted.
    """

    unknowns: list[int]
    jacobians: list[Float64]
    residual: Float64
    information: Float64


@dataclass(frozen=True)
class PosePrior:
    """A pose that is given: ``project_from_scanner`` and its 6x6 covariance, as those of `Adjusted`."""

    station: int
    pose: Float64
    covariance: Float64

    def equation(self, unknowns: Unknowns) -> Equation:
        """All of the pose, observed."""
        pose = unknowns.pose(self.station)
        turn = Rotation.from_matrix(self.pose[:3, :3] @ pose[:3, :3].T).as_rotvec()
        residual = np.concatenate([turn, self.pose[:3, 3] - pose[:3, 3]])
        information: Float64 = np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)
        return Equation([unknowns.of_station[self.station]], [np.eye(6)], residual, information)


@dataclass(frozen=True)
class Level:
    """A station whose z axis is vertical within sigma (rad)."""

    station: int
    sigma: float

    def equation(self, unknowns: Unknowns) -> Equation:
        """How far the axis leans along x and y."""
        x, y, _ = unknowns.pose(self.station)[:3, 2]
        # As for an axis that is upright: what it leans by must not tell a turn about the vertical.
        jacobian = np.zeros((2, 6))
        jacobian[0, 1], jacobian[1, 0] = 1.0, -1.0
        at = unknowns.of_station[self.station]
        return Equation([at], [jacobian], -np.array([x, y]), np.eye(2) / self.sigma**2)


@dataclass(frozen=True)
class PointObservation:
    """A control point as a scan shows it: its place from the scanner, in the scanner's axes."""

    station: int
    point: int
    place: Float64  # (3,) metres
    sigma: Float64  # (3,) metres

    def jacobian(self, pose: Float64) -> Float64:
        """How the point's place in the frame follows the pose, (3, 6)."""
        return np.concatenate([-skew(pose[:3, :3] @ self.place), np.eye(3)], axis=1)

    def seen(self, pose: Float64) -> Float64:
        """Place in the frame."""
        return pose[:3, :3] @ self.place + pose[:3, 3]

    def equation(self, unknowns: Unknowns) -> Equation:
        """Where the scan shows the point, against where the point is."""
        at, point = unknowns.of_station[self.station], unknowns.of_point[self.point]
        pose = unknowns.poses[at]
        residual: Float64 = unknowns.places[point - len(unknowns.stations)] - self.seen(pose)
        information: Float64 = pose[:3, :3] @ np.diag(1 / self.sigma**2) @ pose[:3, :3].T
        return Equation([at, point], [self.jacobian(pose), -np.eye(3)], residual, information)


@dataclass(frozen=True)
class PointPrior:
    """A control point whose project coordinates are known."""

    point: int
    place: Float64  # (3,) metres
    sigma: Float64  # (3,) metres

    def equation(self, unknowns: Unknowns) -> Equation:
        """The coordinates, observed."""
        point = unknowns.of_point[self.point]
        off: Float64 = self.place - unknowns.places[point - len(unknowns.stations)]
        return Equation([point], [np.eye(3)], off, np.diag(1 / self.sigma**2))


@dataclass(frozen=True)
class Observations:
    """What is known beside the links; the frame keeps what they leave open."""

    pose_priors: tuple[PosePrior, ...] = ()
    levels: tuple[Level, ...] = ()
    points: tuple[PointObservation, ...] = ()
    point_priors: tuple[PointPrior, ...] = ()

    @property
    def fix_frame(self) -> bool:
        """Whether something is known in the project's frame."""
        return bool(self.pose_priors or self.point_priors)

    def of(self, stations: Sequence[int]) -> "Observations":
        """Those that speak of some stations."""
        inside = set(stations)
        points = tuple(p for p in self.points if p.station in inside)
        seen = {p.point for p in points}
        return Observations(
            tuple(p for p in self.pose_priors if p.station in inside),
            tuple(level for level in self.levels if level.station in inside),
            points,
            tuple(p for p in self.point_priors if p.point in seen),
        )

    def equations(self, unknowns: Unknowns) -> list[Equation]:
        """Of all; a point that a scan shows counts where its coordinates are known."""
        used = [p for p in self.points if p.point in unknowns.of_point]
        kinds: tuple[Sequence[PosePrior | Level | PointObservation | PointPrior], ...]
        kinds = self.pose_priors, self.levels, used, self.point_priors
        return [one.equation(unknowns) for kind in kinds for one in kind]
