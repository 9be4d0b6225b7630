"""The adjustment against SciPy's dense least squares, gtsam's pose graph and plain repetition."""

import gtsam
import numpy as np
import pytest
from benchmarks.networks import build
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import inverse, motion
from trihedral.network.adjustment.adjustment import adjust
from trihedral.network.adjustment.observations import (
    Level,
    Observations,
    PointObservation,
    PointPrior,
    PosePrior,
)
from trihedral.network.graph.edge import Edge

RNG = np.random.default_rng(8)


def small(xi):
    return motion(Rotation.from_rotvec(xi[:3]).as_matrix(), np.asarray(xi[3:], dtype=float))


def left(transform):
    return np.concatenate([Rotation.from_matrix(transform[:3, :3]).as_rotvec(), transform[:3, 3]])


def correlated(sigma_r, sigma_t):
    root = RNG.normal(size=(6, 6)) * 0.4 + 2 * np.eye(6)
    scale = np.diag([sigma_r] * 3 + [sigma_t] * 3)
    return scale @ root @ root.T @ scale


PAIRS = [(0, 1), (1, 2), (2, 0), (3, 2), (3, 4), (4, 0), (4, 5), (5, 1)]
TRUE = [
    small([*RNG.normal(scale=0.05, size=2), RNG.uniform(-3, 3), *RNG.normal(scale=10, size=3)])
    for _ in range(6)
]


def edges_of(pairs):
    result = []
    for a, b in pairs:
        covariance = correlated(1e-4, 2e-3)
        noise = small(np.linalg.cholesky(covariance) @ RNG.normal(size=6))
        result.append(Edge(a, b, noise @ inverse(TRUE[b]) @ TRUE[a], covariance, 1.0))
    return result


EDGES = edges_of(PAIRS)


def dense(edges, known, count=6, anchor=None):
    """The same problem written out for SciPy: poses about the true ones, numerical derivatives."""
    points = [point.point for point in known.point_priors]
    free = [k for k in range(count) if k != anchor]

    def poses(x):
        steps = dict(zip(free, x[: 6 * len(free)].reshape(-1, 6), strict=True))
        moved = [TRUE[k].copy() for k in range(count)]
        for k, step in steps.items():
            moved[k][:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ TRUE[k][:3, :3]
            moved[k][:3, 3] += step[3:]
        return moved

    def residuals(x):
        at, places = poses(x), x[6 * len(free) :].reshape(-1, 3)
        parts = []
        for edge in edges:
            off = left(edge.transform @ inverse(inverse(at[edge.b]) @ at[edge.a]))
            parts.append(np.linalg.solve(np.linalg.cholesky(edge.covariance), off))
        for prior in known.pose_priors:
            turn = Rotation.from_matrix(at[prior.station][:3, :3] @ prior.pose[:3, :3].T).as_rotvec()
            off = np.concatenate([turn, at[prior.station][:3, 3] - prior.pose[:3, 3]])
            parts.append(off / np.sqrt(np.diag(prior.covariance)))
        for level in known.levels:
            parts.append(at[level.station][:2, 2] / level.sigma)
        for s in known.points:
            if s.point in points:
                off = s.place - (inverse(at[s.station]) @ np.append(places[points.index(s.point)], 1.0))[:3]
                parts.append(off / s.sigma)
        for point in known.point_priors:
            parts.append((places[points.index(point.point)] - point.place) / point.sigma)
        return np.concatenate(parts)

    first = np.concatenate([np.zeros(6 * len(free)), *(point.place for point in known.point_priors)])
    solution = least_squares(residuals, first, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
    covariance = np.linalg.inv(solution.jac.T @ solution.jac)
    freedom = len(solution.fun) - len(first)
    scale = max(1.0, 2 * solution.cost / freedom)
    sigmas = np.sqrt(scale * np.diag(covariance))[: 6 * len(free)].reshape(-1, 6)
    return poses(solution.x), dict(zip(free, sigmas, strict=True))


def all_kinds():
    places = RNG.normal(scale=15, size=(4, 3))
    sigma = np.full(3, 0.002)
    seen_points = []
    for point, stations in enumerate([(0, 1), (2,), (3, 0), (4,)]):
        for s in stations:
            seen = (inverse(TRUE[s]) @ np.append(places[point], 1.0))[:3]
            seen_points.append(
                PointObservation(s, point, seen + 0.001 * RNG.normal(size=3), np.full(3, 0.001))
            )
    known = [PointPrior(k, places[k] + 0.002 * RNG.normal(size=3), sigma) for k in range(4)]
    prior = PosePrior(5, small(1e-4 * RNG.normal(size=6)) @ TRUE[5], np.diag([1e-4**2] * 3 + [0.003**2] * 3))
    return Observations((prior,), tuple(Level(k, 0.03) for k in range(6)), tuple(seen_points), tuple(known))


def test_links_alone_are_solved_as_scipy_solves_them():
    found = adjust(0, EDGES, start=TRUE[0])
    poses, sigmas = dense(EDGES, Observations(), anchor=0)
    for k in range(6):
        np.testing.assert_allclose(found.poses[k], poses[k], atol=1e-6)
    for k in range(1, 6):
        np.testing.assert_allclose(np.sqrt(np.diag(found.covariances[k])), sigmas[k], rtol=1e-3)


def test_with_every_kind_of_observation_it_is_solved_as_scipy_solves_it():
    observations = all_kinds()
    found = adjust(0, EDGES, observations)
    poses, sigmas = dense(EDGES, observations)
    assert found.free == 0
    for k in range(6):
        np.testing.assert_allclose(found.poses[k], poses[k], atol=1e-6)
        np.testing.assert_allclose(np.sqrt(np.diag(found.covariances[k])), sigmas[k], rtol=1e-3)


def test_links_alone_are_solved_as_gtsam_solves_them():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-7)))
    for edge in EDGES:
        noise = gtsam.noiseModel.Gaussian.Covariance(edge.covariance)
        graph.add(gtsam.BetweenFactorPose3(edge.a, edge.b, gtsam.Pose3(inverse(edge.transform)), noise))
    for k in range(6):
        values.insert(k, gtsam.Pose3(inverse(TRUE[0]) @ TRUE[k]))
    solution = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    found = adjust(0, EDGES)
    for k in range(6):
        np.testing.assert_allclose(found.poses[k], solution.atPose3(k).matrix(), atol=1e-6)


