"""Poses along links, and links between scanners."""

from dataclasses import replace

import numpy as np
from benchmarks.networks import build, header

from trihedral.geometry.se3 import inverse, transform
from trihedral.network.graph.chained_poses import chained_poses
from trihedral.network.graph.scanner_frames import between_scanners, between_stations


def test_poses_are_chained_over_the_fewest_links_from_where_they_lead():
    poses = build(5, seed=1).poses
    # A chain 0 - 1 - 2 - 3, and a longer way from 1 to 2 over 4, which is wrong.
    steps = {a: [(b, inverse(poses[a]) @ poses[b])] for a, b in ((0, 1), (2, 3), (3, 2))}
    steps[1] = [(4, inverse(poses[1]) @ poses[4]), (2, inverse(poses[1]) @ poses[2])]
    steps[4] = [(2, np.eye(4))]
    found = chained_poses(0, steps)
    assert sorted(found) == [0, 1, 2, 3, 4]
    for station, pose in found.items():
        np.testing.assert_allclose(pose, inverse(poses[0]) @ poses[station], atol=1e-12)
    assert sorted(chained_poses(2, steps)) == [2, 3], "steps lead one way"


def test_a_pose_between_scanners_takes_one_scanner_where_the_stations_pose_takes_it():
    network = build(2, links_a_station=1, seed=1)
    a, b = (
        replace(m, header=header(m.name, origin))
        for m, origin in zip(network.members, [(1.0, 2.0, 3.0), (-4.0, 5.0, 6.0)], strict=True)
    )
    pose = inverse(network.poses[1]) @ network.poses[0]
    centred = between_scanners(pose, a, b)
    place = transform(pose, a.header.scanner_origin[None])[0] - b.header.scanner_origin
    np.testing.assert_allclose(centred[:3, 3], place, atol=1e-12)
    np.testing.assert_allclose(between_stations(centred, a, b), pose, atol=1e-12)
