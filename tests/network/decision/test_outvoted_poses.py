"""A pose that loops chose against a likelier one speaks for no station."""

from dataclasses import replace

import numpy as np
import pytest

from support.links import with_pose
from support.networks import FULL, closed, network
from trihedral.geometry.se3 import motion
from trihedral.model.link import LinkVerdict
from trihedral.model.station import StationStatus
from trihedral.network.decision.outvoted_poses import doubt_outvoted_poses
from trihedral.network.solve import solve


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


def test_the_rule_doubts_stations_that_few_other_links_hold():
    _, members, links = network(3, [(0, 1), (1, 2), (0, 2)])
    state = replace(closed(members, links), outvoted=frozenset({2}))
    doubts = doubt_outvoted_poses(state).doubts
    assert set(doubts) == {0, 2} and "s0 - s2 by itself" in doubts[0]
    _, members, links = network(5, FULL)
    assert not doubt_outvoted_poses(replace(closed(members, links), outvoted=frozenset({2}))).doubts
