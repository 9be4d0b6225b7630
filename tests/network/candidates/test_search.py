"""Which pairs are tried: on a street of random walls whose stations see some metres of it."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import support.links
from support.street import SEEN, STEP, Job, Place, overlap, scanner, street
from trihedral.errors import OptionError
from trihedral.geometry.se3 import inverse
from trihedral.initial.plan.descriptor import (
    APPEARANCE,
    CELL,
    FACINGS,
    SIDE,
    STEPS,
    PlanDescriptor,
    expected_overlap,
    plan_similarities,
)
from trihedral.model.link import Link, LinkVerdict
from trihedral.model.pairs import PairHistory, PairPreview, PassedOver
from trihedral.network.candidates.options import CandidateOptions
from trihedral.network.candidates.search import CandidateSearch


def parts(places: list[Place], history: PairHistory, without: Link | None = None) -> int:
    label = {place.name: place.name for place in places}
    for link in history.links:
        if link.accepted and link is not without:
            old, new = label[link.from_station], label[link.to_station]
            label = {name: new if at == old else at for name, at in label.items()}
    return len(set(label.values()))


def test_plans_that_share_walls_are_the_more_alike():
    places = street(20)
    alike = plan_similarities([place.descriptor for place in places])
    assert np.array_equal(alike, alike.T)
    near, far = [], []
    for a, b in combinations(range(20), 2):
        (near if overlap(places[a], places[b]) else far).append(alike[a, b])
    assert np.percentile(near, 5) > np.percentile(far, 95)


def floored(places: list[Place], seed: int) -> list[PlanDescriptor]:
    """The plans of a street with a floor whose appearance is its own."""
    rng = np.random.default_rng(seed)
    waves, phases = rng.normal(0, 1.5, (30, 2)), rng.uniform(0, 2 * np.pi, 30)  # radians a metre
    steps = (np.arange(SIDE) - SIDE // 2 + 0.5) * CELL
    cells = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1)
    plans = []
    for place in places:
        plan_from_street = place.descriptor.plan_from_scanner @ place.pose[:3, :3].T
        in_street = cells @ plan_from_street[:2, :2] + scanner(place)[:2]
        painted = np.cos(in_street @ waves.T + phases).sum(axis=-1) / np.sqrt(15)
        painted[np.linalg.norm(cells, axis=-1) > SEEN] = 0
        plan = place.descriptor.plan.copy()
        plan[APPEARANCE.start] = np.rint(STEPS * np.clip(painted, -3, 3))
        plans.append(PlanDescriptor(plan, place.descriptor.plan_from_scanner))
    return plans


def test_the_appearance_tells_storeys_apart_whose_walls_are_the_same():
    places = street(12)
    walls_alone = plan_similarities([place.descriptor for place in places] * 2)
    alike = plan_similarities(floored(places, 1) + floored(places, 2))
    for k, place in enumerate(places):
        # The walls alone put the same place of the other storey first.
        assert walls_alone[k].argmax() == k + 12
        near = np.argsort(-alike[k])[:2]
        assert all(j < 12 and overlap(place, places[j]) for j in near)


def test_a_pose_tells_what_overlap_to_expect():
    places = street(6)
    a, b = places[0], next(p for p in places if p.name != places[0].name and overlap(p, places[0]))

    def centred(pa: Place, pb: Place) -> np.ndarray:
        moved = inverse(pb.pose) @ pa.pose
        moved[:3, 3] += moved[:3, :3] @ pa.header.scanner_origin - pb.header.scanner_origin
        return moved

    right = centred(a, b)
    # Two circles of 14 m whose centres are one or two steps apart share so much of each.
    apart = abs(scanner(a)[0] - scanner(b)[0]) / (2 * SEEN)
    lens = 2 / np.pi * (np.arccos(apart) - apart * np.sqrt(1 - apart**2))
    assert expected_overlap(a.descriptor, b.descriptor, right) == pytest.approx(lens, abs=0.12)
    above = right.copy()
    above[2, 3] += 3.0
    assert expected_overlap(a.descriptor, b.descriptor, above) == 0.0


def test_a_few_scans_are_all_tried():
    places = street(6)
    rounds, history = Job(places).run(CandidateOptions())
    assert len(rounds) == 1
    assert {frozenset((k.from_station, k.to_station)) for k in history.links} == {
        frozenset((a.name, b.name)) for a, b in combinations(places, 2)
    }


@pytest.mark.parametrize("count", [20, 40])
def test_many_scans_are_tied_with_few_tries(count: int):
    places = street(count)
    _, history = Job(places).run(CandidateOptions())
    assert parts(places, history) == 1
    # Whichever link is lost, they stay together.
    assert all(parts(places, history, without=link) == 1 for link in history.links)
    assert len(history.links) <= 4 * count
    assert len(history.previews) <= 6 * count
    assert all(link.accepted for link in history.links)


def test_order_and_names_change_nothing_but_a_little():
    places = street(30)
    asked = []
    for order in (places, places[::-1]):
        rounds, _ = Job(list(order)).run(CandidateOptions(neighbour_bonus=0.0))
        asked.append([{frozenset((w.a, w.b)) for w in wanted} for wanted in rounds])
    assert asked[0] == asked[1]


def test_a_run_that_was_stopped_asks_for_the_same():
    places = street(20)
    rounds, history = Job(places).run(CandidateOptions())
    # All that was known before the last round, handed to a new search.
    links_late = {(w.a, w.b) for w in rounds[-1] if not w.preview_only}
    previews_late = {(w.a, w.b) for w in rounds[-1] if w.preview_only}
    links = [k for k in history.links if (k.from_station, k.to_station) not in links_late]
    previews = {pair: preview for pair, preview in history.previews.items() if pair not in previews_late}
    assert CandidateSearch()(places, PairHistory(links, previews)) == rounds[-1]


def test_poses_lead_to_neighbours_that_previews_missed():
    places = street(24)
    # Every preview of a fifth of the scans fails: they are tied by what their plans promise, and then by the poses.
    blind = frozenset(place.name for place in places[::5])
    rounds, history = Job(places, blind=blind).run(CandidateOptions())
    assert parts(places, history) == 1
    because = [want.because for wanted in rounds for want in wanted if {want.a, want.b} & blind]
    assert any("poses so far" in text for text in because)


def test_a_scan_of_elsewhere_costs_a_bounded_number_of_tries():
    places = street(30)
    lost = places[7].name
    options = CandidateOptions()
    _, history = Job(places, blind=frozenset([lost]), lost=frozenset([lost])).run(options)
    others = [place for place in places if place.name != lost]
    assert parts(others, history) == 1
    own = [k for k in history.links if lost in (k.from_station, k.to_station)]
    assert 1 <= len(own) <= options.last_tries + 3
    previews = [pair for pair in history.previews if lost in pair]
    # Its own, those in vain, and those that others ask for.
    assert len(previews) <= options.first_previews + options.most_previews + 30 * options.first_previews / 8


def test_a_scan_whose_plan_says_nothing_is_tied_all_the_same():
    places = street(40)
    rng = np.random.default_rng(8)
    plan = np.zeros_like(places[9].descriptor.plan)
    plan[rng.integers(0, FACINGS, 300), rng.integers(40, 88, 300), rng.integers(40, 88, 300)] = 1
    places[9] = replace(places[9], descriptor=PlanDescriptor(plan, places[9].descriptor.plan_from_scanner))
    _, history = Job(places).run(CandidateOptions())
    assert parts(places, history) == 1


def test_two_places_in_one_job_are_not_previewed_beside_each_other_for_ever():
    here, there = street(25), street(25, seed=11)
    away = np.eye(4)
    away[0, 3] = 1000.0
    there = [
        replace(p, name=f"away {p.name}", content=f"away {p.content}", pose=away @ p.pose) for p in there
    ]
    places = sorted(here + there, key=lambda p: p.name)
    options = CandidateOptions()
    # The patience is that of the job, however many scans it has; beyond it only likely pairs are previewed.
    for patience in (0, options.patience):
        _, history = Job(places).run(replace(options, patience=patience))
        assert parts(places, history) == 2
        between = [
            pair for pair in history.previews if pair[0].startswith("away") != pair[1].startswith("away")
        ]
        assert len(between) <= max(2 * len(here), patience + options.more_previews)


def test_parts_of_a_small_job_are_previewed_beside_each_other_until_something_ties_them():
    """Two halves of a street whose plans have nothing in common where they meet."""
    middle = 9.5 * STEP
    first = [p for p in street(20) if scanner(p)[0] < middle]
    second = [
        replace(p, name=f"on {p.name}", content=f"on {p.content}")
        for p in street(20, seed=11)
        if scanner(p)[0] > middle
    ]
    places = sorted(first + second, key=lambda p: p.name)
    demanding = CandidateOptions(least_promise=1.0)
    _, history = Job(places).run(demanding)
    assert parts(places, history) == 1
    _, history = Job(places).run(replace(demanding, patience=0))
    assert parts(places, history) == 2


def test_plans_that_are_like_all_others_do_not_take_every_preview(monkeypatch):
    """Two halves of a street: five plans of one are like all of the other, more so than where the halves meet."""
    places = sorted(street(60), key=lambda place: scanner(place)[0])
    rng = np.random.default_rng(5)
    along = np.arange(60)
    similarity = np.where(np.abs(along[:, None] - along) <= 2, 2.0, rng.uniform(0.0, 0.2, (60, 60)))
    similarity[:30, 30:] = np.where(similarity[:30, 30:] == 2.0, 0.3, similarity[:30, 30:])
    similarity[[3, 8, 13, 18, 23], 30:] = 1.0
    similarity[30:, :30] = similarity[:30, 30:].T
    monkeypatch.setattr(
        "trihedral.network.candidates.search.plan_similarities", lambda descriptors: similarity.copy()
    )
    _, history = Job(places).run(CandidateOptions(neighbour_bonus=0.0))
    assert parts(places, history) == 1


def test_every_try_says_why():
    rounds, _ = Job(street(20)).run(CandidateOptions())
    assert all(want.because for wanted in rounds for want in wanted)
    assert any(want.preview_only for want in rounds[0])


def never_asked_for(history: PairHistory, places: list[Place]) -> set[frozenset[str]]:
    known = {frozenset((k.from_station, k.to_station)) for k in history.links} | set(
        map(frozenset, history.previews)
    )
    return {frozenset((a.name, b.name)) for a, b in combinations(places, 2)} - known


def test_what_was_not_registered_is_explained_by_what_was_known():
    """Previews of a street and a scan of elsewhere, against a count of links and parts of the test's own."""
    places = street(30)
    lost = places[7].name
    options = CandidateOptions(most_previews=5)
    rounds, history = Job(places, blind=frozenset([lost]), lost=frozenset([lost])).run(options)
    assert sum(map(len, rounds)) == len(history.links) + len(history.previews)
    found = CandidateSearch(options).passed_over(places, history)
    registered = {frozenset((k.from_station, k.to_station)) for k in history.links}
    assert set(found.previewed) == {pair for pair in history.previews if frozenset(pair) not in registered}
    degree = {place.name: 0 for place in places}
    for link in history.links:
        for end in (link.from_station, link.to_station):
            degree[end] += link.accepted
    enough = 0
    for pair, reason in found.previewed.items():
        if history.previews[pair].score == 0.0:
            assert reason == "no pose was found"
        else:
            assert "other links tied its scans to each other, and each had 3 accepted ones" in reason
            assert min(degree[end] for end in pair) >= 3 and lost not in pair
            enough += 1
    assert 0 < enough < len(found.previewed)
    # Of the pairs that are left, those of the lost scan are so because its previews are spent.
    left = never_asked_for(history, places)
    counts = {("spent" if "are spent" in rule else "together"): n for rule, n in found.never.items()}
    own = sum(lost in pair for pair in left)
    assert counts == {"spent": own, "together": len(left) - own}


