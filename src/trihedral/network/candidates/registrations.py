"""Pairs to register."""

from trihedral.model.link import LinkVerdict
from trihedral.network.candidates.expected_overlap import expected_shares, shares_under
from trihedral.network.candidates.state import Pair, Reasons, SearchState, ordered


def promising(state: SearchState) -> Reasons:
    """Pairs that a preview bore out, the best first, as far as links are wanted."""
    borne_out = [
        pair
        for pair, preview in state.previews.items()
        if pair not in state.links and state.bears_out(preview)
    ]
    best = sorted(borne_out, key=lambda pair: (-state.previews[pair].score, state.content(pair)))
    return [
        (pair, f"a preview found a pose with score {state.previews[pair].score:.2f}")
        for pair in state.as_needed(best)
    ]


def expected(state: SearchState) -> Reasons:
    """Pairs that the poses put beside each other, where a scan has few links or a single link holds two groups."""
    options, shares = state.options, expected_shares(state)
    best = sorted(shares, key=lambda pair: (-shares[pair], state.content(pair)))
    wanted = state.as_needed([pair for pair in best if shares[pair] >= options.least_expected])
    for side in state.sides:
        across = [pair for pair in best if (pair[0] in side) != (pair[1] in side)]
        vain = sum((a in side) != (b in side) for a, b in state.links if (a, b) not in state.accepted)
        if vain < options.most_vain and across and across[0] not in wanted:
            wanted.append(across[0])
    return [
        (pair, f"the poses so far put {shares[pair]:.0%} of the one's walls on the other's")
        for pair in wanted
    ]


def supposed(state: SearchState) -> Reasons:
    """For each doubtful link between two components, the pairs that share most if it is right."""
    poses = state.poses()
    wanted: dict[Pair, str] = {}
    for (a, b), link in sorted(state.links.items()):
        doubtful = link.verdict in (LinkVerdict.DOUBTFUL, LinkVerdict.AMBIGUOUS)
        apart = state.component[a] != state.component[b]
        if not doubtful or not apart or link.transform is None:
            continue
        shares = shares_under(state, *state.directed((a, b), link.transform), poses)
        best = sorted(shares, key=lambda pair: (-shares[pair], state.content(pair)))
        for pair in best[: state.options.tests]:
            if shares[pair] >= state.options.least_expected and pair not in state.links:
                names = f"{link.from_station} - {link.to_station}"
                wanted[pair] = f"they share {shares[pair]:.0%} of their walls if {names} is right"
    return sorted(wanted.items())


def last_tries(state: SearchState) -> Reasons:
    """For scans that nothing ties, the likeliest others whatever the previews said."""
    options, previews = state.options, state.previews
    wanted: dict[Pair, str] = {}
    for i, others in enumerate(state.ranked):
        if state.degree[i]:
            continue
        done = sum(i in pair for pair in state.links)
        rest = [ordered(i, j) for j in others[: options.most_previews]]
        rest = [pair for pair in rest if pair not in state.links]
        rest.sort(key=lambda pair: -previews[pair].score if pair in previews else 0.0)
        for pair in rest[: max(0, options.last_tries - done)]:
            wanted[pair] = "nothing ties one of them, and this is the likeliest that is left"
    return sorted(wanted.items())
