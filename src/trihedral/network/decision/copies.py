"""Stations that may stand in a copy of their room or storey."""

from trihedral.network.decision.state import NetworkState, RuleOutcome
from trihedral.network.graph.connectivity import components
from trihedral.network.graph.edge import Edge

_UNSEEN = "nothing is known of its appearance, and scans of this job fit in copies of a place"
_LOOKALIKES = (
    "scans of this job fit in several places that look the same, and it may stand in another of them"
)


def doubt_copies(state: NetworkState) -> RuleOutcome:
    """Doubt stations that only links tie which a copy would bear out as well, in a place that has copies.

    Copies agree with each other, so loops over such links speak against none: links under a ceiling whose appearance
    could not be compared, and all links under a ceiling where scans of the job fit in places that look the same. What
    other links tie together stands in one of them; the largest such group of a component says which.
    """
    doubts: dict[int, str] = {}
    for component in state.components if state.has_copies or state.has_lookalikes else ():
        told = [
            edge.ends
            for edge in component.edges
            if edge.between_priors or edge.locked or not _may_be_of_a_copy(state, edge)
        ]
        inside = component.stations
        groups = components(len(state.stations), told)
        held = next((group for group in groups if group[0] in inside), inside)
        apart = set(inside) - set(held) if len(held) > 1 else set(inside)
        why = _LOOKALIKES if state.has_lookalikes else _UNSEEN
        doubts |= dict.fromkeys(apart, why)
    return RuleOutcome(state, doubts, frozenset(doubts))


def _may_be_of_a_copy(state: NetworkState, edge: Edge) -> bool:
    link = state.links[state.link_at[edge.ends]]
    return (state.has_copies and link.unseen) or (state.has_lookalikes and (link.unseen or link.looks_alike))