def test_previews_that_are_too_weak_or_strange_are_said_to_be_so():
    places = sorted(street(14), key=lambda place: scanner(place)[0])
    previews = {
        (a.name, b.name): PairPreview(score, similarity, 0.1)
        for (a, b), (score, similarity) in zip(
            combinations(places[:4], 2),
            [(0.0, None), (0.012, None), (0.3, 0.31), (0.012, 0.31), (0.3, 0.9), (0.3, None)],
            strict=True,
        )
    }
    accepted = [link_of(places[2], places[3])]
    search = CandidateSearch(CandidateOptions(all_pairs_up_to=0))
    stations = sorted(places, key=lambda place: place.name)
    found = search.passed_over(stations, PairHistory(accepted, previews)).previewed
    surface = "too little surface agrees, or too much contradicts: score 0.012, 0.04 is asked"
    strange = "its surfaces do not look the same: appearance similarity 0.31, 0.5 is asked"
    reasons = [found.get(pair) for pair in previews]
    assert reasons[:4] == ["no pose was found", surface, strange, f"{surface}; {strange}"]
    # The last was registered.
    assert reasons[5] is None


def test_places_apart_are_left_where_plans_promise_little():
    here, there = street(12), street(12, seed=11)
    away = np.eye(4)
    away[0, 3] = 1000.0
    there = [
        replace(p, name=f"away {p.name}", content=f"away {p.content}", pose=away @ p.pose) for p in there
    ]
    places = sorted(here + there, key=lambda p: p.name)
    options = CandidateOptions(patience=0, least_promise=1.0)
    _, history = Job(places).run(options)
    assert parts(places, history) == 2
    never = CandidateSearch(options).passed_over(places, history).never
    left = never_asked_for(history, places)
    between = sum(len({name.startswith("away") for name in pair}) == 2 for pair in left)
    (promising,) = (count for rule, count in never.items() if "more alike than most" in rule)
    assert promising == between
    assert sum(never.values()) == len(left)


