"""Which pairs a job tries next, given what a person decided and which links hold together."""

from collections.abc import Sequence

from trihedral.model.pairs import PairHistory, PairRequest, PassedOver
from trihedral.model.station import DescribedStation
from trihedral.network.candidates.options import CandidateOptions
from trihedral.network.candidates.search import CandidateSearch
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.constraints.names import resolve
from trihedral.network.constraints.user_links import wanted_pairs, with_user_links
from trihedral.network.options import NetworkOptions
from trihedral.network.solve import believed


class PairSelection:
    """A candidate search over the links that loops leave, beside what the constraints decide."""

    def __init__(self, options: CandidateOptions, network: NetworkOptions, constraints: Constraints) -> None:
        self._search = CandidateSearch(options)
        self._network = network
        self._constraints = constraints

    def requests(self, stations: Sequence[DescribedStation], history: PairHistory) -> list[PairRequest]:
        """Pairs to preview or register next; none when the job has all it needs."""
        constraints, history = self._known(stations, history)
        # Links that loops refuse tie nothing; to close the loops after every round would take long.
        asked = self._search(stations, history) or self._search(
            stations, self._believed(stations, constraints, history)
        )
        return wanted_pairs(constraints, asked)

    def passed_over(self, stations: Sequence[DescribedStation], history: PairHistory) -> PassedOver:
        """Why pairs are not registered, when `requests` gives none."""
        constraints, history = self._known(stations, history)
        return self._search.passed_over(stations, self._believed(stations, constraints, history))

    def _known(
        self, stations: Sequence[DescribedStation], history: PairHistory
    ) -> tuple[Constraints, PairHistory]:
        """What a person decided on needs no search."""
        constraints = resolve(self._constraints, stations)
        return constraints, PairHistory(
            with_user_links(constraints, history.links, stations), history.previews
        )

    def _believed(
        self, stations: Sequence[DescribedStation], constraints: Constraints, history: PairHistory
    ) -> PairHistory:
        return PairHistory(believed(stations, history.links, self._network, constraints), history.previews)
