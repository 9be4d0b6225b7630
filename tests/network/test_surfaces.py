"""Surfaces compared where all scans put them, with pairs that stopped before they fitted best."""

from dataclasses import replace

import numpy as np
from benchmarks.networks import SIGMA_R, SIGMA_T, build, errors
from scipy.spatial.transform import Rotation

from trihedral.geometry.motion import inverse, motion
from trihedral.network.consistency import Edge
from trihedral.network.solve import solve
from trihedral.network.surfaces import compared_anew
from trihedral.network.systematic import Systematic

COVARIANCE = np.diag([SIGMA_R**2] * 3 + [SIGMA_T**2] * 3)


def test_a_pair_that_stopped_too_early_does_not_hold_the_others_back():
    """Each comparison goes half of the way to its pair's best pose, as point to plane does along weak directions."""
    network = build(12, seed=3)
    number = {m.name: k for k, m in enumerate(network.members)}
    rng = np.random.default_rng(3)
    best, links = {}, []
    for link in network.links:
        ends = number[link.from_station], number[link.to_station]
        true = inverse(network.poses[ends[1]]) @ network.poses[ends[0]]
        best[ends] = motion(None, 1e-4 * rng.normal(size=3)) @ true
        stopped = motion(None, np.array([0.004, 0.0, 0.0]) * rng.choice([-1, 1])) @ best[ends]
        links.append(type(link)(**{**vars(link), "transform": stopped}))

    def surfaces(a, b, pose):
        left = best[a, b] @ inverse(pose)
        half = Rotation.from_rotvec(0.5 * Rotation.from_matrix(left[:3, :3]).as_rotvec()).as_matrix()
        return motion(half, 0.5 * left[:3, 3]) @ pose, COVARIANCE

    alone = max(errors(network, solve(network.members, links)).values())
    together = max(errors(network, solve(network.members, links, surfaces=surfaces)).values())
    assert alone > 0.0015
    assert together < 0.0005


def test_surfaces_are_not_asked_far_from_where_the_pair_fits():
    network = build(12, seed=3)
    number = {m.name: k for k, m in enumerate(network.members)}
    edges = [
        Edge(number[k.from_station], number[k.to_station], k.transform, k.covariance, 1.0)
        for k in network.links
    ]
    edges[5] = replace(edges[5], transform=motion(None, np.array([0.05, 0.0, 0.0])) @ edges[5].transform)
    asked = set()

    def surfaces(a, b, pose):
        asked.add((a, b))
        return pose, COVARIANCE

    found = compared_anew(edges, surfaces, Systematic(0.0, 0.0))
    assert asked == {edge.ends for edge in edges} - {edges[5].ends}
    assert found[5] is edges[5]
