"""Stations that may stand in a copy of their room or storey."""

from trihedral.network.decision.state import NetworkState, RuleOutcome
from trihedral.network.graph.connectivity import components


def doubt_copies(state: NetworkState) -> RuleOutcome:
    """Doubt stations that only links tie whose appearance could not be compared, in a place that has copies.

    Copies agree with each other, so loops over links under a ceiling whose appearance could not be compared speak
    against none. What other links tie together stands in one of them; the largest such group of a component says which.
    """
    doubts: dict[int, str] = {}
    for component in state.components if state.has_copies else ():
        told = [
            edge.ends
            for edge in component.edges
            if edge.between_priors or edge.locked or not state.links[state.link_at[edge.ends]].unseen
        ]
        inside = component.stations
        groups = components(len(state.stations), told)
        held = next((group for group in groups if group[0] in inside), inside)
        apart = set(inside) - set(held) if len(held) > 1 else set(inside)
        why = "nothing is known of its appearance, and scans of this job fit in copies of a place"
        doubts |= dict.fromkeys(apart, why)
    return RuleOutcome(state, doubts)
