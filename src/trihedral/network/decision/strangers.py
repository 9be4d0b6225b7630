"""Links that lead a scan onto others of another storey or room."""

from dataclasses import replace

from trihedral.model.link import Link, LinkVerdict
from trihedral.network.decision.coherent_outliers import DECISIVE, Hold
from trihedral.network.decision.state import NetworkState, RuleOutcome
from trihedral.network.graph.connectivity import bridges, path


def reject_links_to_strangers(state: NetworkState) -> RuleOutcome:
    """Refuse links that put two scans in one place which do not fit there; those of the first such two.

    Where two scans do not look the same under a pose, or surfaces of one stand where the other saw empty space, and
    the network puts them there all the same, one of the links that lead from one to the other is wrong. Refused
    are those whose own appearance could not be compared, or, where surfaces contradict each other, that no loop checks.
    """
    strangers = [
        link
        for link in state.links
        if _looks_strange(state, link) or (link.contradicted and not link.accepted)
    ]
    if not strangers:
        return RuleOutcome(state)
    edges = state.loops.kept
    ends = [edge.ends for edge in edges]
    unchecked = bridges(len(state.stations), ends)
    for stranger in strangers:
        if not state.closes(state.offset_of(stranger)):
            continue
        way = path(len(state.stations), ends, *state.ends(stranger)) or []
        way = [k for k in way if not edges[k].locked]
        if stranger.contradicted:
            what = "surfaces there contradict each other"
            suspects = [state.link_at[ends[k]] for k in way if k in unchecked]
        else:
            what = "they do not look the same there"
            on_way = [state.link_at[ends[k]] for k in way]
            suspects = [index for index in on_way if state.links[index].appearance_similarity is None]
        if suspects:
            both = f"{stranger.from_station} and {stranger.to_station}"
            reason = f"it would put {both} in one place, and {what}"
            refused = {
                k: replace(state.links[k], verdict=LinkVerdict.REFUSED, reason=reason) for k in suspects
            }
            return RuleOutcome(state.with_links(refused))
    return RuleOutcome(state)


def doubt_strangers(state: NetworkState) -> RuleOutcome:
    """Doubt all stations of a component that puts two scans in one place which do not look the same there.

    Copies of a storey that look the same in part are told by the scans of it that do not; which of the links between
    are wrong is not told. The matter is decided where the fewest links that part the two scans (Ford and Fulkerson
    1956) are more than `DECISIVE` times the pairs that look otherwise across them.
    """
    strangers = [
        state.ends(link)
        for link in state.links
        if _looks_strange(state, link) and state.closes(state.offset_of(link))
    ]
    if not strangers:
        return RuleOutcome(state)
    kept = state.loops.kept
    hold = Hold(len(state.stations), kept, [False] * len(kept))
    doubts: dict[int, str] = {}
    for a, b in strangers:
        held, side = hold.cut({a}, {b})
        across = [(x, y) for x, y in strangers if (x in side) != (y in side)]
        if len(held) > DECISIVE * len(across) or any(kept[k].locked for k in held):
            continue
        inside = next(set(c.stations) for c in state.components if a in c.stations)
        both = f"{state.stations[a].name} and {state.stations[b].name}"
        doubts |= dict.fromkeys(inside, f"{both} would be in one place, and they do not look the same there")
    return RuleOutcome(state, doubts, frozenset(doubts))


def _looks_strange(state: NetworkState, link: Link) -> bool:
    """Whether colours differ; the law of intensity may be another in each scan."""
    found = link.evidence
    if found is None or not found.strange or found.by_intensity:
        return False
    similarity = found.appearance_similarity
    return similarity is not None and similarity < state.options.stranger_similarity
