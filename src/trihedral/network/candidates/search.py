"""Which pairs of scans to try: found without trying all, round by round, more where the network is weak."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.geometry.se3 import inverse
from trihedral.initial.plan.descriptor import WALL_BAND, PlanDescriptor, expected_overlap, plan_similarities
from trihedral.model.link import LinkVerdict
from trihedral.model.pairs import PairHistory, PairPreview, PairRequest, PassedOver
from trihedral.model.station import DescribedStation

Float64 = NDArray[np.float64]

Pair = tuple[int, int]


@dataclass(frozen=True)
class CandidateOptions:
    """How many pairs are tried."""

    all_pairs_up_to: int = 10  # scans; in larger jobs pairs are chosen
    first_previews: int = 4  # most alike scans that each scan is looked at beside
    more_previews: int = 12  # a round, of a part of the network that nothing ties to the largest
    most_previews: int = 120  # in vain, of a part with one scan; each further scan adds one
    # Likeness (standard deviations) that a look in vain between two parts takes from all pairs between them, and
    # below which no pair of a part of several scans is looked at.
    vain_preview: float = 0.1
    least_promise: float = -0.3
    patience: int = (
        200  # looks in vain between parts before that holds: a job of twenty scans tries every pair
    )
    # Likeness (standard deviations) that it takes from pairs of either scan, for their order alone (docs/projects.md).
    vain_preview_of_scan: float = 0.2
    least_score: float = 0.04  # of a look, for the pair to be registered
    least_similarity: float = 0.5  # the same
    links: int = 3  # accepted ones that a scan should have
    least_expected: float = (
        0.25  # share of walls that meet, under the poses so far, for a pair to be registered
    )
    # The same across a single link that holds two parts together: plans end where scanners see on.
    least_across: float = 0.1
    most_vain: int = 4  # pairs registered in vain across such a link
    tests: int = 2  # of a doubtful link between two parts, by pairs that it puts beside each other ...
    tested_of: int = 40  # ... the nearest to each other
    last_tries: int = 2  # registered all the same by a scan that nothing ties
    neighbour_bonus: float = 0.1  # to the likeness of scans that follow each other by name

    def __post_init__(self) -> None:
        counts = (self.first_previews, self.more_previews, self.most_previews, self.links)
        if min(counts) < 1 or min(self.all_pairs_up_to, self.last_tries) < 0:
            raise OptionError("numbers of looks and links must be at least 1, and none may be negative")


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
    with the same pairs. In order:

    1. each scan is looked at beside those whose plans are most like its own;
    2. pairs that such a look found promising are registered, the best first, until each scan has links enough;
    3. pairs that the poses so far put beside each other are registered where a scan has few links, or where a single
       link holds two parts of the network together;
    4. where a doubtful link is all that ties two parts, pairs that it would put beside each other are registered;
    5. scans and parts that nothing ties to the rest are looked at beside more others;
    6. what is still not tied is registered with its likeliest others whatever the look said.
    """

    options: CandidateOptions = field(default_factory=CandidateOptions)
    _known: tuple[tuple[str, ...], Float64] | None = field(default=None, repr=False)

    def __call__(self, stations: Sequence[DescribedStation], history: PairHistory) -> list[PairRequest]:
        """Ask for pairs; each call is a round."""
        if len(stations) <= self.options.all_pairs_up_to:
            return all_pairs(stations, history)
        state = self._state(stations, history)
        steps: tuple[Callable[[], list[tuple[Pair, str]]], ...] = (
            state.first_previews,
            state.promising,
            state.expected,
            state.supposed,
            state.more_previews,
            state.last_tries,
        )
        for step in steps:
            if found := step():
                preview_only = step in (state.first_previews, state.more_previews)
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
        pairs = {ends: _pair(number[ends[0]], number[ends[1]]) for ends in history.previews}
        return PassedOver(
            {ends: state.why_passed_over(pair) for ends, pair in pairs.items() if pair not in state.links},
            state.never_previewed(),
        )

    def _state(self, stations: Sequence[DescribedStation], history: PairHistory) -> "_State":
        return _State(stations, history, self._likenesses(stations), self.options)

    def _likenesses(self, stations: Sequence[DescribedStation]) -> Float64:
        """(N, N) of plans, with what names hint; computed once for the same scans."""
        contents = tuple(f"{s.name} {s.content}" for s in stations)
        if self._known is None or self._known[0] != contents:
            found = plan_similarities([station.descriptor for station in stations])
            after = np.arange(len(stations) - 1)
            found[after, after + 1] += self.options.neighbour_bonus
            found[after + 1, after] += self.options.neighbour_bonus
            self._known = (contents, found)
        return self._known[1]


