"""Which pairs of scans to try: found without trying all, round by round, more where the network is weak."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.initial.plan.descriptor import plan_similarities
from trihedral.model.pairs import PairHistory, PairRequest, PassedOver
from trihedral.model.station import DescribedStation
from trihedral.network.candidates.options import CandidateOptions
from trihedral.network.candidates.passed_over import never_previewed, why_passed_over
from trihedral.network.candidates.previews import first_previews, more_previews
from trihedral.network.candidates.registrations import expected, last_tries, promising, supposed
from trihedral.network.candidates.state import SearchState, ordered

# What is asked for, in this order, each where those before it ask for nothing; and whether for a preview only.
STEPS = (
    (first_previews, True),
    (promising, False),
    (expected, False),
    (supposed, False),
    (more_previews, True),
    (last_tries, False),
)


def all_pairs(stations: Sequence[DescribedStation], history: PairHistory) -> list[PairRequest]:
    """Every pair of stations, once."""
    known = {frozenset((link.from_station, link.to_station)) for link in history.links}
    return [
        PairRequest(a.name, b.name, "all pairs are tried")
        for a, b in combinations(stations, 2)
        if frozenset((a.name, b.name)) not in known
    ]


@dataclass
class CandidateSearch:
    """Chooses pairs; asked again with what came of them until it asks for nothing more.

    What it asks for depends on the scans and on what is known of pairs, on nothing else: a run that was stopped goes on
    with the same pairs.
    """

    options: CandidateOptions = field(default_factory=CandidateOptions)
    _known: tuple[tuple[str, ...], Float64] | None = field(default=None, repr=False)

    def __call__(self, stations: Sequence[DescribedStation], history: PairHistory) -> list[PairRequest]:
        """Ask for pairs; each call is a round."""
        if len(stations) <= self.options.all_pairs_up_to:
            return all_pairs(stations, history)
        state = self._state(stations, history)
        for step, preview_only in STEPS:
            if found := step(state):
                return [
                    PairRequest(stations[a].name, stations[b].name, because, preview_only)
                    for (a, b), because in found
                ]
        return []

    def passed_over(self, stations: Sequence[DescribedStation], history: PairHistory) -> PassedOver:
        """Say why pairs were not registered; asked when it asks for nothing more."""
        if len(stations) <= self.options.all_pairs_up_to:
            return PassedOver()
        state = self._state(stations, history)
        number = {station.name: index for index, station in enumerate(stations)}
        pairs = {ends: ordered(number[ends[0]], number[ends[1]]) for ends in history.previews}
        return PassedOver(
            {ends: why_passed_over(state, pair) for ends, pair in pairs.items() if pair not in state.links},
            never_previewed(state),
        )

    def _state(self, stations: Sequence[DescribedStation], history: PairHistory) -> SearchState:
        return SearchState(stations, history, self._similarities(stations), self.options)

    def _similarities(self, stations: Sequence[DescribedStation]) -> Float64:
        """(N, N) of plans, with what names hint; computed once for the same scans."""
        contents = tuple(f"{s.name} {s.content}" for s in stations)
        if self._known is None or self._known[0] != contents:
            found = plan_similarities([station.descriptor for station in stations])
            after = np.arange(len(stations) - 1)
            found[after, after + 1] += self.options.neighbour_bonus
            found[after + 1, after] += self.options.neighbour_bonus
            self._known = (contents, found)
        return self._known[1]
