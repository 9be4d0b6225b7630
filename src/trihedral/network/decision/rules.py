"""All that is decided of a network, in the order in which it is."""

from dataclasses import replace

from trihedral.network.adjustment.systematic import estimate
from trihedral.network.decision.alternatives import choose_alternatives
from trihedral.network.decision.contested_components import give_up_contested_components
from trihedral.network.decision.contested_stations import doubt_contested_stations
from trihedral.network.decision.copies import doubt_copies
from trihedral.network.decision.doubtful_links import confirm_doubtful_links
from trihedral.network.decision.open_loops import close_loops, reject_open_loops
from trihedral.network.decision.outvoted_poses import doubt_outvoted_poses
from trihedral.network.decision.state import NetworkState, Rule, RuleOutcome
from trihedral.network.decision.strangers import doubt_strangers, reject_links_to_strangers

# Rules that change links, and whether they are applied until they change nothing; loops are closed after every change.
LINK_RULES: tuple[tuple[Rule, bool], ...] = (
    (reject_links_to_strangers, True),
    (confirm_doubtful_links, False),
    (choose_alternatives, True),
    (give_up_contested_components, True),
)
# Rules that doubt stations, before and after what links that were given up leave in doubt: the last reason counts.
STATION_RULES: tuple[tuple[Rule, ...], tuple[Rule, ...]] = (
    (doubt_copies, doubt_strangers),
    (doubt_contested_stations, doubt_outvoted_poses),
)


def decide(state: NetworkState) -> RuleOutcome:
    """Settle, learn from that what links err by, settle again, and give all links their last verdict."""
    assumed = state.options.systematic
    settled = settle(state)
    # Links that err by more than they say fail loops that they should not.
    systematic = estimate([component.edges for component in settled.state.components], assumed)
    if systematic != assumed:
        again = settle(replace(settled.state, systematic=systematic))
        settled = RuleOutcome(
            again.state, {**settled.doubts, **again.doubts}, settled.in_copies | again.in_copies
        )
    return replace(settled, state=reject_open_loops(settled.state).state)


def settle(state: NetworkState) -> RuleOutcome:
    """Apply the rules in their order, until nothing changes."""
    state, contested = close_loops(state), dict[int, str]()
    for rule, repeated in LINK_RULES:
        changed = True
        while changed:
            outcome = rule(state)
            contested |= outcome.doubts
            changed = outcome.state is not state and repeated
            state = state if outcome.state is state else close_loops(outcome.state)
    first, last = ([rule(state) for rule in rules] for rules in STATION_RULES)
    doubts = [*(one.doubts for one in first), contested, *(one.doubts for one in last)]
    return RuleOutcome(
        state,
        {k: why for some in doubts for k, why in some.items()},
        frozenset[int]().union(*(one.in_copies for one in (*first, *last))),
    )
