"""Scans of another storey are not tied to this one by a link that nothing checks."""

from dataclasses import replace

from support.networks import closed, network
from trihedral.model.link import LinkVerdict
from trihedral.model.station import StationStatus
from trihedral.network.decision.strangers import doubt_strangers, reject_links_to_strangers
from trihedral.network.solve import solve


def test_a_scan_of_another_storey_is_not_tied_by_the_one_link_whose_appearance_is_unknown():
    # Station 3 is of another storey: it agrees in shape with 0 and 1 but looks otherwise; with 2, that is unknown.
    pairs = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    refused = {(0, 3): LinkVerdict.REFUSED, (1, 3): LinkVerdict.REFUSED}
    _, members, links = network(4, pairs, verdicts=refused)
    similarity = {(0, 1): 1.1, (1, 2): 0.9, (0, 2): 1.0, (0, 3): 0.1, (1, 3): 0.2, (2, 3): None}
    links = [
        replace(link, evidence=replace(link.evidence, appearance_similarity=similarity[pair], enclosed=True))
        for link, pair in zip(links, pairs, strict=True)
    ]
    result = solve(members, links)
    status = {station.name: station.status for station in result.stations}
    assert status["s3"] is StationStatus.NOT_PLACED
    assert [status[f"s{k}"] for k in range(3)] == [StationStatus.VERIFIED] * 3
    link = next(link for link in result.links if (link.from_station, link.to_station) == ("s2", "s3"))
    assert link.verdict is LinkVerdict.REFUSED
    assert "do not look the same" in link.reason


def test_a_scan_of_another_storey_is_not_tied_where_its_stairs_stand_in_empty_space():
    # Station 3 is of another storey, a copy but for the stairs that 0 sees: 2 sees none and takes it for this one.
    pairs = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    doubtful = {(0, 3): LinkVerdict.DOUBTFUL, (1, 3): LinkVerdict.DOUBTFUL}
    _, members, links = network(4, pairs, verdicts=doubtful)
    contradicted = [
        replace(link, evidence=replace(link.evidence, contradicted=True)) if pair == (0, 3) else link
        for link, pair in zip(links, pairs, strict=True)
    ]
    result = solve(members, contradicted)
    status = {station.name: station.status for station in result.stations}
    assert status["s3"] is StationStatus.NOT_PLACED
    assert [status[f"s{k}"] for k in range(3)] == [StationStatus.VERIFIED] * 3
    link = next(link for link in result.links if (link.from_station, link.to_station) == ("s2", "s3"))
    assert link.verdict is LinkVerdict.REFUSED
    assert "s0 and s3" in link.reason and "contradict" in link.reason
    # Doubts of another kind are taken back by what the others say.
    assert all(station.pose is not None for station in solve(members, links).stations)


def test_the_rule_refuses_the_one_link_on_the_way_whose_appearance_is_unknown():
    _, members, links = network(4, [(0, 1), (1, 2), (2, 3), (0, 3)], verdicts={(0, 3): LinkVerdict.REFUSED})
    similarity = [0.9, 0.9, None, 0.1]
    links = [
        replace(link, evidence=replace(link.evidence, appearance_similarity=similarity[k], enclosed=True))
        for k, link in enumerate(links)
    ]
    after = reject_links_to_strangers(closed(members, links)).state
    assert [link.accepted for link in after.links] == [True, True, False, False]
    assert "s0 and s3" in after.links[2].reason
    # Where the two look the same it has nothing to say.
    links[3] = replace(links[3], evidence=replace(links[3].evidence, appearance_similarity=0.9))
    state = closed(members, links)
    assert reject_links_to_strangers(state).state is state


def looking(links, similarity, **other):
    """The same links, under a ceiling, with these appearance similarities."""
    return [
        replace(
            link,
            evidence=replace(link.evidence, appearance_similarity=value, enclosed=True, **other),
        )
        for link, value in zip(links, similarity, strict=True)
    ]


def test_nothing_is_verified_where_scans_that_look_otherwise_are_put_in_one_place():
    # 2 and 3 are of another storey than 0 and 1, which looks the same from 2 and not from 3.
    pairs = [(0, 1), (0, 2), (1, 2), (2, 3), (0, 3), (1, 3)]
    refused = {(0, 3): LinkVerdict.REFUSED, (1, 3): LinkVerdict.REFUSED}
    _, members, links = network(4, pairs, verdicts=refused)
    links = looking(links, [0.9, 0.8, 0.9, 0.9, 0.4, 0.3])
    result = solve(members, links)
    assert all(station.status is StationStatus.AMBIGUOUS for station in result.stations)
    assert "do not look the same" in result.stations[0].reason
    # Where they look the same, or where it is of intensity only, which tells less, loops decide as ever.
    for other in (looking(links, [0.9] * 6), looking(links, [0.9] * 4 + [0.4, 0.3], by_intensity=True)):
        assert not doubt_strangers(closed(members, other)).doubts


def test_one_pair_that_looks_otherwise_is_outvoted_by_many_links():
    pairs = [(a, b) for a in range(5) for b in range(a + 1, 5)]
    _, members, links = network(5, pairs, verdicts={(0, 4): LinkVerdict.REFUSED})
    links = looking(links, [0.3 if pair == (0, 4) else 0.9 for pair in pairs])
    # Three ways lead from 0 to 4 that share no link.
    assert not doubt_strangers(closed(members, links)).doubts
    fewer = [link for link, pair in zip(links, pairs, strict=True) if pair not in ((0, 1), (1, 4))]
    assert set(doubt_strangers(closed(members, fewer)).doubts) == set(range(5))
