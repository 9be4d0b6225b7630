"""A corridor of 150 m: what poses drift by, without a loop and with one, is what the covariances say."""

import numpy as np
import pytest
from benchmarks.networks import SIGMA_R, SIGMA_T, header
from scipy.spatial.transform import Rotation

from support.links import link
from trihedral.geometry.se3 import inverse, motion
from trihedral.model.station import Station
from trihedral.network.options import NetworkOptions
from trihedral.network.solve import solve

STEP, COUNT = 7.5, 21  # metres between stations; 150 m
HONEST = NetworkOptions(systematic_translation=1e-9, systematic_rotation=1e-9)  # links err by what they say


def corridor(seed, back):
    """Stations along a corridor, or twice: there, and back by a parallel one that meets it at both ends."""
    rng = np.random.default_rng(seed)
    there = [np.array([STEP * k, 0.0, 1.5]) for k in range(COUNT)]
    places = there + [np.array([STEP * k, 6.0, 1.5]) for k in reversed(range(COUNT))] if back else there
    poses = [motion(Rotation.from_euler("z", rng.uniform(-3, 3)).as_matrix(), place) for place in places]
    members = [Station(f"s{k:02d}", header(f"s{k:02d}"), 1, f"{k:02d}") for k in range(len(poses))]
    pairs = [(k, k + 1) for k in range(len(poses) - 1)] + ([(0, len(poses) - 1)] if back else [])
    # Along a corridor, a link knows least where it leads.
    links = []
    for a, b in pairs:
        along = poses[b][:3, :3].T @ np.array([1.0, 0.0, 0.0])
        covariance = np.diag([SIGMA_R**2] * 3 + [SIGMA_T**2] * 3)
        covariance[3:, 3:] += 8 * SIGMA_T**2 * np.outer(along, along)
        xi = np.linalg.cholesky(covariance) @ rng.normal(size=6)
        noise = motion(Rotation.from_rotvec(xi[:3]).as_matrix(), xi[3:])
        between = noise @ inverse(poses[b]) @ poses[a]
        links.append(link(f"s{a:02d}", f"s{b:02d}", between, covariance, evidence=None))
    return poses, members, links


def end_to_end(result, poses, a, b):
    """Error of the motion from one station to another, in axes of the first (m)."""
    found = inverse(result.stations[a].pose) @ result.stations[b].pose
    return (found - inverse(poses[a]) @ poses[b])[:3, 3]


def anchor(result):
    """The station that defines the frame."""
    return next(k for k, s in enumerate(result.stations) if not any(s.sigma_translation_m))


def test_without_a_loop_the_end_errs_by_its_sigma():
    ratios = []
    for seed in range(30):
        poses, members, links = corridor(seed, back=False)
        result = solve(members, links, HONEST)
        base = anchor(result)
        for k in (0, COUNT - 1):
            if k != base:
                ratios.append(end_to_end(result, poses, base, k) / result.stations[k].sigma_translation_m)
    # 90 values or more: their root mean square to 7 %.
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.2)


def test_the_loop_misses_its_start_by_what_is_expected():
    ratios, sizes = [], []
    for seed in range(30):
        _, members, links = corridor(seed, back=True)
        (loop,) = solve(members, links, HONEST).loops
        assert loop.ok and len(loop.stations) == 2 * COUNT
        ratios.append(loop.translation_m / loop.expected_translation_m)
        sizes.append(loop.expected_translation_m)
    # 300 m of links: 3 mm each along, turns of 5e-5 over the way; 20 to 60 mm in all.
    assert 0.02 < np.mean(sizes) < 0.06
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.3)


def test_with_the_loop_the_far_end_errs_by_its_sigma():
    ratios = []
    for seed in range(20):
        poses, members, links = corridor(seed, back=True)
        result = solve(members, links, HONEST)
        base = anchor(result)
        far = (base + COUNT) % len(poses)
        ratios.append(end_to_end(result, poses, base, far) / result.stations[far].sigma_translation_m)
    # 60 values: 9 %.
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.25)
