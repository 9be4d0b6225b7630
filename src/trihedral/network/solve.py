"""From the links of a job to its result: links kept or refused, poses, and what may be believed of each station."""

from collections.abc import Sequence

import numpy as np

from trihedral.model.link import Link, LinkVerdict
from trihedral.model.registration import Loop, Registration
from trihedral.model.station import Station, StationResult, StationStatus
from trihedral.network.adjustment.datum import DatumAdjustment
from trihedral.network.adjustment.surfaces import Surfaces, compared_anew
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.constraints.names import resolve
from trihedral.network.constraints.user_links import with_user_links
from trihedral.network.decision.loop_closure import Closure
from trihedral.network.decision.rules import decide
from trihedral.network.decision.state import NetworkState
from trihedral.network.options import NetworkOptions
from trihedral.progress import Progress, Silent


def solve(
    stations: Sequence[Station],
    links: Sequence[Link],
    options: NetworkOptions | None = None,
    constraints: Constraints | None = None,
    surfaces: Surfaces | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> Registration:
    """Place the stations.

    Rules decide which links count (`decide`). The frame is that of the constraints or of the files' poses, else that of
    the station with most links in the largest connected component.

    Parameters
    ----------
    surfaces
        Compares two stations' surfaces where all scans put them; without it, each link stays as its pair has it.
    progress
        Is told which step is at work, and each comparison of surfaces.
    threads
        Surfaces compared at once; by default as many as there are processors.

    Raises
    ------
    InputError
        The constraints name a scan that is not there, or control points whose axes or units are wrong.
    """
    options, progress = options or NetworkOptions(), progress or Silent()
    constraints = resolve(constraints or Constraints(), stations)
    progress.phase("Closing loops", 1, "", 1.0, "")
    given = with_user_links(constraints, links, stations)
    decision = decide(NetworkState.initial(stations, given, options, constraints))
    state = decision.state
    progress.advance(f"{len(links)} links", 1.0)
    edges = [component.edges for component in state.components]
    if surfaces is not None:
        looped = [c.number for c in state.components if len(c.edges) >= len(c.stations)]
        within, names = [edges[number] for number in looped], [station.name for station in stations]
        anew = compared_anew(within, surfaces, state.systematic, names, progress, threads)
        for number, found in zip(looped, anew, strict=True):
            edges[number] = found
    progress.phase("Adjusting all scans", len(edges), "parts", len(stations), "scans")
    datum = DatumAdjustment(stations, constraints, state.systematic, decision.doubts, decision.in_copies)
    results: dict[int, StationResult] = {}
    for component in state.components:
        first = component.stations[0]
        if len(component.stations) == 1 < len(stations) and first not in state.fixed:
            results[first] = unplaced(stations[first], state.links)
        else:
            results |= datum.placed(component.number, component.stations, edges[component.number])
        progress.advance(f"{len(component.stations)} scans", len(component.stations))
    return Registration(
        stations=tuple(results[index] for index in range(len(stations))),
        links=state.links,
        loops=tuple(_loop(closure, stations) for closure in state.loops.closures),
        checks=datum.checks,
        control=tuple(datum.control),
        frame=datum.frame,
    )


def believed(
    stations: Sequence[Station], links: Sequence[Link], options: NetworkOptions, constraints: Constraints
) -> list[Link]:
    """Links as `solve` would leave them: which of them are accepted once all are judged together.

    Parameters
    ----------
    links
        With what the constraints decide of them (`with_user_links`); these are resolved.
    """
    return list(decide(NetworkState.initial(stations, links, options, constraints)).state.links)


def unplaced(station: Station, links: Sequence[Link]) -> StationResult:
    """The result of a scan that no link places, with the reason."""
    own = [link for link in links if station.name in (link.from_station, link.to_station)]
    ambiguous = any(link.verdict is LinkVerdict.AMBIGUOUS for link in own)
    best = max(own, key=lambda link: (link.transform is not None, link.score), default=None)
    reason = "no other scan was compared with it"
    if best is not None:
        other = best.to_station if best.from_station == station.name else best.from_station
        reason = f"no link was accepted; the best, with {other}: {best.reason}"
    return StationResult(
        name=station.name,
        header=station.header,
        points=station.points,
        pose=None,
        tied=False,
        component=None,
        status=StationStatus.AMBIGUOUS if ambiguous else StationStatus.NOT_PLACED,
        reason=reason,
    )


def _loop(closure: Closure, stations: Sequence[Station]) -> Loop:
    return Loop(
        stations=tuple(stations[station].name for station in closure.stations),
        translation_m=closure.translation,
        rotation_deg=float(np.degrees(closure.rotation)),
        expected_translation_m=closure.expected_translation,
        ok=closure.ok,
        expected_rotation_deg=float(np.degrees(closure.expected_rotation)),
    )
