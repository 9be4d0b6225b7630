"""From the links of a job to its result: links kept or refused, poses, and what may be believed of each station."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.motion import distance, inverse, motion
from trihedral.network.adjustment import adjust
from trihedral.network.consistency import Closure, ClosureOptions, Edge, consistent
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
    edges, refused, closures = _judged(members, number, links, options)
    while _unmasked(members, number, links, edges, options):
        edges, refused, closures = _judged(members, number, links, options)
    promoted = _promoted(members, number, links, edges, options)
    if promoted:
        edges, refused, closures = _judged(members, number, links, options)

    names = [member.name for member in members]
    for edge, closure in refused:
        index = _index_of(links, names[edge.a], names[edge.b])
        walk = " - ".join(names[s] for s in closure.stations)
        miss = f"{1e3 * closure.translation:.0f} mm and {np.degrees(closure.rotation):.2f} deg"
        reason = f"the loop {walk} misses its start by {miss}"
        links[index] = replace(links[index], verdict=LinkVerdict.REFUSED, reason=reason)

    parts = _parts(len(members), edges)
    stations: list[Station | None] = [None] * len(members)
    for component, part in enumerate(parts):
        if len(part) == 1 and len(members) > 1:
            member = members[part[0]]
            stations[part[0]] = unplaced(member, links)
            continue
        for index, station in _placed(members, part, edges, component).items():
            stations[index] = station
    return Registration(
        stations=tuple(station for station in stations if station is not None),
        links=tuple(links),
        loops=tuple(_loop(closure, names) for closure in closures),
    )


def _between_scanners(
    link: Link, members: Sequence[Member], number: Mapping[str, int], pose: Float64
) -> Float64:
    a, b = members[number[link.from_station]], members[number[link.to_station]]
    return motion(None, -b.header.scanner_origin) @ pose @ motion(None, a.header.scanner_origin)


def _judged(
    members: Sequence[Member], number: Mapping[str, int], links: Sequence[Link], options: NetworkOptions
) -> tuple[list[Edge], list[tuple[Edge, Closure]], list[Closure]]:
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
    for stranger in links:
        if not stranger.evidence.get("likeness", np.nan) < options.stranger_likeness:
            continue
        off = _off(stranger, members, number, poses)
        if not off or off[0] > options.closure.translation or off[1] > options.closure.rotation:
            continue
        path = _path(number[stranger.from_station], number[stranger.to_station], edges)
        suspects = [_index_of(links, members[edge.a].name, members[edge.b].name) for edge in path]
        suspects = [k for k in suspects if not np.isfinite(links[k].evidence.get("likeness", np.nan))]
        for index in suspects:
            ends = f"{stranger.from_station} and {stranger.to_station}"
            reason = f"it would put {ends} in one place, and they do not look the same there"
            links[index] = replace(links[index], verdict=LinkVerdict.REFUSED, reason=reason)
        if suspects:
            return True
    return False


def _poses(count: int, edges: Sequence[Edge]) -> dict[int, tuple[int, Float64]]:
    """Part and adjusted pose in it of each station that has a link."""
    poses: dict[int, tuple[int, Float64]] = {}
    for part_number, part in enumerate(_parts(count, edges)):
        if len(part) > 1:
            inside = [edge for edge in edges if edge.a in part]
            adjusted, _ = adjust(part[0], inside)
            poses |= {station: (part_number, pose) for station, pose in adjusted.items()}
    return poses


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


def _path(start: int, end: int, edges: Sequence[Edge]) -> list[Edge]:
    """Fewest edges from one station to another, which they connect."""
    came: dict[int, Edge | None] = {start: None}
    queue = [start]
    for here in queue:
        for edge in edges:
            for near, far in ((edge.a, edge.b), (edge.b, edge.a)):
                if near == here and far not in came:
                    came[far] = edge
                    queue.append(far)
    path = []
    here, step = end, came[end]
    while step is not None:
        path.append(step)
        here = step.a if step.b == here else step.b
        step = came[here]
    return path


def _index_of(links: Sequence[Link], a: str, b: str) -> int:
    return next(i for i, link in enumerate(links) if (link.from_station, link.to_station) == (a, b))


def _parts(count: int, edges: Sequence[Edge]) -> list[list[int]]:
    """Connected parts, the largest first."""
    part = list(range(count))
    for _ in range(count):
        before = list(part)
        for edge in edges:
            part[edge.a] = part[edge.b] = min(part[edge.a], part[edge.b])
        if part == before:
            break
    groups: dict[int, list[int]] = {}
    for station, label in enumerate(part):
        groups.setdefault(label, []).append(station)
    return sorted(groups.values(), key=lambda group: (-len(group), group))


def _bridges_removed(part: Sequence[int], edges: Sequence[Edge]) -> list[list[int]]:
    """Groups of stations that stay connected whichever single link is taken away."""
    kept = list(edges)
    for edge in edges:
        without = [other for other in edges if other is not edge]
        label = {station: station for station in part}
        changed = True
        while changed:
            changed = False
            for other in without:
                low = min(label[other.a], label[other.b])
                changed |= label[other.a] != low or label[other.b] != low
                label[other.a] = label[other.b] = low
        if label[edge.a] != label[edge.b]:
            kept.remove(edge)
    return [[part[i] for i in group] for group in _parts(len(part), _renumbered(part, kept))]


def _renumbered(part: Sequence[int], edges: Sequence[Edge]) -> list[Edge]:
    place = {station: index for index, station in enumerate(part)}
    return [replace(edge, a=place[edge.a], b=place[edge.b]) for edge in edges]


def _placed(
    members: Sequence[Member],
    part: Sequence[int],
    edges: Sequence[Edge],
    component: int,
) -> dict[int, Station]:
    inside = [edge for edge in edges if edge.a in part]
    degree = {station: sum(station in (edge.a, edge.b) for edge in inside) for station in part}
    blocks = _bridges_removed(part, inside)
    core = set(blocks[0]) if len(blocks[0]) > 2 else set()
    anchor = max(core or part, key=lambda station: (degree[station], members[station].content))
    poses, covariances = (
        adjust(anchor, inside) if inside else ({anchor: np.eye(4)}, {anchor: np.zeros((6, 6))})
    )
    project_from_anchor = motion(None, members[anchor].header.scanner_origin)
    placed = {}
    for station in part:
        member = members[station]
        pose = project_from_anchor @ poses[station] @ motion(None, -member.header.scanner_origin)
        sigmas = np.sqrt(np.maximum(np.diag(covariances[station]), 0.0))
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
