"""From the links of a job to its result: links kept or refused, poses, and what may be believed of each station."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.motion import distance, inverse, motion
from trihedral.network.adjustment import adjust
from trihedral.network.consistency import Closure, ClosureOptions, Edge, Verdict, consistent
from trihedral.network.graph import blocks, parts, path
from trihedral.network.registration import Loop, Registration, Station, StationStatus
from trihedral.scan import ScanHeader
from trihedral.verdict import Link, LinkVerdict

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class NetworkOptions:
    """How links are judged together."""

    closure: ClosureOptions = field(default_factory=ClosureOptions)
    # Metres and radians added to every link's covariance: what moves between scans and what a scanner's calibration
    # leaves is not in the noise of its points (docs/method.md).
    systematic_translation: float = 0.0005
    systematic_rotation: float = 2e-5
    # A link in doubt is accepted if it is no farther from the poses that the others give: metres and radians.
    confirmed_translation: float = 0.01
    confirmed_rotation: float = float(np.radians(0.05))
    # Two scans whose looks go together less than this where their shapes agree are of different rooms.
    stranger_likeness: float = 0.5


@dataclass(frozen=True)
class Member:
    """A station of the network."""

    name: str
    header: ScanHeader
    points: int
    content: str  # hash of what it holds; decides where names and order must not


def solve(
    members: Sequence[Member], links: Sequence[Link], options: NetworkOptions | None = None
) -> Registration:
    """Place the stations.

    Links that were accepted are closed in loops, and those that contradict the others are refused. Then ambiguous and
    doubtful links that agree with what the others say are accepted too. The frame is that of the station with most
    links in the largest connected part.
    """
    options = options or NetworkOptions()
    number = {member.name: index for index, member in enumerate(members)}
    links = list(links)
    agreed = _judged(members, number, links, options)
    while _unmasked(members, number, links, agreed.kept, options):
        agreed = _judged(members, number, links, options)
    if _promoted(members, number, links, agreed.kept, options):
        agreed = _judged(members, number, links, options)
    edges = agreed.kept

    names = [member.name for member in members]
    place = _places(links)
    for edge, closure in agreed.refused:
        index = place[names[edge.a], names[edge.b]]
        walk = " - ".join(names[s] for s in closure.stations)
        miss = f"{1e3 * closure.translation:.0f} mm and {np.degrees(closure.rotation):.2f} deg"
        reason = f"the loop {walk} misses its start by {miss}"
        links[index] = replace(links[index], verdict=LinkVerdict.REFUSED, reason=reason)

    stations: list[Station | None] = [None] * len(members)
    for component, part, inside in _split(len(members), edges):
        if len(part) == 1 and len(members) > 1:
            member = members[part[0]]
            stations[part[0]] = unplaced(member, links)
            continue
        for index, station in _placed(members, part, inside, component).items():
            stations[index] = station
    return Registration(
        stations=tuple(station for station in stations if station is not None),
        links=tuple(links),
        loops=tuple(_loop(closure, names) for closure in agreed.closures),
    )


def _between_scanners(
    link: Link, members: Sequence[Member], number: Mapping[str, int], pose: Float64
) -> Float64:
    a, b = members[number[link.from_station]], members[number[link.to_station]]
    return motion(None, -b.header.scanner_origin) @ pose @ motion(None, a.header.scanner_origin)


def _judged(
    members: Sequence[Member], number: Mapping[str, int], links: Sequence[Link], options: NetworkOptions
) -> Verdict:
    systematic = np.diag([options.systematic_rotation**2] * 3 + [options.systematic_translation**2] * 3)
    edges = []
    for link in links:
        if link.accepted and link.transform is not None and link.covariance is not None:
            transform = _between_scanners(link, members, number, link.transform)
            a, b = number[link.from_station], number[link.to_station]
            edges.append(Edge(a, b, transform, link.covariance + systematic, link.evidence.get("score", 0.0)))
    return consistent(edges, options.closure)


def _promoted(
    members: Sequence[Member],
    number: Mapping[str, int],
    links: list[Link],
    edges: Sequence[Edge],
    options: NetworkOptions,
) -> bool:
    """Accept in place the links in doubt that agree with the poses that the others give; whether there were any."""
    poses = _poses(len(members), edges)
    found = False
    for index, link in enumerate(links):
        if link.verdict not in (LinkVerdict.AMBIGUOUS, LinkVerdict.DOUBTFUL):
            continue
        off = _off(link, members, number, poses)
        if off and off[0] <= options.confirmed_translation and off[1] <= options.confirmed_rotation:
            evidence = {**link.evidence, "confirmed_by_loops": 1.0}
            links[index] = replace(link, verdict=LinkVerdict.ACCEPTED, reason=None, evidence=evidence)
            found = True
    return found


def _unmasked(
    members: Sequence[Member],
    number: Mapping[str, int],
    links: list[Link],
    edges: Sequence[Edge],
    options: NetworkOptions,
) -> bool:
    """Refuse in place links that lead a scan onto others of another storey or room; whether there were any.

    Where two scans do not look the same under a pose, and the network puts them there all the same, one of the links
    that lead from one to the other is wrong: those of them whose own looks could not be compared are refused.
    """
    poses = _poses(len(members), edges)
    place = _places(links)
    for stranger in links:
        if not stranger.evidence.get("likeness", np.nan) < options.stranger_likeness:
            continue
        off = _off(stranger, members, number, poses)
        if not off or off[0] > options.closure.translation or off[1] > options.closure.rotation:
            continue
        ends = [edge.ends for edge in edges]
        way = path(len(members), ends, number[stranger.from_station], number[stranger.to_station]) or []
        suspects = [place[members[edges[k].a].name, members[edges[k].b].name] for k in way]
        suspects = [k for k in suspects if not np.isfinite(links[k].evidence.get("likeness", np.nan))]
        for index in suspects:
            both = f"{stranger.from_station} and {stranger.to_station}"
            reason = f"it would put {both} in one place, and they do not look the same there"
            links[index] = replace(links[index], verdict=LinkVerdict.REFUSED, reason=reason)
        if suspects:
            return True
    return False


def _poses(count: int, edges: Sequence[Edge]) -> dict[int, tuple[int, Float64]]:
    """Part and adjusted pose in it of each station that has a link."""
    poses: dict[int, tuple[int, Float64]] = {}
    for component, part, inside in _split(count, edges):
        if len(part) > 1:
            adjusted = adjust(part[0], inside).poses
            poses |= {station: (component, pose) for station, pose in adjusted.items()}
    return poses


def _split(count: int, edges: Sequence[Edge]) -> list[tuple[int, list[int], list[Edge]]]:
    """Number, stations and edges of each connected part, the largest first."""
    found = parts(count, [edge.ends for edge in edges])
    inside: list[list[Edge]] = [[] for _ in found]
    part_of = {station: component for component, part in enumerate(found) for station in part}
    for edge in edges:
        inside[part_of[edge.a]].append(edge)
    return [(component, part, inside[component]) for component, part in enumerate(found)]


def _off(
    link: Link,
    members: Sequence[Member],
    number: Mapping[str, int],
    poses: Mapping[int, tuple[int, Float64]],
) -> tuple[float, float] | None:
    """How far a link is from what the poses say (m, rad); None if they say nothing of it."""
    ends = [poses.get(number[name]) for name in (link.from_station, link.to_station)]
    if link.transform is None or ends[0] is None or ends[1] is None or ends[0][0] != ends[1][0]:
        return None
    expected = inverse(ends[1][1]) @ ends[0][1]
    return distance(expected, _between_scanners(link, members, number, link.transform))


def _places(links: Sequence[Link]) -> dict[tuple[str, str], int]:
    return {(link.from_station, link.to_station): index for index, link in enumerate(links)}


def _placed(
    members: Sequence[Member],
    part: Sequence[int],
    inside: Sequence[Edge],
    component: int,
) -> dict[int, Station]:
    degree = dict.fromkeys(part, 0)
    for edge in inside:
        degree[edge.a] += 1
        degree[edge.b] += 1
    block = blocks(len(members), [edge.ends for edge in inside])[0]
    core = set(block) if len(block) > 2 else set()
    anchor = max(core or part, key=lambda station: (degree[station], members[station].content))
    adjusted = adjust(anchor, inside)
    project_from_anchor = motion(None, members[anchor].header.scanner_origin)
    placed = {}
    for station in part:
        member = members[station]
        pose = project_from_anchor @ adjusted.poses[station] @ motion(None, -member.header.scanner_origin)
        sigmas = np.sqrt(np.maximum(np.diag(adjusted.covariances[station]), 0.0))
        if station == anchor:
            # It defines the frame; the sliver that holds it there is no uncertainty.
            pose, sigmas = np.eye(4), np.zeros(6)
        verified = station in core
        reason = None
        if len(members) == 1:
            reason = "the only scan: it defines the frame"
        elif not verified:
            reason = "one path of links leads to it; no loop checks it"
        if component > 0:
            reason = "in a part of the job that nothing ties to the largest one; its pose is in that part's own frame"
        placed[station] = Station(
            name=member.name,
            header=member.header,
            points=member.points,
            pose=pose,
            tied=len(part) > 1,
            component=component,
            status=StationStatus.VERIFIED if verified else StationStatus.SINGLE_LINKED,
            reason=reason,
            sigma_translation_m=_triple(sigmas[3:]),
            sigma_rotation_deg=_triple(np.degrees(sigmas[:3])),
        )
    return placed


def _triple(values: Float64) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def unplaced(member: Member, links: Sequence[Link]) -> Station:
    """The station of a scan that no link places, with the reason."""
    own = [link for link in links if member.name in (link.from_station, link.to_station)]
    ambiguous = any(link.verdict is LinkVerdict.AMBIGUOUS for link in own)
    best = max(
        own, key=lambda link: (link.transform is not None, link.evidence.get("score", 0.0)), default=None
    )
    reason = "no other scan was compared with it"
    if best is not None:
        other = best.to_station if best.from_station == member.name else best.from_station
        reason = f"no link was accepted; the best, with {other}: {best.reason}"
    return Station(
        name=member.name,
        header=member.header,
        points=member.points,
        pose=None,
        tied=False,
        component=None,
        status=StationStatus.AMBIGUOUS if ambiguous else StationStatus.NOT_PLACED,
        reason=reason,
    )


def _loop(closure: Closure, names: Sequence[str]) -> Loop:
    return Loop(
        stations=tuple(names[station] for station in closure.stations),
        translation_m=closure.translation,
        rotation_deg=float(np.degrees(closure.rotation)),
        expected_translation_m=closure.expected_translation,
        ok=closure.ok,
    )
