"""Links that loops gave another pose than their scans make likely."""

from trihedral.network.decision.coherent_outliers import DECISIVE
from trihedral.network.decision.state import NetworkState, RuleOutcome


def doubt_outvoted_poses(state: NetworkState) -> RuleOutcome:
    """Doubt stations with a link that by itself would have another pose, and few links that hold by themselves."""
    holding = [0] * len(state.stations)
    for edge in state.loops.kept:
        if edge.between_priors or not state.links[state.link_at[edge.ends]].confirmed_by_loops:
            holding[edge.a] += 1
            holding[edge.b] += 1
    doubts: dict[int, str] = {}
    for index in sorted(state.outvoted - state.given_up):
        link = state.links[index]
        for station in state.ends(link):
            if link.accepted and holding[station] <= DECISIVE:
                names = f"{link.from_station} - {link.to_station}"
                doubts[station] = f"link {names} by itself would have it elsewhere"
    return RuleOutcome(state, doubts)
