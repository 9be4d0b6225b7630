"""Links in doubt are accepted where the poses of the others confirm them."""

from dataclasses import replace

import numpy as np

from support.links import with_pose
from support.networks import SIGMA_T, closed, errors, network
from trihedral.geometry.se3 import motion
from trihedral.model.link import LinkVerdict
from trihedral.network.decision.doubtful_links import confirm_doubtful_links
from trihedral.network.solve import solve


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


def test_the_rule_takes_the_pose_that_agrees_and_leaves_what_was_seen_to_be_empty():
    pairs = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    _, members, links = network(4, pairs, verdicts={(2, 3): LinkVerdict.AMBIGUOUS})
    elsewhere = with_pose(links[-1], motion(None, np.array([3.0, 0.0, 0.0])) @ links[-1].transform)
    links[-1] = replace(elsewhere, alternatives=(links[-1].estimate,))
    found = confirm_doubtful_links(closed(members, links)).state.links[-1]
    assert found.accepted and found.confirmed_by_loops
    np.testing.assert_array_equal(found.transform, links[-1].alternatives[0].transform)
    links[-1] = replace(links[-1], evidence=replace(links[-1].evidence, contradicted=True))
    assert not confirm_doubtful_links(closed(members, links)).state.links[-1].accepted
