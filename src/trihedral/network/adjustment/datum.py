"""The datum of an adjustment: the frame that is known of a component, and the poses of its stations in it."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import motion, rotation_between, translation
from trihedral.model.registration import ControlMiss, Frame, LinkCheck
from trihedral.model.station import Station, StationResult, StationStatus
from trihedral.network.adjustment.adjustment import Adjusted, adjust
from trihedral.network.adjustment.observations import (
    Level,
    Observations,
    PointObservation,
    PointPrior,
    PosePrior,
)
from trihedral.network.adjustment.systematic import Systematic
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.constraints.control_points import examine, misses
from trihedral.network.constraints.file_poses import file_frame
from trihedral.network.graph.connectivity import blocks
from trihedral.network.graph.edge import Edge
from trihedral.scan.mounting import LEANING, Z


class DatumAdjustment:
    """Adjusts one component after the other, the largest first, and gathers what is said of all.

    Attributes
    ----------
    checks
        Of each link that took part, by the names of its ends.
    control
        What is left of control points.
    frame
        Of the largest component.
    """

    def __init__(
        self,
        stations: Sequence[Station],
        constraints: Constraints,
        systematic: Systematic,
        doubts: Mapping[int, str],
        in_copies: frozenset[int] = frozenset(),
    ) -> None:
        self.stations = stations
        self.constraints = constraints
        self.systematic = systematic
        self.doubts = doubts
        self.in_copies = in_copies
        self.checks: dict[tuple[str, str], LinkCheck] = {}
        self.control: list[ControlMiss] = []
        self.frame: Frame | None = None
        self._observations = _observations(stations, constraints)
        # The component whose frame others with constraints of their own share.
        self._common: int | None = None

    def placed(
        self, component: int, inside: Sequence[int], edges: Sequence[Edge]
    ) -> dict[int, StationResult]:
        """Results of the stations of one component.

        Raises
        ------
        InputError
            Control points fit only with other axes or units.
        """
        degree = Counter(end for edge in edges for end in edge.ends)
        block = blocks(len(self.stations), [edge.ends for edge in edges])[0]
        core = set(block) if len(block) > 2 else set()
        anchor = max(core or inside, key=lambda station: (degree[station], self.stations[station].content))
        observations = self._observations.of(inside)
        if observations.points:
            free = adjust(anchor, edges, poses_only=True)
            control = self.constraints.control
            examine(control.source, control.points, observations.points, free.poses)
        start = translation(self.stations[anchor].header.scanner_origin)
        adjusted = adjust(anchor, edges, observations, start)
        turned, frame = self._framed(anchor, adjusted, observations)
        if component == 0:
            self.frame = frame
        if observations.fix_frame and adjusted.free == 0:
            self._common = component if self._common is None else self._common
            component = self._common
        self._note(adjusted, observations)
        fixed = {prior.station for prior in observations.pose_priors}
        results = {}
        for station in inside:
            pose, covariance = self._turned(station, turned, adjusted)
            if station == anchor and adjusted.free == 6:
                # It defines the frame; the sliver that holds it there is no uncertainty.
                pose = np.eye(4) if np.array_equal(turned, np.eye(4)) else pose
                covariance = np.zeros((6, 6))
            verified = (station in core and station not in self.doubts) or station in fixed
            results[station] = self._result(station, pose, covariance, component, verified, len(inside) > 1)
        return results

    def _framed(self, anchor: int, adjusted: Adjusted, observations: Observations) -> tuple[Float64, Frame]:
        """Motion from the adjustment's frame to the project's, and what that is."""
        name = self.stations[anchor].name
        text, turned = f"that of scan {name}, as it is in its file", np.eye(4)
        wish = self.constraints.coordinates
        if observations.fix_frame:
            kinds = [
                ("scans with given poses", observations.pose_priors),
                ("control points", observations.point_priors),
            ]
            text = "that of " + " and ".join(f"{len(of)} {what}" for what, of in kinds if of)
            if adjusted.free:
                text += f"; they leave {adjusted.free} of its 6 motions open, which scan {name} decides"
        elif wish != "new":
            found = {s: self._of_station(s, pose) for s, pose in adjusted.poses.items()}
            poses = {s: self.stations[s].header.file_pose for s in found}
            of_files = file_frame(found, {s: pose for s, pose in poses.items() if pose is not None})
            if of_files and (wish == "keep" or 2 * of_files.agreeing > of_files.stated):
                text = (
                    f"that of the poses in the files, which {of_files.agreeing} of {of_files.stated} scans agree with "
                    f"to {1e3 * of_files.miss:.1f} mm"
                )
                turned = of_files.project_from_frame
        # Its z axis is up whatever way this scanner is mounted, unless something else says what z is.
        if not observations.fix_frame and not observations.levels and np.array_equal(turned, np.eye(4)):
            upright = self._upright(anchor, adjusted)
            if upright is not None:
                text, turned = f"that of scan {name}, set upright", motion(upright)
        if observations.levels and not observations.fix_frame:
            text += f"; its z axis is the mean vertical of {len(observations.levels)} scans"
        more = self.systematic
        return turned, Frame(
            text,
            self.constraints.crs,
            adjusted.unit_variance,
            more.translation,
            float(np.degrees(more.rotation)),
            more.scale,
        )

    def _upright(self, anchor: int, adjusted: Adjusted) -> Float64 | None:
        """Rotation that sets the frame upright, as most of its scans have it; None where it is."""
        known = {s: self.stations[s].header.upright_from_scanner for s in adjusted.poses}
        standing = [s for s, upright in known.items() if upright is None]
        if 2 * len(standing) < len(known):
            return known[anchor]
        up = np.sum([adjusted.poses[s][:3, 2] for s in standing], axis=0)
        # Scanners that lean leave the frame as it is.
        if 2 * len(standing) == len(known) or up[2] >= np.cos(LEANING) * np.linalg.norm(up):
            return None
        return rotation_between(up / np.linalg.norm(up), Z)

    def _note(self, adjusted: Adjusted, observations: Observations) -> None:
        names = [station.name for station in self.stations]
        for (a, b), check in adjusted.checks.items():
            self.checks[names[a], names[b]] = LinkCheck(
                redundancy=check.redundancy,
                residual_m=float(np.linalg.norm(check.residual[3:])),
                residual_deg=float(np.degrees(np.linalg.norm(check.residual[:3]))),
                standardised=check.standardised,
                moves_m=check.moves,
                moves_station=None if check.moves_station is None else names[check.moves_station],
            )
        points = self.constraints.control.points
        for miss in misses(points, observations.points, adjusted):
            self.control.append(
                ControlMiss(
                    point=points[miss.point].name,
                    station=names[miss.station],
                    check=miss.check,
                    residual_m=_triple(miss.residual),
                    sigma_m=_triple(miss.sigma),
                    standardised=miss.standardised,
                )
            )

    def _of_station(self, station: int, pose: Float64) -> Float64:
        """``frame_from_station`` of ``frame_from_scanner``."""
        return pose @ translation(-self.stations[station].header.scanner_origin)

    def _turned(self, station: int, turned: Float64, adjusted: Adjusted) -> tuple[Float64, Float64]:
        """``project_from_station`` and the covariance (6, 6) of its scanner's pose."""
        pose = self._of_station(station, turned @ adjusted.poses[station])
        turn = np.kron(np.eye(2), turned[:3, :3])
        return pose, turn @ adjusted.covariances[station] @ turn.T

    def _status(self, number: int, verified: bool) -> StationStatus:
        if verified:
            return StationStatus.VERIFIED
        # What may as well stand in a copy of its place is no result that passes, however well its links fit.
        return StationStatus.AMBIGUOUS if number in self.in_copies else StationStatus.SINGLE_LINKED

    def _result(
        self, number: int, pose: Float64, covariance: Float64, component: int, verified: bool, tied: bool
    ) -> StationResult:
        reason = None
        if len(self.stations) == 1:
            reason = "the only scan: it defines the frame"
        elif not verified:
            reason = self.doubts.get(number, "one path of links leads to it; no loop checks it")
        if component > 0:
            reason = "in a part of the job that nothing ties to the largest one; its pose is in that part's own frame"
        station, sigmas = self.stations[number], np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return StationResult(
            name=station.name,
            header=station.header,
            points=station.points,
            pose=pose,
            tied=tied,
            component=component,
            status=self._status(number, verified),
            reason=reason,
            sigma_translation_m=_triple(sigmas[3:]),
            sigma_rotation_deg=_triple(np.degrees(sigmas[:3])),
        )


