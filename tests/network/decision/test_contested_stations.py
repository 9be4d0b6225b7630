"""Links that were given up bear out nothing, and count against what is left."""

from dataclasses import replace

import numpy as np
import pytest

from support.links import with_pose
from support.networks import FULL, closed, network
from trihedral.geometry.se3 import motion
from trihedral.model.link import LinkVerdict
from trihedral.network.decision.contested_stations import doubt_contested_stations


@pytest.mark.parametrize(("count", "doubted"), [(4, {0, 1}), (6, set())])
def test_the_rule_doubts_stations_with_few_links_beside_those_given_up(count, doubted):
    pairs = [(a, b) for a in range(count) for b in range(a + 1, count)]
    _, members, links = network(count, pairs, verdicts={(0, 1): LinkVerdict.AMBIGUOUS})
    doubts = doubt_contested_stations(replace(closed(members, links), given_up=frozenset({0}))).doubts
    assert set(doubts) == doubted
    assert all("1 of its links could not be told" in why for why in doubts.values())


def test_the_rule_doubts_a_station_that_links_given_up_have_elsewhere():
    # Station 4 is held by three links; two that were given up have it 3 m away.
    pairs = [
        *((a, b) for a, b in FULL if b < 4),
        *((k, 5) for k in range(4)),
        *((k, 4) for k in range(4)),
        (4, 5),
    ]
    elsewhere = {(0, 4), (1, 4)}
    _, members, links = network(6, pairs, verdicts=dict.fromkeys(elsewhere, LinkVerdict.AMBIGUOUS))
    away = motion(None, np.array([3.0, 0.0, 0.0]))
    poses, _, _ = network(6, pairs)
    for k, pair in enumerate(pairs):
        if pair in elsewhere:
            turned = poses[4][:3, :3].T @ away[:3, 3]
            links[k] = with_pose(links[k], motion(None, turned) @ links[k].transform)
    given_up = frozenset(k for k, pair in enumerate(pairs) if pair in elsewhere)
    doubts = doubt_contested_stations(replace(closed(members, links), given_up=given_up)).doubts
    assert doubts[4] == "links that would have it elsewhere were not outvoted clearly"
