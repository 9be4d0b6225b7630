"""What links err by beside what they say, and the sigmas that follow from it."""

import numpy as np
import pytest
from benchmarks.networks import build
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import inverse, motion
from trihedral.network.adjustment.systematic import Systematic, estimate, with_systematic
from trihedral.network.graph.edge import Edge
from trihedral.network.solve import solve

ASSUMED = Systematic(0.0005, 2e-5)
NOTHING = Systematic(0.0, 0.0)


def edges_of(network):
    number = {m.name: k for k, m in enumerate(network.members)}
    edges = [
        Edge(number[k.from_station], number[k.to_station], k.transform, k.covariance, 1.0)
        for k in network.links
    ]
    return with_systematic(edges, NOTHING, ASSUMED)


def uneven(seed, scale=1.0, translation=0.0, rotation=0.0):
    """Links whose own sigmas differ by ten times, and which err by more."""
    rng = np.random.default_rng(seed)
    network = build(30, seed=seed)
    edges = []
    for edge in edges_of(network):
        size = 10 ** rng.uniform(-0.5, 0.5)
        own = size**2 * np.diag([5e-5**2] * 3 + [0.001**2] * 3)
        errs = scale * own + np.diag([rotation**2] * 3 + [translation**2] * 3)
        xi = np.linalg.cholesky(errs) @ rng.normal(size=6)
        noise = motion(Rotation.from_rotvec(xi[:3]).as_matrix(), xi[3:])
        between = noise @ inverse(network.poses[edge.b]) @ network.poses[edge.a]
        edges.append(Edge(edge.a, edge.b, between, own, 1.0))
    return with_systematic(edges, NOTHING, ASSUMED)


@pytest.mark.parametrize(
    "true", [Systematic(0.003, 2e-5), Systematic(0.0005, 3e-4), Systematic(0.0005, 2e-5, 4.0)]
)
def test_what_links_err_by_is_found(true):
    found = [
        estimate([uneven(seed, true.scale, true.translation, true.rotation)], ASSUMED) for seed in range(4)
    ]
    # 120 loops each tell a variance to about 12 %; four of them, what the three take from each other, and what is
    # assumed being the least.
    assert np.mean([f.translation for f in found]) == pytest.approx(true.translation, rel=0.2)
    assert np.mean([f.rotation for f in found]) == pytest.approx(true.rotation, rel=0.2)
    assert np.mean([f.scale for f in found]) == pytest.approx(true.scale, rel=0.2)


def test_loops_that_close_better_than_expected_prove_nothing():
    found = estimate([edges_of(build(40, seed=1))], Systematic(0.005, 1e-3))
    assert found == Systematic(0.005, 1e-3)


def test_without_loops_what_is_assumed_stays():
    tree = edges_of(build(12, seed=2))[:3]
    assert estimate([tree, []], ASSUMED) == ASSUMED


def test_sigmas_cover_errors_of_links_that_say_too_little():
    squares = []
    for seed in range(12):
        network = build(20, seed=seed, more=(0.004, 3e-4))
        result = solve(network.members, network.links)
        base = next(
            k for k, s in enumerate(result.stations) if s.pose is not None and not any(s.sigma_translation_m)
        )
        for k, station in enumerate(result.stations):
            if k == base or station.pose is None:
                continue
            true = inverse(network.poses[base]) @ network.poses[k]
            turn = Rotation.from_matrix(station.pose[:3, :3] @ true[:3, :3].T).as_rotvec()
            squares += np.square(turn / np.radians(station.sigma_rotation_deg)).tolist()
            squares += np.square((station.pose - true)[:3, 3] / station.sigma_translation_m).tolist()
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)
