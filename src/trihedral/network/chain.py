"""Scans chained into one frame along their best links, as the source paper does: no loops, no adjustment."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.se3 import inverse
from trihedral.model.link import Link
from trihedral.model.registration import Registration
from trihedral.model.station import Station, StationResult, StationStatus
from trihedral.network.solve import unplaced
from trihedral.progress import Progress, Silent

Float64 = NDArray[np.float64]


def chain(
    members: Sequence[Station], links: Sequence[Link], progress: Progress | None = None
) -> Registration:
    """Place the stations along the strongest accepted links.

    Each station hangs by one path of links from the one that has most of them, which defines the frame. No loop checks
    a path, so no station is verified.
    """
    progress = progress or Silent()
    progress.phase("Chaining links", 1, "", 1.0, "")
    names = [member.name for member in members]
    tree = _strongest_tree(names, links)
    parts = _parts(names, tree)
    stations: dict[str, StationResult] = {}
    by_name = {member.name: member for member in members}
    for component, part in enumerate(parts):
        if len(part) == 1 and len(members) > 1:
            stations[part[0]] = unplaced(by_name[part[0]], links)
            continue
        degree = {name: sum(name in (k.from_station, k.to_station) for k in tree) for name in part}
        anchor = max(part, key=lambda name: (degree[name], by_name[name].content))
        for name, (pose, path) in _hung(anchor, tree).items():
            member = by_name[name]
            reason = f"chained over {' - '.join(path)}; no loop checks it"
            if len(members) == 1:
                reason = "the only scan: it defines the frame"
            elif name == anchor:
                reason = "it defines the frame; no loop checks the links to it"
            if component > 0:
                reason = "in a part of the job that nothing ties to the largest one; its pose is in that part's frame"
            stations[name] = StationResult(
                name=name,
                header=member.header,
                points=member.points,
                pose=pose,
                tied=len(part) > 1,
                component=component,
                status=StationStatus.SINGLE_LINKED,
                reason=reason,
            )
    progress.advance(f"{len(members)} scans", 1.0)
    return Registration(tuple(stations[name] for name in names), tuple(links), ())


def _strongest_tree(names: Sequence[str], links: Sequence[Link]) -> list[Link]:
    """Accepted links without loops, the strongest first."""
    group = {name: name for name in names}
    tree = []
    usable = [link for link in links if link.accepted and link.transform is not None]
    for link in sorted(usable, key=lambda k: (-k.score, k.from_station, k.to_station)):
        a, b = group[link.from_station], group[link.to_station]
        if a != b:
            tree.append(link)
            group = {name: b if label == a else label for name, label in group.items()}
    return tree


def _parts(names: Sequence[str], tree: Sequence[Link]) -> list[list[str]]:
    """Connected parts, the largest first."""
    parts = [[name] for name in names]
    for link in tree:
        a, b = (next(p for p in parts if end in p) for end in (link.from_station, link.to_station))
        parts.remove(b)
        a.extend(b)
    return sorted(parts, key=lambda part: (-len(part), sorted(part)))


def _hung(anchor: str, tree: Sequence[Link]) -> dict[str, tuple[Float64, list[str]]]:
    """Pose ``anchor_from_station`` of each station and the stations on the way to it."""
    placed: dict[str, tuple[Float64, list[str]]] = {anchor: (np.eye(4), [anchor])}
    queue = [anchor]
    for here in queue:
        pose, path = placed[here]
        for link in tree:
            if link.transform is None:
                continue
            for there, step in (
                (link.from_station, link.transform),
                (link.to_station, inverse(link.transform)),
            ):
                if here in (link.from_station, link.to_station) and there not in placed:
                    placed[there] = (pose @ step, [*path, there])
                    queue.append(there)
    return placed
