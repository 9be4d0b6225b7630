"""Ambiguous links: loops decide between their poses where they can, and only there."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.networks import SIGMA_R, SIGMA_T, build, errors
from scipy.spatial.transform import Rotation

from support.networks import closed
from trihedral.geometry.se3 import inverse, motion
from trihedral.model.link import LinkVerdict, PoseEstimate, Residuals
from trihedral.model.station import StationStatus
from trihedral.network.decision.alternatives import choose_alternatives
from trihedral.network.solve import solve

STATION = 12
COVARIANCE = np.diag([SIGMA_R**2] * 3 + [SIGMA_T**2] * 3)


def ambiguous(network, poses_of):
    """Ambiguous links of one station: of each, where along x (m) its poses put the station, best first; in turn."""
    number = {m.name: k for k, m in enumerate(network.members)}
    rng = np.random.default_rng(1)
    links, own = list(network.links), []
    for index, link in enumerate(links):
        a, b = number[link.from_station], number[link.to_station]
        if STATION not in (a, b):
            continue
        poses = []
        for shift in poses_of[len(own) % len(poses_of)]:
            moved = {STATION: motion(None, np.array([shift, 0.0, 0.0])) @ network.poses[STATION]}
            noise = motion(
                Rotation.from_rotvec(SIGMA_R * rng.normal(size=3)).as_matrix(), SIGMA_T * rng.normal(size=3)
            )
            poses.append(noise @ inverse(moved.get(b, network.poses[b])) @ moved.get(a, network.poses[a]))
        links[index] = replace(
            link,
            verdict=LinkVerdict.AMBIGUOUS,
            reason="another pose explains the scans 80% as well",
            estimate=PoseEstimate(poses[0], link.covariance),
            alternatives=tuple(
                PoseEstimate(pose, COVARIANCE, Residuals(0.001, 0.001, 0.002, 0.003)) for pose in poses[1:]
            ),
        )
        own.append(index)
    return links, own


@pytest.fixture
def network():
    return build(25, links_a_station=5, seed=2)


def test_the_pose_that_all_links_have_is_taken_even_where_it_is_the_second(network):
    links, own = ambiguous(network, [(6.0, 0.0), (0.0, -6.0), (12.0, 0.0)])
    result = solve(network.members, links)
    assert result.stations[STATION].status is StationStatus.VERIFIED
    assert max(errors(network, result).values()) < 0.01
    for index in own:
        link = result.links[index]
        assert link.accepted and link.confirmed_by_loops
    first = result.links[own[0]]
    # The pose that it had is still there, as the other one; its figures of fit are those of the pose taken.
    np.testing.assert_array_equal(first.alternatives[0].transform, links[own[0]].transform)
    assert first.estimate.residuals == Residuals(0.001, 0.001, 0.002, 0.003)


def test_two_poses_that_all_links_have_stay_ambiguous(network):
    links, own = ambiguous(network, [(0.0, 6.0), (6.0, 0.0)])
    result = solve(network.members, links)
    assert (
        result.stations[STATION].status is StationStatus.AMBIGUOUS and result.stations[STATION].pose is None
    )
    assert not any(result.links[index].accepted for index in own)


def test_one_ambiguous_link_decides_nothing(network):
    links, own = ambiguous(network, [(0.0, 6.0)])
    kept = [link for index, link in enumerate(links) if index not in own[1:]]
    assert solve(network.members, kept).stations[STATION].pose is None


def test_a_majority_that_is_not_clear_decides_nothing(network):
    links, own = ambiguous(network, [(0.0,), (0.0, 6.0), (6.0,)])
    assert len(own) >= 6
    assert solve(network.members, links).stations[STATION].pose is None


def test_the_rule_accepts_the_links_that_agree_and_leaves_what_was_given_up(network):
    links, own = ambiguous(network, [(6.0, 0.0), (0.0, -6.0), (12.0, 0.0)])
    state = closed(network.members, links)
    assert all(choose_alternatives(state).state.links[index].accepted for index in own)
    left = choose_alternatives(replace(state, given_up=frozenset(own))).state
    assert not any(left.links[index].accepted for index in own)