def test_what_a_link_moves_is_what_leaving_it_out_moves():
    found = adjust(0, EDGES)
    for index, edge in enumerate(EDGES):
        check = found.checks[edge.ends]
        without = adjust(0, EDGES[:index] + EDGES[index + 1 :])
        moved = {k: np.linalg.norm((without.poses[k] - found.poses[k])[:3, 3]) for k in range(6)}
        far = max(moved, key=moved.get)
        assert check.moves_station == far
        # Poses that turn by a milliradian make it no more linear than this.
        assert check.moves == pytest.approx(moved[far], rel=0.01, abs=1e-6)


def test_redundancies_add_up_to_what_is_more_than_needed():
    found = adjust(0, EDGES)
    assert sum(check.redundancy for check in found.checks.values()) == pytest.approx(
        6 * (len(EDGES) - 5), abs=1e-4
    )


def test_a_link_that_nothing_checks_says_so():
    found = adjust(0, [*EDGES, *edges_of([(0, 0 + 5)])][:2])
    for check in found.checks.values():
        assert check.redundancy == pytest.approx(0.0, abs=1e-4)
        assert check.standardised is None and check.moves is None


def test_an_error_in_a_link_shows_in_its_own_standardised_residual():
    network = build(30, seed=3)
    number = {m.name: k for k, m in enumerate(network.members)}
    edges = [
        Edge(number[k.from_station], number[k.to_station], k.transform, k.covariance, 1.0)
        for k in network.links
    ]
    bad = edges[40]
    edges[40] = Edge(
        bad.a, bad.b, motion(None, np.array([0.012, 0.0, 0.0])) @ bad.transform, bad.covariance, 1.0
    )
    checks = adjust(0, edges).checks
    worst = max(checks, key=lambda ends: checks[ends].standardised)
    assert worst == bad.ends and checks[worst].standardised > 5


def test_standardised_residuals_of_honest_links_are_standard():
    found = []
    for seed in range(4):
        network = build(40, seed=seed)
        number = {m.name: k for k, m in enumerate(network.members)}
        edges = [
            Edge(number[k.from_station], number[k.to_station], k.transform, k.covariance, 1.0)
            for k in network.links
        ]
        found += [check.standardised for check in adjust(0, edges).checks.values()]
    # The largest of six standard normal values: median 1.6, 95 % below 2.6.
    assert np.median(found) == pytest.approx(1.61, abs=0.12)
    assert np.quantile(found, 0.95) == pytest.approx(2.63, abs=0.25)


def test_what_observations_leave_open_the_anchor_keeps():
    observations = Observations(levels=tuple(Level(k, 0.05) for k in range(6)))
    start = TRUE[2]
    found = adjust(2, EDGES, observations, start)
    assert found.free == 4
    np.testing.assert_allclose(found.poses[2][:3, 3], start[:3, 3], atol=1e-6)
    # The vertical is the mean of what the scanners say.
    leans = np.sum([pose[:2, 2] for pose in found.poses.values()], axis=0)
    np.testing.assert_allclose(leans, 0.0, atol=1e-3)
