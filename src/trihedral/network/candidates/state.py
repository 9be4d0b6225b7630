"""What is known of pairs when a round of the search begins."""

from collections.abc import Iterable, Sequence

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import inverse
from trihedral.initial.plan.descriptor import PlanDescriptor
from trihedral.model.pairs import PairHistory, PairPreview
from trihedral.model.station import DescribedStation
from trihedral.network.candidates.options import CandidateOptions
from trihedral.network.graph.chained_poses import chained_poses
from trihedral.network.graph.connectivity import bridges, component_labels
from trihedral.network.graph.scanner_frames import between_scanners

Pair = tuple[int, int]
# Pairs to try, each with the reason.
Reasons = list[tuple[Pair, str]]


def ordered(a: int, b: int) -> Pair:
    """A pair by the numbers of its stations, the lesser first."""
    return (a, b) if a < b else (b, a)


class SearchState:
    """What came of pairs so far, by the numbers of their stations.

    Attributes
    ----------
    component
        (N,) label of the connected component that each station is in.
    sides
        For each link that alone holds a component together, the stations on one side of it.
    degree
        (N,) accepted links of each station.
    ranked
        For each station the others, the most similar plan first.
    """

    def __init__(
        self,
        stations: Sequence[DescribedStation],
        history: PairHistory,
        similarity: Float64,
        options: CandidateOptions,
    ) -> None:
        self.stations = stations
        self.options = options
        self.similarity = similarity
        number = {station.name: index for index, station in enumerate(stations)}
        self.previews = {ordered(number[a], number[b]): found for (a, b), found in history.previews.items()}
        self.links = {ordered(number[k.from_station], number[k.to_station]): k for k in history.links}
        self.accepted = {pair for pair, link in self.links.items() if link.accepted}
        ends = sorted(self.accepted)
        self.component = component_labels(len(stations), ends)
        self.sides = list(bridges(len(stations), ends).values())
        self.degree = np.bincount(np.array(ends, dtype=np.intp).ravel(), minlength=len(stations))
        # Equal similarities are told apart by content, never by order.
        rank = np.argsort(np.argsort([station.content for station in stations]))
        self.ranked = [
            [int(j) for j in np.lexsort((rank, -similarity[i])) if j != i] for i in range(len(stations))
        ]

    def bears_out(self, preview: PairPreview) -> bool:
        """Whether a preview is reason enough to register the pair."""
        return preview.score >= self.options.least_score and not self.looks_strange(preview)

    def looks_strange(self, preview: PairPreview) -> bool:
        """Whether the surfaces that a preview makes meet are not of similar appearance."""
        similarity = preview.appearance_similarity
        return similarity is not None and similarity < self.options.least_similarity

    def as_needed(self, best_first: Iterable[Pair]) -> list[Pair]:
        """Those that join components or that a scan with few links has a use for, if each comes to be accepted."""
        degree, component = self.degree.copy(), self.component.copy()
        wanted = []
        for a, b in best_first:
            if component[a] == component[b] and min(degree[a], degree[b]) >= self.options.links:
                continue
            wanted.append((a, b))
            degree[[a, b]] += 1
            component[component == component[b]] = component[a]
        return wanted

    def descriptor(self, station: int) -> PlanDescriptor:
        """Of its plan."""
        descriptor: PlanDescriptor = self.stations[station].descriptor
        return descriptor

    def poses(self) -> Float64:
        """(N, 4, 4) of the scanners, in the frame of their component: chained over the links of the best score."""
        steps: dict[int, list[tuple[float, int, Float64]]] = {}
        for pair in sorted(self.accepted):
            link = self.links[pair]
            if link.transform is not None:
                first, second, between = self.directed(pair, link.transform)
                steps.setdefault(second, []).append((-link.score, first, between))
                steps.setdefault(first, []).append((-link.score, second, inverse(between)))
        best_first = {
            here: [(there, pose) for _, there, pose in sorted(found, key=lambda step: step[:2])]
            for here, found in steps.items()
        }
        poses: dict[int, Float64] = {}
        for start in range(len(self.stations)):
            if start not in poses:
                poses |= chained_poses(start, best_first)
        return np.array([poses[station] for station in range(len(self.stations))])

    def directed(self, pair: Pair, transform: Float64) -> tuple[int, int, Float64]:
        """The stations that a link with this pose leads from and to, and the pose between their scanners."""
        leads_on = self.stations[pair[0]].name == self.links[pair].from_station
        first, second = pair if leads_on else pair[::-1]
        return first, second, between_scanners(transform, self.stations[first], self.stations[second])

    def content(self, pair: Pair) -> tuple[str, ...]:
        """Of both stations: what tells equal pairs apart."""
        return tuple(sorted(self.stations[i].content for i in pair))