def test_where_all_pairs_are_tried_nothing_is_left_to_explain():
    places = street(6)
    _, history = Job(places).run(CandidateOptions())
    assert CandidateSearch().passed_over(places, history) == PassedOver()


def test_numbers_that_make_no_sense_are_refused():
    with pytest.raises(OptionError):
        CandidateOptions(first_previews=0)
    with pytest.raises(OptionError):
        replace(CandidateOptions(), last_tries=-1)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_doubtful_link_is_tested_by_the_pairs_that_it_puts_beside_each_other(backwards: bool) -> None:
    places = sorted(street(14), key=lambda place: scanner(place)[0])
    accepted = [link_of(a, b) for half in (places[:7], places[7:]) for a, b in combinations(half, 2)]
    ends = (places[5], places[8])
    doubtful = replace(
        link_of(*(ends[::-1] if backwards else ends)), verdict=LinkVerdict.DOUBTFUL, reason="thin"
    )
    previews = {(a.name, b.name): PairPreview(0.0, None, 0.1) for a, b in combinations(places, 2)}
    search = CandidateSearch(CandidateOptions(all_pairs_up_to=0, tests=1))
    stations = sorted(places, key=lambda place: place.name)
    (asked,) = search(stations, PairHistory([*accepted, doubtful], previews))
    assert {asked.a, asked.b} == {places[6].name, places[7].name}
    assert not asked.preview_only
    assert f"{doubtful.from_station} - {doubtful.to_station}" in asked.because
    # One that was registered is not asked for again, and what is refused suggests nothing.
    known = replace(link_of(places[6], places[7]), verdict=LinkVerdict.REFUSED, reason="no")
    assert search(stations, PairHistory([*accepted, doubtful, known], previews)) == []
    refused = replace(doubtful, verdict=LinkVerdict.REFUSED)
    assert search(stations, PairHistory([*accepted, refused], previews)) == []


def link_of(a: Place, b: Place) -> Link:
    """The accepted link, with the true pose."""
    return support.links.link(a.name, b.name, inverse(b.pose) @ a.pose)
