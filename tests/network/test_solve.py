"""Consistency and adjustment on networks with known poses."""

import numpy as np
import pytest

from support.links import with_covariance
from support.networks import FULL, SIGMA_T, errors, network
from trihedral.geometry.se3 import inverse
from trihedral.model.link import LinkVerdict
from trihedral.model.station import StationStatus
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.options import NetworkOptions
from trihedral.network.solve import believed, solve


def test_a_clean_network_is_placed_and_verified():
    poses, members, links = network(5, FULL)
    result = solve(members, links)
    assert all(s.status is StationStatus.VERIFIED for s in result.stations)
    assert max(errors(result, poses)) < 4 * SIGMA_T
    assert all(loop.ok for loop in result.loops)
    assert len(result.loops) == 10


def test_a_wrong_link_in_a_long_loop_leaves_no_station_verified_by_it():
    ring = [(0, 1), (1, 2), (2, 3), (3, 4), (0, 4)]
    _, members, links = network(5, ring, wrong={(2, 3)})
    result = solve(members, links)
    assert sum(link.accepted for link in result.links) == 4
    assert not any(s.status is StationStatus.VERIFIED for s in result.stations)


def test_a_chain_is_single_linked_and_says_so():
    _, members, links = network(4, [(0, 1), (1, 2), (2, 3)])
    result = solve(members, links)
    assert all(s.status is StationStatus.SINGLE_LINKED and s.reason for s in result.stations)
    assert result.loops == ()


def test_sigmas_grow_along_a_chain_and_agree_with_the_scatter():
    offsets, predicted = [], []
    for seed in range(60):
        poses, members, links = network(3, [(0, 1), (1, 2)], seed=seed)
        result = solve(members, links)
        anchor = next(k for k, s in enumerate(result.stations) if np.allclose(s.pose, np.eye(4)))
        assert anchor == 1, "the station with most links defines the frame"
        for k in (0, 2):
            true = inverse(poses[1]) @ poses[k]
            offsets.append(result.stations[k].pose[:3, 3] - true[:3, 3])
            predicted.append(result.stations[k].sigma_translation_m)
    scatter = np.sqrt(np.mean(np.square(offsets)))
    assert scatter == pytest.approx(np.sqrt(np.mean(np.square(predicted))), rel=0.2)


def test_links_that_contradict_each_other_by_more_than_they_say_make_sigmas_larger():
    pairs = [(a, b) for a in range(8) for b in range(a + 1, 8)]
    _, members, links = network(8, pairs, seed=3)
    thirds = [with_covariance(link, link.covariance / 9) for link in links]

    def sigmas(of):
        options = NetworkOptions(systematic_translation=0.0, systematic_rotation=0.0)
        return np.array([s.sigma_translation_m for s in solve(members, of, options).stations])

    # 28 links, 7 stations to place: 126 redundant observations tell the variance to 13 %, a sigma to 7 %.
    honest, confident = sigmas(links), sigmas(thirds)
    moved = honest > 0
    assert np.all(np.abs(confident[moved] / honest[moved] - 1) < 0.2)


def test_two_parts_stay_apart():
    _, members, links = network(5, [(0, 1), (1, 2), (0, 2), (3, 4)])
    result = solve(members, links)
    assert [s.component for s in result.stations] == [0, 0, 0, 1, 1]
    assert result.stations[3].tied and "nothing ties" in result.stations[3].reason


def test_a_station_without_links_is_not_placed_with_its_reason():
    _, members, links = network(3, [(0, 1), (1, 2)], verdicts={(1, 2): LinkVerdict.AMBIGUOUS})
    station = solve(members, links).stations[2]
    assert station.pose is None and station.status is StationStatus.AMBIGUOUS and "in doubt" in station.reason


def test_one_scan_alone_defines_the_frame():
    _, members, _ = network(1, [])
    (station,) = solve(members, []).stations
    assert np.array_equal(station.pose, np.eye(4))


def test_scanners_away_from_their_origin():
    origin = (1000.0, 2000.0, 50.0)
    poses, members, links = network(5, FULL, origin=origin)
    result = solve(members, links)
    assert all(s.status is StationStatus.VERIFIED for s in result.stations)
    assert max(errors(result, poses, origin)) < 4 * SIGMA_T


def test_what_is_believed_of_links_is_what_the_result_says_of_them():
    _, members, links = network(5, FULL, wrong=[(1, 3)], verdicts={(0, 4): LinkVerdict.DOUBTFUL})
    found = believed(members, links, NetworkOptions(), Constraints())
    of = {(link.from_station, link.to_station): link.verdict for link in found}
    assert of["s1", "s3"] is LinkVerdict.REFUSED, "loops speak against it"
    assert of["s0", "s4"] is LinkVerdict.ACCEPTED, "loops confirm it"
    assert [link.verdict for link in found] == [link.verdict for link in solve(members, links).links]