def _observations(stations: Sequence[Station], constraints: Constraints) -> Observations:
    """What the constraints say, by numbers and about scanners."""
    number = {station.name: index for index, station in enumerate(stations)}
    origin = [station.header.scanner_origin for station in stations]
    priors = []
    for fixed in constraints.fixed:
        station = number[fixed.station]
        pose = np.array(fixed.pose) @ translation(origin[station])
        sigmas = [fixed.sigma_rotation] * 3 + [fixed.sigma_translation] * 3
        priors.append(PosePrior(station, pose, np.diag(np.square(sigmas))))
    levels = []
    if constraints.level is not None:
        names = constraints.level.stations or [station.name for station in stations]
        levels = [Level(number[name], constraints.level.sigma) for name in names]
    point_of = {point.name: index for index, point in enumerate(constraints.control.points)}
    points = [
        PointObservation(
            number[m.station],
            point_of[m.point],
            np.array(m.place) - origin[number[m.station]],
            np.array(m.sigma),
        )
        for m in constraints.control.measurements
    ]
    known = [
        PointPrior(point_of[point.name], np.array(point.place), np.array(point.sigma))
        for point in constraints.control.points
        if not point.check
    ]
    return Observations(tuple(priors), tuple(levels), tuple(points), tuple(known))


def _triple(values: Float64) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
