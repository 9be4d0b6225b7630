"""Links in doubt that the poses of the others confirm."""

from trihedral.model.link import LinkVerdict
from trihedral.network.decision.alternatives import accepted_with, alternatives_of
from trihedral.network.decision.state import NetworkState, RuleOutcome, within


def confirm_doubtful_links(state: NetworkState) -> RuleOutcome:
    """Accept the links in doubt of which a pose agrees with the poses that the others give."""
    options, after = state.options, state
    for index, link in enumerate(state.links):
        in_doubt = link.verdict in (LinkVerdict.AMBIGUOUS, LinkVerdict.DOUBTFUL)
        # Copies of a place agree with each other, so loops do not take back what was seen to be empty.
        if not in_doubt or index in state.given_up or link.contradicted:
            continue
        for alternative in alternatives_of(state, index):
            offset = state.offset(alternative.a, alternative.b, alternative.transform)
            if within(offset, options.confirmed_translation, options.confirmed_rotation):
                after = accepted_with(after, alternative)
                break
    return RuleOutcome(after)
