"""Wrong links that agree with each other: refused when clearly outvoted, else nobody is sure."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.networks import build, errors, places

from support.links import with_pose
from support.networks import closed
from trihedral.geometry.se3 import inverse, motion
from trihedral.model.link import LinkVerdict
from trihedral.model.station import StationStatus
from trihedral.network.decision.contested_components import give_up_contested_components
from trihedral.network.solve import solve

BAY = motion(None, np.array([6.0, 0.0, 0.0]))


def shifted(network, moves):
    """Links as they are if some stations, for some of their links only, stood a bay further along x."""
    number = {m.name: k for k, m in enumerate(network.members)}
    links = list(network.links)
    for index, (moved, _) in moves.items():
        link = links[index]
        a, b = number[link.from_station], number[link.to_station]
        here, there = (BAY @ network.poses[k] if k in moved else network.poses[k] for k in (a, b))
        links[index] = with_pose(link, inverse(there) @ here)
    return links


def around(network, stations):
    """Numbers of the links between some stations and the others."""
    names = {network.members[k].name for k in stations}
    return [
        k
        for k, link in enumerate(network.links)
        if (link.from_station in names) != (link.to_station in names)
    ]


def test_a_station_that_two_bays_claim_alike_is_ambiguous_with_both_poses():
    network = build(25, links_a_station=5, seed=2)
    station = max(range(25), key=lambda k: len(around(network, {k})))
    own = around(network, {station})
    links = shifted(network, {k: ({station}, None) for k in own[: len(own) // 2]})
    result = solve(network.members, links)
    assert result.stations[station].status is StationStatus.AMBIGUOUS
    assert result.stations[station].pose is None
    for k in own:
        assert result.links[k].verdict is LinkVerdict.AMBIGUOUS and "6.00 m" in result.links[k].reason
        # The other pose of a link is a bay from its own.
        (other,) = result.links[k].alternatives
        apart = np.linalg.norm(other.transform[:3, 3] - result.links[k].transform[:3, 3])
        assert apart == pytest.approx(6.0, abs=0.02)
    assert sum(s.status is StationStatus.VERIFIED for s in result.stations) == 24
    assert max(errors(network, result).values()) < 0.01


def test_two_wrong_links_of_many_are_refused_and_the_station_stays():
    network = build(25, links_a_station=5, seed=2)
    station = max(range(25), key=lambda k: len(around(network, {k})))
    own = around(network, {station})
    assert len(own) >= 7
    result = solve(network.members, shifted(network, {k: ({station}, None) for k in own[:2]}))
    assert [k for k, link in enumerate(result.links) if link.verdict is LinkVerdict.REFUSED] == own[:2]
    assert all(s.status is StationStatus.VERIFIED for s in result.stations)
    assert max(errors(network, result).values()) < 0.01


def test_a_wing_that_half_of_its_links_put_elsewhere_keeps_its_own_frame():
    network = build(30, links_a_station=5, seed=3)
    wing = {k for k, place in enumerate(places(30)) if place[0] > 28}
    across = around(network, wing)
    result = solve(network.members, shifted(network, dict.fromkeys(across[::2], (wing, None))))
    assert not any(result.links[k].accepted for k in across)
    assert {result.stations[k].component for k in wing} == {1}
    assert {s.component for k, s in enumerate(result.stations) if k not in wing} == {0}
    assert "own frame" in result.stations[min(wing)].reason


def test_two_links_against_one_are_not_sure():
    network = build(25, links_a_station=5, seed=2)
    station = 12
    own = around(network, {station})
    links = shifted(network, {own[0]: ({station}, None)})
    kept = [link for k, link in enumerate(links) if k not in own[3:]]
    result = solve(network.members, kept)
    found = result.stations[station]
    assert found.status is StationStatus.SINGLE_LINKED and "speaks against" in found.reason
    assert sum(s.status is StationStatus.VERIFIED for s in result.stations) == 24


def test_scans_of_another_building_are_their_own_part():
    network = build(20, seed=4)
    strangers = {5, 11, 17}
    names = {network.members[k].name for k in strangers}
    inside = [k for k in network.links if (k.from_station in names) == (k.to_station in names)]
    number = {m.name: k for k, m in enumerate(network.members)}
    template = network.links[0]
    for a, b in ((5, 11), (11, 17), (5, 17)):
        if not any({number[k.from_station], number[k.to_station]} == {a, b} for k in inside):
            names_of = network.members[a].name, network.members[b].name
            between = inverse(network.poses[b]) @ network.poses[a]
            inside.append(
                replace(with_pose(template, between), from_station=names_of[0], to_station=names_of[1])
            )
    result = solve(network.members, inside)
    assert {k for k, s in enumerate(result.stations) if s.component == 1} == strangers
    assert all("own frame" in result.stations[k].reason for k in strangers)
    assert sum(s.component == 0 for s in result.stations) == 17


def test_the_rule_gives_up_all_links_of_a_station_that_two_bays_claim_alike():
    network = build(25, links_a_station=5, seed=2)
    station = max(range(25), key=lambda k: len(around(network, {k})))
    own = around(network, {station})
    links = shifted(network, {k: ({station}, None) for k in own[: len(own) // 2]})
    outcome = give_up_contested_components(closed(network.members, links))
    assert outcome.state.given_up and outcome.state.given_up <= set(own)
    assert all(outcome.state.links[k].verdict is LinkVerdict.AMBIGUOUS for k in outcome.state.given_up)
    assert set(outcome.doubts) == {station}
