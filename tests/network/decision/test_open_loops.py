"""Loops close, or a link is refused that keeps them open."""

from dataclasses import replace

import numpy as np
import pytest

from support.links import with_pose
from support.networks import FULL, SIGMA_T, closed, errors, network
from trihedral.geometry.se3 import motion
from trihedral.model.link import LinkVerdict
from trihedral.network.decision.open_loops import reject_open_loops
from trihedral.network.solve import solve


@pytest.mark.parametrize("pairs", [FULL, [(0, 1), (1, 2), (2, 3), (3, 4), (0, 4)]])
def test_loops_close_within_what_links_say_of_themselves_and_not_within_a_decimetre(pairs):
    poses, members, links = network(5, pairs)
    assert all(link.accepted for link in solve(members, links).links)
    # Some ten times what the loops are expected to miss by.
    links[-1] = with_pose(links[-1], motion(None, np.array([0.0, 0.1, 0.0])) @ links[-1].transform)
    result = solve(members, links)
    assert sum(not link.accepted for link in result.links) == 1
    assert pairs != FULL or max(errors(result, poses)) < 4 * SIGMA_T


@pytest.mark.parametrize("bad", [(0, 1), (2, 4), (1, 3)])
def test_one_wrong_link_is_refused_and_named_and_the_rest_unharmed(bad):
    poses, members, links = network(5, FULL, wrong={bad})
    result = solve(members, links)
    refused = [link for link in result.links if link.verdict is LinkVerdict.REFUSED]
    assert [(link.from_station, link.to_station) for link in refused] == [(f"s{bad[0]}", f"s{bad[1]}")]
    assert "misses its start by" in refused[0].reason
    assert max(errors(result, poses)) < 4 * SIGMA_T


def test_the_rule_refuses_what_loops_speak_against_and_says_if_a_person_forced_it():
    _, members, links = network(5, FULL, wrong={(0, 1)})
    links[0] = replace(links[0], decision="forced")
    after = reject_open_loops(closed(members, links)).state
    assert [link.verdict is LinkVerdict.REFUSED for link in after.links] == [True] + [False] * 9
    assert after.links[0].reason.startswith("it was forced, but the loop s")


def test_a_right_link_that_was_refused_before_the_wrong_one_is_taken_back():
    # In the loop 0 - 1 - 2 - 3 the weakest is refused first: 0 - 1. The loop 2 - 3 - 4 - 5 then speaks against
    # 2 - 3, the strongest: triangles bear the other three out.
    triangles = [(3, 4), (4, 5), (2, 5), (3, 6), (4, 6), (4, 7), (5, 7), (2, 8), (5, 8)]
    _, members, links = network(9, [(0, 1), (1, 2), (0, 3), *triangles, (2, 3)], wrong={(2, 3)})
    assert [edge.ends for edge, _ in closed(members, links).loops.refused] == [(2, 3)]
