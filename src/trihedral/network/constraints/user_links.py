"""Pairs that a person has decided on: forced, forbidden and locked links."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from trihedral.model.link import Link, LinkVerdict, PoseEstimate, UserDecision
from trihedral.model.pairs import PairRequest
from trihedral.model.station import Station
from trihedral.network.constraints.constraints import Constraints, UserPair


def wanted_pairs(constraints: Constraints, pairs: Iterable[PairRequest]) -> list[PairRequest]:
    """Pairs to try: what a person forbids or has locked is left out, what he forces is added."""
    skip = {frozenset((p.from_station, p.to_station)) for p in (*constraints.forbidden, *constraints.locked)}
    skip |= {frozenset((p.from_station, p.to_station)) for p in constraints.forced if p.transform is not None}
    forced = {frozenset((p.from_station, p.to_station)): p for p in constraints.forced if p.transform is None}
    skip |= forced.keys()
    chosen = [pair for pair in pairs if frozenset((pair.a, pair.b)) not in skip]
    source = constraints.source or "the constraints"
    return chosen + [
        PairRequest(p.from_station, p.to_station, f"forced by {source}") for p in forced.values()
    ]


def with_user_links(
    constraints: Constraints, links: Sequence[Link], stations: Sequence[Station]
) -> list[Link]:
    """Give the links the verdicts that a person decided on; loops may still refuse what he forced."""
    result = {frozenset((link.from_station, link.to_station)): link for link in links}
    source = constraints.source or "the constraints"
    for pair in constraints.forbidden:
        ends = frozenset((pair.from_station, pair.to_station))
        result[ends] = Link(
            from_station=pair.from_station,
            to_station=pair.to_station,
            verdict=LinkVerdict.REFUSED,
            reason=f"forbidden by {source}",
            method="given",
            decision="forbidden",
        )
    for pair in constraints.forced:
        ends = frozenset((pair.from_station, pair.to_station))
        if pair.transform is not None:
            result[ends] = _given_link(pair, stations, "forced")
        elif ends in result and result[ends].transform is not None and not result[ends].accepted:
            accepted = LinkVerdict.ACCEPTED
            result[ends] = replace(result[ends], verdict=accepted, reason=None, decision="forced")
    for pair in constraints.locked:
        result[frozenset((pair.from_station, pair.to_station))] = _given_link(pair, stations, "locked")
    return list(result.values())


def _given_link(pair: UserPair, stations: Sequence[Station], decision: UserDecision) -> Link:
    origin = {station.name: station.header.scanner_origin for station in stations}
    transform = np.array(pair.transform)
    covariance = np.diag([pair.sigma_rotation**2] * 3 + [pair.sigma_translation**2] * 3)
    estimate = PoseEstimate(transform, covariance)
    content = {station.name: station.content for station in stations}
    ends = pair.from_station, pair.to_station
    if content[ends[0]] > content[ends[1]]:
        # All links lead from the lesser content to the greater.
        estimate, ends = estimate.inverted(origin[ends[0]], origin[ends[1]]), ends[::-1]
    return Link(
        from_station=ends[0],
        to_station=ends[1],
        verdict=LinkVerdict.ACCEPTED,
        method="given",
        estimate=estimate,
        decision=decision,
    )
