"""Scans chained into one frame along their best links, as the source paper does: no loops, no adjustment."""

from collections.abc import Sequence

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import inverse
from trihedral.model.link import Link
from trihedral.model.registration import Registration
from trihedral.model.station import Station, StationResult, StationStatus
from trihedral.network.graph.chained_poses import chained_poses
from trihedral.network.graph.connectivity import Tree, components
from trihedral.network.solve import unplaced
from trihedral.progress import Progress, Silent


def chain(
    stations: Sequence[Station], links: Sequence[Link], progress: Progress | None = None
) -> Registration:
    """Place the stations along the strongest accepted links.

    Each station hangs by one path of links from the one that has most of them, which defines the frame. No loop checks
    a path, so no station is verified.
    """
    progress = progress or Silent()
    progress.phase("Chaining links", 1, "", 1.0, "")
    number = {station.name: index for index, station in enumerate(stations)}
    usable = [link for link in links if link.accepted and link.transform is not None]
    usable.sort(key=lambda link: (-link.score, link.from_station, link.to_station))
    ends = [(number[link.from_station], number[link.to_station]) for link in usable]
    tree = Tree(len(stations), ends, range(len(ends)))
    steps: dict[int, list[tuple[int, Float64]]] = {index: [] for index in range(len(stations))}
    for (a, b), link, inside in zip(ends, usable, tree.inside, strict=True):
        if inside and link.transform is not None:
            steps[b].append((a, link.transform))
            steps[a].append((b, inverse(link.transform)))
    found = components(len(stations), ends)
    found.sort(key=lambda component: (-len(component), sorted(stations[s].name for s in component)))
    results: dict[int, StationResult] = {}
    for component, inside in enumerate(found):
        if len(inside) == 1 and len(stations) > 1:
            results[inside[0]] = unplaced(stations[inside[0]], links)
            continue
        anchor = max(inside, key=lambda s: (len(steps[s]), stations[s].content))
        for station, pose in chained_poses(anchor, steps).items():
            path = " - ".join(stations[s].name for s in tree.walk(anchor, station))
            reason = f"chained over {path}; no loop checks it"
            if len(stations) == 1:
                reason = "the only scan: it defines the frame"
            elif station == anchor:
                reason = "it defines the frame; no loop checks the links to it"
            if component > 0:
                reason = "in a part of the job that nothing ties to the largest one; its pose is in that part's frame"
            results[station] = StationResult(
                name=stations[station].name,
                header=stations[station].header,
                points=stations[station].points,
                pose=pose,
                tied=len(inside) > 1,
                component=component,
                status=StationStatus.SINGLE_LINKED,
                reason=reason,
            )
    progress.advance(f"{len(stations)} scans", 1.0)
    return Registration(tuple(results[index] for index in range(len(stations))), tuple(links), ())
