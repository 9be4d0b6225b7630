"""Stations that links still have elsewhere, although they were given up."""

from trihedral.network.decision.coherent_outliers import DECISIVE, coherent_outliers
from trihedral.network.decision.contested_components import NOT_OUTVOTED, component_of
from trihedral.network.decision.state import NetworkState, RuleOutcome
from trihedral.network.graph.edge import Edge


def doubt_contested_stations(state: NetworkState) -> RuleOutcome:
    """Doubt stations that links which were given up have elsewhere, not clearly outvoted.

    What was given up bears out no pose, but counts for and against those that are left.
    """
    if not state.given_up:
        return RuleOutcome(state)
    kept, against = list(state.loops.kept), [edge for edge, _ in state.loops.refused]
    used, lost = [0] * len(state.stations), [0] * len(state.stations)
    for (a, b), index in state.link_at.items():
        link = state.links[index]
        for station in (a, b):
            used[station] += link.accepted
            lost[station] += index in state.given_up
        if index in state.given_up and link.transform is not None and link.covariance is not None:
            offset = state.offset_of(link)
            if offset is not None:
                edge = Edge(a, b, state.between_scanners(link, link.transform), link.covariance, 0.0)
                (kept if state.closes(offset) else against).append(edge)
    doubts: dict[int, str] = {}
    for one in coherent_outliers(len(state.stations), kept, against, state.poses, [False] * len(kept)):
        component = component_of(one, state.poses)
        side = (
            one.stations if 2 * len(one.stations & component) <= len(component) else component - one.stations
        )
        doubts |= dict.fromkeys(side, NOT_OUTVOTED)
    for station in range(len(state.stations)):
        if lost[station] and used[station] <= DECISIVE * lost[station]:
            doubts.setdefault(station, f"{lost[station]} of its links could not be told right from wrong")
    return RuleOutcome(state, doubts)
