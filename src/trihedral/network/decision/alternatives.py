"""Links with several poses: where those of different links meet in one, loops have decided."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import distance, inverse
from trihedral.model.link import LinkVerdict
from trihedral.network.decision.state import ComponentPose, NetworkState, RuleOutcome
from trihedral.network.options import ClosureOptions

# Links that a choice needs, and links for each one that speaks for another.
_LEAST, _DECISIVE = 2, 2


@dataclass(frozen=True)
class Alternative:
    """One of the poses of a link: ``b_from_a`` between scanners."""

    link: int
    pose: int  # 0: the link's own, then its alternatives
    a: int
    b: int
    transform: Float64


def choose_alternatives(state: NetworkState) -> RuleOutcome:
    """Accept poses of ambiguous links on which several of them agree."""
    ambiguous = [
        index
        for index, link in enumerate(state.links)
        if link.verdict is LinkVerdict.AMBIGUOUS and index not in state.given_up
    ]
    if len(ambiguous) < 2:
        return RuleOutcome(state)
    count = len(state.stations)
    alone = [s for s in range(count) if s not in state.poses]
    poses = state.poses | {s: ComponentPose(count + k, np.eye(4)) for k, s in enumerate(alone)}
    offered = [one for index in ambiguous for one in alternatives_of(state, index)]
    for alternative in chosen_alternatives(offered, poses, state.options.closure):
        state = accepted_with(state, alternative)
    return RuleOutcome(state)


def alternatives_of(state: NetworkState, index: int) -> list[Alternative]:
    """The poses that a link may have."""
    link = state.links[index]
    estimates = [link.estimate] if link.estimate is not None else []
    estimates += [other for other in link.alternatives if other.covariance is not None]
    return [
        Alternative(index, k, *state.ends(link), state.between_scanners(link, estimate.transform))
        for k, estimate in enumerate(estimates)
    ]


def accepted_with(state: NetworkState, alternative: Alternative) -> NetworkState:
    """Accept a link with one of its poses; the one that it had becomes an alternative."""
    link, outvoted = state.links[alternative.link], state.outvoted
    if alternative.pose > 0 and link.estimate is not None:
        probability = link.evidence.probability if link.evidence is not None else None
        if (probability or 0.0) >= state.options.outvoted_probability:
            outvoted |= {alternative.link}
        others = list(link.alternatives)
        chosen, others[alternative.pose - 1] = others[alternative.pose - 1], link.estimate
        # What was compared was compared under the other pose.
        link = replace(link, overlap_from=None, overlap_to=None, free_space_conflict=None)
        link = replace(link, estimate=chosen, alternatives=tuple(others))
    link = replace(link, verdict=LinkVerdict.ACCEPTED, reason=None, confirmed_by_loops=True)
    return replace(state.with_links({alternative.link: link}), outvoted=outvoted)


def chosen_alternatives(
    alternatives: Sequence[Alternative], poses: Mapping[int, ComponentPose], closure: ClosureOptions
) -> list[Alternative]:
    """Poses on which links between two components agree, at most one a link.

    Every pose of every link joins two components in one way. A way is chosen if at least two links have it among their
    poses, and no other way has more than half as many.

    Parameters
    ----------
    poses
        Of each station; a station on its own is a component.
    """
    between: dict[tuple[int, int], list[tuple[Alternative, Float64]]] = {}
    for alternative in alternatives:
        a, b = poses[alternative.a], poses[alternative.b]
        join = b.pose @ alternative.transform @ inverse(a.pose)
        if a.component < b.component:
            between.setdefault((a.component, b.component), []).append((alternative, join))
        elif b.component < a.component:
            between.setdefault((b.component, a.component), []).append((alternative, inverse(join)))
    chosen: list[Alternative] = []
    for (first, _), joins in sorted(between.items()):
        # Stations of the first component that its links lead from: there joins are compared.
        places = [poses[s].pose for one, _ in joins for s in (one.a, one.b) if poses[s].component == first]
        supports = [
            [other for other, way in joins if _alike(join, way, places, closure)] for _, join in joins
        ]
        counts = [len({one.link for one in support}) for support in supports]
        best = max(range(len(counts)), key=lambda k: (counts[k], -joins[k][0].pose, -k))
        supporting = {id(one) for one in supports[best]}
        others = [n for n, (one, _) in zip(counts, joins, strict=True) if id(one) not in supporting]
        if counts[best] >= _LEAST and _DECISIVE * max(others, default=0) <= counts[best]:
            by_link: dict[int, Alternative] = {}
            for one in supports[best]:
                by_link.setdefault(one.link, one)
            chosen += by_link.values()
    return chosen


def _alike(join: Float64, other: Float64, places: Sequence[Float64], closure: ClosureOptions) -> bool:
    """Whether two ways to join the components put all places alike, as a loop over them would close."""
    offs = [distance(join @ place, other @ place) for place in places]
    return all(metres <= closure.translation and radians <= closure.rotation for metres, radians in offs)
