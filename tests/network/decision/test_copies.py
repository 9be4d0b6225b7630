"""Loops say nothing of which copy of a place a scan stands in."""

from dataclasses import replace

import pytest

from support.networks import closed, network
from trihedral.model.link import LinkVerdict
from trihedral.model.station import StationStatus
from trihedral.network.decision.copies import doubt_copies
from trihedral.network.solve import solve


@pytest.mark.parametrize("copies", [True, False])
def test_loops_over_links_of_unknown_appearance_verify_nothing_in_a_place_that_has_copies(copies):
    # 0, 1 and 2 look the same where they meet; 3 and 4 are tied by loops, but nothing is known of their appearance.
    pairs = [(0, 1), (1, 2), (0, 2), (2, 3), (1, 3), (3, 4), (2, 4), (0, 4)]
    verdict = LinkVerdict.AMBIGUOUS if copies else LinkVerdict.DOUBTFUL
    _, members, links = network(5, pairs, verdicts={(0, 4): verdict})
    unseen = replace(links[0].evidence, enclosed=True)
    links = [
        link if max(pair) < 3 else replace(link, evidence=unseen)
        for link, pair in zip(links, pairs, strict=True)
    ]
    result = solve(members, links)
    verified = [station.status is StationStatus.VERIFIED for station in result.stations]
    assert verified == [True] * 3 + [not copies] * 2
    assert all(station.pose is not None for station in result.stations)
    assert not copies or "fit in copies of a place" in result.stations[4].reason
    # One link whose appearance was compared is enough: a copy would not have passed it.
    seen = [replace(link, evidence=links[0].evidence) if k == 3 else link for k, link in enumerate(links)]
    assert solve(members, seen).stations[3].status is StationStatus.VERIFIED
    # Where none were, every station may be anywhere.
    bare = [replace(link, evidence=unseen) for link in links]
    assert any(s.status is StationStatus.VERIFIED for s in solve(members, bare).stations) is not copies


def test_the_rule_doubts_what_only_links_of_unknown_appearance_tie():
    _, members, links = network(4, [(0, 1), (1, 2), (0, 2), (2, 3)])
    links[3] = replace(links[3], evidence=replace(links[3].evidence, enclosed=True))
    state = closed(members, links)
    assert set(doubt_copies(replace(state, has_copies=True)).doubts) == {3}
    assert not doubt_copies(state).doubts


def test_the_rule_doubts_all_that_only_ceilings_bear_out_where_places_look_the_same():
    _, members, links = network(4, [(0, 1), (1, 2), (0, 2), (2, 3)])
    alike = replace(links[0].evidence, enclosed=True, appearance_similarity=0.9)
    links = [replace(link, evidence=alike) for link in links]
    state = closed(members, links)
    assert set(doubt_copies(replace(state, has_lookalikes=True)).doubts) == {0, 1, 2, 3}
    # Where appearances could be compared, copies that nobody could compare are no matter.
    assert not doubt_copies(replace(state, has_copies=True)).doubts
    # In the open nothing hides the others: what it ties stands where it is.
    links = [replace(link, evidence=replace(alike, enclosed=False)) for link in links[:3]] + links[3:]
    assert set(doubt_copies(replace(closed(members, links), has_lookalikes=True)).doubts) == {3}


@pytest.mark.parametrize(("similarity", "expected"), [(0.9, True), (0.2, False), (None, False)])
def test_an_ambiguous_pair_that_looks_the_same_shows_that_the_place_has_lookalikes(similarity, expected):
    _, members, links = network(3, [(0, 1), (1, 2), (0, 2)], verdicts={(0, 2): LinkVerdict.AMBIGUOUS})
    found = replace(links[0].evidence, enclosed=True, appearance_similarity=similarity)
    state = closed(members, [replace(link, evidence=found) for link in links])
    assert state.has_lookalikes is expected
