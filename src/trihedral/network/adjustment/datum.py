"""Poses of the stations of one connected part, in the frame that is known of it."""

from collections.abc import Mapping, Sequence

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import motion
from trihedral.model.registration import ControlMiss, Frame, LinkCheck
from trihedral.model.station import Station, StationResult, StationStatus
from trihedral.network.adjustment.adjustment import Adjusted, Facts, Given, Known, Plumb, Sighting, adjust
from trihedral.network.adjustment.systematic import Systematic
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.constraints.control_points import examine, misses
from trihedral.network.constraints.file_poses import filed_frame
from trihedral.network.graph.connectivity import blocks
from trihedral.network.graph.edge import Edge


class DatumAdjustment:
    """Places one part after the other, the largest first, and gathers what is said of all.

    Attributes
    ----------
    checks
        Of each link that took part, by the names of its ends.
    control
        What is left of control points.
    frame
        Of the largest part.
    """

    def __init__(
        self,
        members: Sequence[Station],
        constraints: Constraints,
        systematic: Systematic,
        doubts: Mapping[int, str],
    ) -> None:
        self.members = members
        self.constraints = constraints
        self.systematic = systematic
        self.doubts = doubts
        self.checks: dict[tuple[str, str], LinkCheck] = {}
        self.control: list[ControlMiss] = []
        self.frame: Frame | None = None
        self._facts = _facts(members, constraints)
        # The part whose frame others with constraints of their own share.
        self._common: int | None = None

    def placed(self, component: int, part: Sequence[int], inside: Sequence[Edge]) -> dict[int, StationResult]:
        """Stations of one part.

        Raises
        ------
        InputError
            Control points fit only with other axes or units.
        """
        degree = dict.fromkeys(part, 0)
        for edge in inside:
            degree[edge.a] += 1
            degree[edge.b] += 1
        block = blocks(len(self.members), [edge.ends for edge in inside])[0]
        core = set(block) if len(block) > 2 else set()
        anchor = max(core or part, key=lambda station: (degree[station], self.members[station].content))
        facts = self._facts.of(part)
        start = motion(None, self.members[anchor].header.scanner_origin)
        self._examine(anchor, inside, facts)
        adjusted = adjust(anchor, inside, facts, start)
        turned, frame = self._framed(anchor, adjusted, facts)
        datum = bool(facts.given or facts.known) and adjusted.free == 0
        if datum and self._common is None:
            self._common = component
        own = component
        component = self._common if datum and self._common is not None else component
        if own == 0:
            self.frame = frame
        self._note(adjusted, facts)
        fixed = {given.station for given in facts.given}
        stations = {}
        for station in part:
            verified = (station in core and station not in self.doubts) or station in fixed
            stations[station] = self._station(
                station, anchor, turned, adjusted, component, verified, len(part) > 1
            )
        return stations

    def _examine(self, anchor: int, inside: Sequence[Edge], facts: Facts) -> None:
        if facts.sightings:
            free = adjust(anchor, inside, poses_only=True)
            control = self.constraints.control
            examine(control.source, control.points, facts.sightings, free.poses)

    def _framed(self, anchor: int, adjusted: Adjusted, facts: Facts) -> tuple[Float64, Frame]:
        """Motion from the adjustment's frame to the project's, and what that is."""
        name = self.members[anchor].name
        text, turned = f"that of scan {name}, as it is in its file", np.eye(4)
        wish = self.constraints.coordinates
        if facts.given or facts.known:
            kinds = [("scans with given poses", facts.given), ("control points", facts.known)]
            text = "that of " + " and ".join(f"{len(of)} {what}" for what, of in kinds if of)
            if adjusted.free:
                text += f"; they leave {adjusted.free} of its 6 motions open, which scan {name} decides"
        elif wish != "new":
            found = {s: self._of_station(s, pose) for s, pose in adjusted.poses.items()}
            poses = {s: self.members[s].header.file_pose for s in found}
            filed = filed_frame(found, {s: pose for s, pose in poses.items() if pose is not None})
            if filed and (wish == "keep" or 2 * filed.agreeing > filed.stated):
                text = (
                    f"that of the poses in the files, which {filed.agreeing} of {filed.stated} scans agree with "
                    f"to {1e3 * filed.miss:.1f} mm"
                )
                turned = filed.project_from_frame
        if facts.plumb and not (facts.given or facts.known):
            text += f"; its z axis is the mean vertical of {len(facts.plumb)} scans"
        more = self.systematic
        return turned, Frame(
            text,
            self.constraints.crs,
            adjusted.unit_variance,
            more.translation,
            float(np.degrees(more.rotation)),
            more.scale,
        )

    def _note(self, adjusted: Adjusted, facts: Facts) -> None:
        names = [member.name for member in self.members]
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
        for miss in misses(points, facts.sightings, adjusted):
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
        return pose @ motion(None, -self.members[station].header.scanner_origin)

    def _station(
        self,
        station: int,
        anchor: int,
        turned: Float64,
        adjusted: Adjusted,
        component: int,
        verified: bool,
        tied: bool,
    ) -> StationResult:
        member = self.members[station]
        pose = self._of_station(station, turned @ adjusted.poses[station])
        turn = np.kron(np.eye(2), turned[:3, :3])
        covariance = turn @ adjusted.covariances[station] @ turn.T
        sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if station == anchor and adjusted.free == 6:
            # It defines the frame; the sliver that holds it there is no uncertainty.
            sigmas = np.zeros(6)
            if np.array_equal(turned, np.eye(4)):
                pose = np.eye(4)
        reason = None
        if len(self.members) == 1:
            reason = "the only scan: it defines the frame"
        elif not verified:
            reason = self.doubts.get(station, "one path of links leads to it; no loop checks it")
        if component > 0:
            reason = "in a part of the job that nothing ties to the largest one; its pose is in that part's own frame"
        return StationResult(
            name=member.name,
            header=member.header,
            points=member.points,
            pose=pose,
            tied=tied,
            component=component,
            status=StationStatus.VERIFIED if verified else StationStatus.SINGLE_LINKED,
            reason=reason,
            sigma_translation_m=_triple(sigmas[3:]),
            sigma_rotation_deg=_triple(np.degrees(sigmas[:3])),
        )


def _facts(members: Sequence[Station], constraints: Constraints) -> Facts:
    """What the constraints say, by numbers and about scanners."""
    number = {member.name: index for index, member in enumerate(members)}
    origin = [member.header.scanner_origin for member in members]
    given = []
    for fixed in constraints.fixed:
        station = number[fixed.station]
        pose = np.array(fixed.pose) @ motion(None, origin[station])
        sigmas = [fixed.sigma_rotation] * 3 + [fixed.sigma_translation] * 3
        given.append(Given(station, pose, np.diag(np.square(sigmas))))
    plumb = []
    if constraints.level is not None:
        names = constraints.level.stations or [member.name for member in members]
        plumb = [Plumb(number[name], constraints.level.sigma) for name in names]
    points = constraints.control.points
    place = {point.name: index for index, point in enumerate(points)}
    sightings = [
        Sighting(
            number[m.station],
            place[m.point],
            np.array(m.place) - origin[number[m.station]],
            np.array(m.sigma),
        )
        for m in constraints.control.measurements
    ]
    known = [
        Known(index, np.array(point.place), np.array(point.sigma))
        for index, point in enumerate(points)
        if not point.check
    ]
    return Facts(tuple(given), tuple(plumb), tuple(sightings), tuple(known))


def _triple(values: Float64) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
