"""Consistency and adjustment on networks with known poses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.links import evidence, link, with_covariance, with_pose
from trihedral.geometry.se3 import distance, inverse, motion
from trihedral.model.link import LinkVerdict
from trihedral.model.station import Station, StationStatus
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.options import NetworkOptions
from trihedral.network.solve import believed, solve
from trihedral.scan import ScanHeader

SIGMA_T, SIGMA_R = 0.002, 1e-4


def network(count, pairs, seed=0, wrong=(), verdicts=None, origin=(0.0, 0.0, 0.0)):
    """Members in a ring of known poses and links with noise; those in `wrong` are off by 3 m."""
    rng = np.random.default_rng(seed)
    poses = [
        motion(
            Rotation.from_euler(
                "zyx", [rng.uniform(-3, 3), 0.02 * rng.normal(), 0.02 * rng.normal()]
            ).as_matrix(),
            np.array([15 * np.cos(k), 15 * np.sin(k), 0.3 * k]),
        )
        for k in range(count)
    ]
    origin = np.array(origin)
    members = [
        Station(
            f"s{k}",
            ScanHeader(
                Path(f"s{k}.e57"), 0, f"s{k}", "e57", 1, None, False, False, 0, None, origin, True, "m", True
            ),
            1000,
            f"{k:02d}",
        )
        for k in range(count)
    ]
    covariance = np.diag([SIGMA_R**2] * 3 + [SIGMA_T**2] * 3)
    links = []
    for a, b in pairs:
        small = motion(
            Rotation.from_rotvec(SIGMA_R * rng.normal(size=3)).as_matrix(), SIGMA_T * rng.normal(size=3)
        )
        between = small @ inverse(poses[b]) @ poses[a]
        if (a, b) in wrong:
            between = motion(None, np.array([3.0, 0.0, 0.0])) @ between
        verdict = (verdicts or {}).get((a, b), LinkVerdict.ACCEPTED)
        links.append(
            link(
                f"s{a}",
                f"s{b}",
                motion(None, origin) @ between @ motion(None, -origin),
                covariance,
                verdict,
                evidence=evidence(0.5 + 0.01 * len(links)),
            )
        )
    return poses, members, links


def errors(result, poses, origin=(0.0, 0.0, 0.0)):
    """Translation errors (m) against the truth in the frame of the first placed station."""
    shift = motion(None, -np.array(origin))
    placed = [(k, s) for k, s in enumerate(result.stations) if s.pose is not None]
    first, anchor = placed[0]
    found = []
    for k, station in placed:
        estimated = shift @ inverse(anchor.pose) @ station.pose @ inverse(shift)
        found.append(distance(inverse(poses[first]) @ poses[k], estimated)[0])
    return found


FULL = [(a, b) for a in range(5) for b in range(a + 1, 5)]


def test_a_clean_network_is_placed_and_verified():
    poses, members, links = network(5, FULL)
    result = solve(members, links)
    assert all(s.status is StationStatus.VERIFIED for s in result.stations)
    assert max(errors(result, poses)) < 4 * SIGMA_T
    assert all(loop.ok for loop in result.loops)
    assert len(result.loops) == 10


@pytest.mark.parametrize("bad", [(0, 1), (2, 4), (1, 3)])
def test_one_wrong_link_is_refused_and_named_and_the_rest_unharmed(bad):
    poses, members, links = network(5, FULL, wrong={bad})
    result = solve(members, links)
    refused = [link for link in result.links if link.verdict is LinkVerdict.REFUSED]
    assert [(link.from_station, link.to_station) for link in refused] == [(f"s{bad[0]}", f"s{bad[1]}")]
    assert "misses its start by" in refused[0].reason
    assert max(errors(result, poses)) < 4 * SIGMA_T


@pytest.mark.parametrize("pairs", [FULL, [(0, 1), (1, 2), (2, 3), (3, 4), (0, 4)]])
def test_loops_close_within_what_links_say_of_themselves_and_not_within_a_decimetre(pairs):
    poses, members, links = network(5, pairs)
    assert all(link.accepted for link in solve(members, links).links)
    # Some ten times what the loops are expected to miss by.
    links[-1] = with_pose(links[-1], motion(None, np.array([0.0, 0.1, 0.0])) @ links[-1].transform)
    result = solve(members, links)
    assert sum(not link.accepted for link in result.links) == 1
    assert pairs != FULL or max(errors(result, poses)) < 4 * SIGMA_T


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


def test_a_link_in_doubt_that_loops_confirm_is_accepted_and_a_wrong_one_is_not():
    right = {(0, 3): LinkVerdict.AMBIGUOUS}
    _, members, links = network(4, [(0, 1), (1, 2), (0, 2), (2, 3), (1, 3), (0, 3)], verdicts=right)
    assert all(link.accepted for link in solve(members, links).links)
    _, members, links = network(
        4, [(0, 1), (1, 2), (0, 2), (2, 3), (1, 3), (0, 3)], verdicts=right, wrong={(0, 3)}
    )
    assert solve(members, links).links[-1].verdict is LinkVerdict.AMBIGUOUS


def test_a_link_in_doubt_that_is_off_by_some_centimetres_stays_in_doubt():
    pairs = [(0, 1), (1, 2), (0, 2), (2, 3), (1, 3), (0, 3)]
    poses, members, links = network(4, pairs, verdicts={(0, 3): LinkVerdict.DOUBTFUL})
    # Loops close within 3 cm, whatever links say of themselves.
    links[-1] = with_pose(links[-1], motion(None, np.array([0.025, 0.0, 0.0])) @ links[-1].transform)
    result = solve(members, links)
    assert [link.accepted for link in result.links] == [True] * 5 + [False]
    assert result.links[-1].verdict is LinkVerdict.DOUBTFUL
    assert max(errors(result, poses)) < 4 * SIGMA_T


@pytest.mark.parametrize(("probability", "verified"), [(0.7, False), (0.3, True)])
def test_a_pose_that_loops_chose_against_a_likelier_one_verifies_nothing(probability, verified):
    # One link holds station 3 by itself; the others agree with it, one of them by a pose that is less likely.
    pairs = [(0, 1), (1, 2), (0, 2), (2, 3), (1, 3), (0, 3)]
    verdicts = {(1, 3): LinkVerdict.DOUBTFUL, (0, 3): LinkVerdict.AMBIGUOUS}
    _, members, links = network(4, pairs, verdicts=verdicts)
    elsewhere = motion(None, np.array([3.0, 0.0, 0.0])) @ links[-1].transform
    links[-1] = replace(
        with_pose(links[-1], elsewhere),
        alternatives=(links[-1].estimate,),
        evidence=replace(links[-1].evidence, probability=probability),
    )
    result = solve(members, links)
    assert all(link.accepted for link in result.links)
    assert (result.stations[3].status is StationStatus.VERIFIED) is verified
    assert verified or "s0 - s3 by itself would have it elsewhere" in result.stations[3].reason


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


def test_what_is_believed_of_links_is_what_the_result_says_of_them():
    _, members, links = network(5, FULL, wrong=[(1, 3)], verdicts={(0, 4): LinkVerdict.DOUBTFUL})
    found = believed(members, links, NetworkOptions(), Constraints())
    of = {(link.from_station, link.to_station): link.verdict for link in found}
    assert of["s1", "s3"] is LinkVerdict.REFUSED, "loops speak against it"
    assert of["s0", "s4"] is LinkVerdict.ACCEPTED, "loops confirm it"
    assert [link.verdict for link in found] == [link.verdict for link in solve(members, links).links]