class _State:
    """What is known when a round begins."""

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
        self.previews = {_pair(number[a], number[b]): preview for (a, b), preview in history.previews.items()}
        self.links = {_pair(number[k.from_station], number[k.to_station]): k for k in history.links}
        self.accepted = {pair for pair, link in self.links.items() if link.accepted}
        self.part = _parts(len(stations), self.accepted)
        self.sides = _sides_of_bridges(len(stations), sorted(self.accepted))
        self.degree = np.bincount(
            np.array(sorted(self.accepted), dtype=np.intp).ravel(), minlength=len(stations)
        )
        # Equal likenesses are told apart by content, never by order.
        rank = np.argsort(np.argsort([station.content for station in stations]))
        self.lists = [
            [int(j) for j in np.lexsort((rank, -similarity[i])) if j != i] for i in range(len(stations))
        ]

    def first_previews(self) -> list[tuple[Pair, str]]:
        """Those most alike."""
        wanted = {
            _pair(i, j): f"its plan is among the {self.options.first_previews} most like that of the other"
            for i, others in enumerate(self.lists)
            for j in others[: self.options.first_previews]
        }
        return self._new_previews(wanted)

    def promising(self) -> list[tuple[Pair, str]]:
        """Pairs that a look bore out, the best first, as far as links are wanted."""
        best = sorted(
            (
                pair
                for pair, preview in self.previews.items()
                if pair not in self.links and self._bears_out(preview)
            ),
            key=lambda pair: (-self.previews[pair].score, self._content(pair)),
        )
        return [
            (pair, f"a quick look found a pose with score {self.previews[pair].score:.2f}")
            for pair in self._as_needed(best)
        ]

    def expected(self) -> list[tuple[Pair, str]]:
        """Pairs that the poses put beside each other, where the network is weak."""
        shares = self._expected_shares()
        best = sorted(shares, key=lambda pair: (-shares[pair], self._content(pair)))
        wanted = self._as_needed([pair for pair in best if shares[pair] >= self.options.least_expected])
        chosen = set(wanted)
        for side in self.sides:
            across = [pair for pair in best if (pair[0] in side) != (pair[1] in side)]
            if self._vain_across(side) >= self.options.most_vain:
                continue
            if across and across[0] not in chosen:
                wanted.append(across[0])
                chosen.add(across[0])
        return [
            (pair, f"the poses so far put {shares[pair]:.0%} of the one's walls on the other's")
            for pair in wanted
        ]

    def supposed(self) -> list[tuple[Pair, str]]:
        """For each doubtful link between two parts, the pairs that share most if it is right."""
        poses = self._poses()
        wanted: dict[Pair, str] = {}
        for (a, b), link in sorted(self.links.items()):
            doubtful = link.verdict in (LinkVerdict.DOUBTFUL, LinkVerdict.AMBIGUOUS)
            if not doubtful or link.accepted or self.part[a] == self.part[b] or link.transform is None:
                continue
            shares = self._shares_under(*self._directed((a, b), link.transform), poses)
            best = sorted(shares, key=lambda pair: (-shares[pair], self._content(pair)))
            for pair in best[: self.options.tests]:
                if shares[pair] >= self.options.least_expected and pair not in self.links:
                    names = f"{link.from_station} - {link.to_station}"
                    wanted[pair] = f"they share {shares[pair]:.0%} of their walls if {names} is right"
        return sorted(wanted.items())

    def more_previews(self) -> list[tuple[Pair, str]]:
        """For each part but the largest, the pairs most alike that lead out of it.

        Pairs between two parts are the less promising the more looks between them found nothing. Of a part of several
        scans those come first whose scans were not yet looked at in vain: the plans of some are like many others.
        """
        vain = self._vain_previews()
        vain_of = self._vain_previews_of_scans()
        promise = self.similarity.copy()
        for (p, q), count in vain.items():
            of_p, of_q = np.flatnonzero(self.part == p), np.flatnonzero(self.part == q)
            promise[np.ix_(of_p, of_q)] -= self.options.vain_preview * count
            promise[np.ix_(of_q, of_p)] -= self.options.vain_preview * count
        for a, b in (*self.previews, *self.links):
            promise[a, b] = promise[b, a] = -np.inf
        wanted: dict[Pair, str] = {}
        for label, left in self._previews_left(vain).items():
            if left <= 0:
                continue
            inside, outside = np.flatnonzero(self.part == label), np.flatnonzero(self.part != label)
            leading = promise[np.ix_(inside, outside)]
            # A scan that nothing ties would be lost.
            hopeless = len(inside) > 1 and sum(vain.values()) >= self.options.patience
            least = self.options.least_promise if hopeless else np.finfo(np.float64).min
            spent = self.options.vain_preview_of_scan * np.add.outer(vain_of[inside], vain_of[outside])
            order = leading - spent if len(inside) > 1 else leading
            pairs = [
                (order[i, j], _pair(int(inside[i]), int(outside[j])))
                for i, j in np.argwhere(leading >= least)
            ]
            pairs.sort(key=lambda item: (-item[0], self._content(item[1])))
            for _, pair in pairs[: min(self.options.more_previews, left)]:
                wanted[pair] = "nothing ties the part that one of them is in to the largest so far"
        return self._new_previews(wanted)

    def last_tries(self) -> list[tuple[Pair, str]]:
        """For scans in no part of their own, the likeliest others whatever the looks said."""
        wanted: dict[Pair, str] = {}
        for i, others in enumerate(self.lists):
            if self.degree[i]:
                continue
            done = sum(i in pair for pair in self.links)
            rest = [j for j in others[: self.options.most_previews] if _pair(i, j) not in self.links]
            rest.sort(
                key=lambda j: -self.previews[_pair(i, j)].score if _pair(i, j) in self.previews else 0.0
            )
            for j in rest[: max(0, self.options.last_tries - done)]:
                wanted[_pair(i, j)] = "nothing ties one of them, and this is the likeliest that is left"
        return sorted(wanted.items())

    def why_passed_over(self, pair: Pair) -> str:
        """Why a pair that was looked at is not registered, when `promising` asks for nothing more."""
        preview, options = self.previews[pair], self.options
        if preview.score <= 0.0:
            return "no pose was found"
        reasons = []
        if preview.score < options.least_score:
            reasons.append(
                "too little surface agrees, or too much contradicts: "
                f"score {preview.score:.3f}, {options.least_score:g} is asked"
            )
        if self._strange(preview):
            reasons.append(
                f"its surfaces do not look the same: likeness {preview.appearance_similarity:.2f}, "
                f"{options.least_similarity:g} is asked"
            )
        return "; ".join(reasons) or (
            f"when pairs were chosen, other links tied its scans to each other, and each had {options.links} "
            "accepted ones or more"
        )

    def never_previewed(self) -> dict[str, int]:
        """How many pairs are neither looked at nor registered, by why `more_previews` does not ask for them."""
        options = self.options
        unknown = np.triu(np.ones(self.similarity.shape, dtype=np.bool_), 1)
        for pair in (*self.previews, *self.links):
            unknown[pair] = False
        together = self.part[:, None] == self.part
        left = self._previews_left(self._vain_previews())
        asks = np.array([left.get(int(label), 0) > 0 for label in self.part])
        asked_for = asks[:, None] | asks
        alike = f"neither plan is among the {options.first_previews} most like the other"
        rules = {
            f"{alike}, and when pairs were chosen links tied both scans to one part": unknown & together,
            f"{alike}; after {options.patience} looks in vain between parts, only plans more alike than most are "
            "looked at": unknown & ~together & asked_for,
            f"{alike}; the looks in vain that a part is allowed ({options.most_previews}, and one for each further "
            "scan) are spent": unknown & ~together & ~asked_for,
        }
        return {rule: int(pairs.sum()) for rule, pairs in rules.items() if pairs.any()}

    def _vain_between_parts(self) -> list[Pair]:
        """Pairs of two parts at which a look found nothing."""
        return [
            (a, b)
            for (a, b), preview in self.previews.items()
            if self.part[a] != self.part[b] and not self._bears_out(preview)
        ]

    def _vain_previews(self) -> dict[Pair, int]:
        """How many looks between two parts, by their labels, found nothing."""
        vain: dict[Pair, int] = {}
        for a, b in self._vain_between_parts():
            between = _pair(int(self.part[a]), int(self.part[b]))
            vain[between] = vain.get(between, 0) + 1
        return vain

    def _vain_previews_of_scans(self) -> NDArray[np.intp]:
        """(N,) looks at each scan and one of another part that found nothing."""
        return np.bincount(
            np.array(self._vain_between_parts(), dtype=np.intp).ravel(), minlength=len(self.stations)
        )

    def _previews_left(self, vain: Mapping[Pair, int]) -> dict[int, int]:
        """Looks that each part but the largest may still ask for, by its label."""
        main = _largest(self.part)
        return {
            int(label): self.options.most_previews
            + int(np.count_nonzero(self.part == label))
            - 1
            - sum(count for between, count in vain.items() if label in between)
            for label in np.unique(self.part)
            if label != main
        }

    def _new_previews(self, wanted: Mapping[Pair, str]) -> list[tuple[Pair, str]]:
        return sorted((pair, because) for pair, because in wanted.items() if not self._known(pair))

    def _known(self, pair: Pair) -> bool:
        return pair in self.previews or pair in self.links

    def _bears_out(self, preview: PairPreview) -> bool:
        return preview.score >= self.options.least_score and not self._strange(preview)

    def _strange(self, preview: PairPreview) -> bool:
        return (
            preview.appearance_similarity is not None
            and preview.appearance_similarity < self.options.least_similarity
        )

    def _as_needed(self, ranked: Iterable[Pair]) -> list[Pair]:
        """Those that join parts or that a scan with few links has a use for, counting on each to be accepted."""
        degree, part = self.degree.copy(), self.part.copy()
        wanted = []
        for a, b in ranked:
            if part[a] == part[b] and min(degree[a], degree[b]) >= self.options.links:
                continue
            wanted.append((a, b))
            degree[[a, b]] += 1
            part[part == part[b]] = part[a]
        return wanted

    def _expected_shares(self) -> dict[Pair, float]:
        """Of pairs that are not registered, what the poses let expect."""
        poses = self._poses()
        places = poses[:, :3, 3]
        near = np.linalg.norm(places[:, None] - places[None], axis=2) <= _FARTHEST
        few = self.degree < self.options.links
        worth = near & (self.part[:, None] == self.part) & (few[:, None] | few | self._held_by_one())
        shares = {}
        for a, b in np.argwhere(np.triu(worth, 1)).tolist():
            if (a, b) in self.links:
                continue
            share = expected_overlap(self._descriptor(a), self._descriptor(b), inverse(poses[b]) @ poses[a])
            if share >= min(self.options.least_expected, self.options.least_across):
                shares[a, b] = share
        return shares

    def _shares_under(self, first: int, second: int, between: Float64, poses: Float64) -> dict[Pair, float]:
        """What to expect of the nearest pairs between two parts if this is the pose of two of their scanners."""
        # The frame of the part that the second is in, from that of the other.
        moved = poses[second] @ between @ inverse(poses[first])
        of_first, of_second = (
            np.flatnonzero(self.part == self.part[end]).tolist() for end in (first, second)
        )
        there = (moved @ poses[of_first])[:, None, :3, 3] - poses[of_second][:, :3, 3]
        # Plans show what is level with the scanner.
        up = np.array([poses[j][:3, :3] @ self._descriptor(j).plan_from_scanner[2] for j in of_second])
        level = np.abs(np.einsum("ijk,jk->ij", there, up)) <= WALL_BAND
        apart = np.linalg.norm(there, axis=2)
        beside = sorted(
            np.argwhere(level & (apart <= _FARTHEST)).tolist(), key=lambda ends: float(apart[*ends])
        )
        shares = {}
        for i, j in ((of_first[k], of_second[m]) for k, m in beside[: self.options.tested_of]):
            j_from_i = inverse(poses[j]) @ moved @ poses[i]
            shares[_pair(i, j)] = expected_overlap(self._descriptor(i), self._descriptor(j), j_from_i)
        return shares

    def _vain_across(self, side: set[int]) -> int:
        """How many pairs across a link that holds two parts together were registered in vain."""
        return sum((a in side) != (b in side) for a, b in self.links if (a, b) not in self.accepted)

    def _held_by_one(self) -> NDArray[np.bool_]:
        """(N, N) whether a single link holds the parts that two stations are in together."""
        held = np.zeros(self.similarity.shape, dtype=np.bool_)
        for side in self.sides:
            inside = np.zeros(len(held), dtype=np.bool_)
            inside[list(side)] = True
            held |= inside[:, None] != inside
        return held

    def _descriptor(self, station: int) -> PlanDescriptor:
        descriptor: PlanDescriptor = self.stations[station].descriptor
        return descriptor

    def _poses(self) -> Float64:
        """(N, 4, 4) of the scanners, in the frame of their part: chained over the links of the best score."""
        poses: dict[int, Float64] = {}
        neighbours: dict[int, list[tuple[float, int, Float64]]] = {}
        for a, b in sorted(self.accepted):
            link = self.links[a, b]
            if link.transform is None:
                continue
            first, second, centred = self._directed((a, b), link.transform)
            score = link.score
            neighbours.setdefault(second, []).append((-score, first, centred))
            neighbours.setdefault(first, []).append((-score, second, inverse(centred)))
        for start in range(len(self.stations)):
            if start in poses:
                continue
            poses[start] = np.eye(4)
            queue = [start]
            for here in queue:
                for _, there, here_from_there in sorted(neighbours.get(here, []), key=lambda n: n[:2]):
                    if there not in poses:
                        poses[there] = poses[here] @ here_from_there
                        queue.append(there)
        return np.array([poses[i] for i in range(len(self.stations))])

    def _directed(self, pair: Pair, transform: Float64) -> tuple[int, int, Float64]:
        """The stations that a link with this pose leads from and to, and the pose between their scanners."""
        leads_on = self.stations[pair[0]].name == self.links[pair].from_station
        first, second = pair if leads_on else pair[::-1]
        centred = _shift(-self.stations[second].header.scanner_origin) @ transform
        return first, second, centred @ _shift(self.stations[first].header.scanner_origin)

    def _content(self, pair: Pair) -> tuple[str, ...]:
        return tuple(sorted(self.stations[i].content for i in pair))


