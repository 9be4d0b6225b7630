"""Scans of another storey are not tied to this one by a link that nothing checks."""

from dataclasses import replace

from support.networks import closed, network
from trihedral.model.link import LinkVerdict
from trihedral.model.station import StationStatus
from trihedral.network.decision.strangers import reject_links_to_strangers
from trihedral.network.solve import solve


def test_a_scan_of_another_storey_is_not_tied_by_the_one_link_whose_appearance_is_unknown():
    # Station 3 is of another storey: it agrees in shape with 0 and 1 but looks otherwise; with 2, that is unknown.
    pairs = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    refused = {(0, 3): LinkVerdict.REFUSED, (1, 3): LinkVerdict.REFUSED}
    _, members, links = network(4, pairs, verdicts=refused)
    similarity = {(0, 1): 1.1, (1, 2): 0.9, (0, 2): 1.0, (0, 3): 0.1, (1, 3): 0.2, (2, 3): None}
    links = [
        replace(link, evidence=replace(link.evidence, appearance_similarity=similarity[pair]))
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
        replace(link, evidence=replace(link.evidence, appearance_similarity=similarity[k]))
        for k, link in enumerate(links)
    ]
    after = reject_links_to_strangers(closed(members, links)).state
    assert [link.accepted for link in after.links] == [True, True, False, False]
    assert "s0 and s3" in after.links[2].reason
    # Where the two look the same it has nothing to say.
    links[3] = replace(links[3], evidence=replace(links[3].evidence, appearance_similarity=0.9))
    state = closed(members, links)
    assert reject_links_to_strangers(state).state is state