# Metres: plans do not reach farther.
_FARTHEST = 50.0


def _pair(a: int, b: int) -> Pair:
    return (a, b) if a < b else (b, a)


def _shift(by: NDArray[np.floating[Any]]) -> Float64:
    moved = np.eye(4)
    moved[:3, 3] = by
    return moved


def _parts(count: int, edges: Iterable[Pair]) -> NDArray[np.intp]:
    """(N,) label of the connected part of each station: its least member."""
    part = np.arange(count)
    for a, b in edges:
        if part[a] != part[b]:
            low, high = sorted((part[a], part[b]))
            part[part == high] = low
    return part


def _largest(part: NDArray[np.intp]) -> int:
    return int(np.bincount(part).argmax())


def _sides_of_bridges(count: int, edges: Iterable[Pair]) -> list[set[int]]:
    """For each edge whose loss would split a part, the stations on one side of it."""
    neighbours: dict[int, list[int]] = {}
    for a, b in edges:
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    entered: dict[int, int] = {}
    lowest: dict[int, int] = {}
    below: dict[int, set[int]] = {}
    sides: list[set[int]] = []
    for root in range(count):
        if root in entered or root not in neighbours:
            continue
        stack = [(root, -1, iter(neighbours[root]))]
        entered[root] = lowest[root] = len(entered)
        below[root] = {root}
        while stack:
            here, came, rest = stack[-1]
            for there in rest:
                if there == came:
                    continue
                if there in entered:
                    lowest[here] = min(lowest[here], entered[there])
                else:
                    entered[there] = lowest[there] = len(entered)
                    below[there] = {there}
                    stack.append((there, here, iter(neighbours[there])))
                    break
            else:
                stack.pop()
                if came >= 0:
                    lowest[came] = min(lowest[came], lowest[here])
                    below[came] |= below[here]
                    if lowest[here] > entered[came]:
                        sides.append(below[here])
    return sides
