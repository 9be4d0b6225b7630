"""Surfaces compared where all scans put them, with pairs that stopped before they fitted best."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.networks import SIGMA_R, SIGMA_T, build, errors
from scipy.spatial.transform import Rotation

from support.links import with_pose
from trihedral.geometry.se3 import inverse, motion
from trihedral.model.link import PoseEstimate
from trihedral.network.adjustment.surfaces import compared_anew
from trihedral.network.adjustment.systematic import Systematic
from trihedral.network.graph.edge import Edge
from trihedral.network.solve import solve

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
        links.append(with_pose(link, stopped))

    def surfaces(a, b, pose):
        left = best[a, b] @ inverse(pose)
        half = Rotation.from_rotvec(0.5 * Rotation.from_matrix(left[:3, :3]).as_rotvec()).as_matrix()
        return PoseEstimate(motion(half, 0.5 * left[:3, 3]) @ pose, COVARIANCE)

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
        return PoseEstimate(pose, COVARIANCE)

    names = [member.name for member in network.members]
    (found,) = compared_anew([edges], surfaces, Systematic(0.0, 0.0), names)
    assert asked == {edge.ends for edge in edges} - {edges[5].ends}
    assert found[5] is edges[5]


class Watcher:
    """Remembers each phase: its name, how many steps it announced, and what it told of each."""

    def __init__(self) -> None:
        self.phases: list[tuple[str, int, list[str]]] = []

    def phase(self, name: str, total: int, unit: str, work: float, measure: str) -> None:
        self.phases.append((name, total, []))

    def advance(self, detail: str, work: float) -> None:
        self.phases[-1][2].append(detail)

    def note(self, text: str) -> None:
        raise AssertionError(text)


def two_parts() -> tuple[list[list[Edge]], list[str], dict[tuple[int, int], np.ndarray]]:
    """Edges of two networks that nothing joins, names of their stations, and where each pair fits best."""
    rng = np.random.default_rng(5)
    parts, names, best = [], [], {}
    for seed in (3, 4):
        network = build(8, seed=seed)
        number = {m.name: len(names) + k for k, m in enumerate(network.members)}
        edges = [
            Edge(number[k.from_station], number[k.to_station], k.transform, k.covariance, 1.0)
            for k in network.links
        ]
        best |= {edge.ends: motion(None, 3e-4 * rng.normal(size=3)) @ edge.transform for edge in edges}
        parts.append(edges)
        names += [f"{seed} {m.name}" for m in network.members]
    return parts, names, best


@pytest.mark.parametrize("threads", [1, 5])
def test_neither_threads_nor_other_parts_change_what_surfaces_say(threads: int):
    parts, names, best = two_parts()

    def surfaces(a, b, pose):
        left = best[a, b] @ inverse(pose)
        return PoseEstimate(motion(None, 0.5 * left[:3, 3]) @ pose, COVARIANCE)

    systematic = Systematic(5e-4, 2e-5)
    together = compared_anew(parts, surfaces, systematic, names, threads=threads)
    for part, found in zip(parts, together, strict=True):
        (alone,) = compared_anew([part], surfaces, systematic, names, threads=2)
        for edge, other in zip(found, alone, strict=True):
            assert edge.ends == other.ends
            assert edge.transform.tobytes() == other.transform.tobytes()
            assert edge.covariance.tobytes() == other.covariance.tobytes()


def test_each_comparison_is_told_once_and_each_iteration_says_how_many_there_are():
    parts, names, best = two_parts()
    asked = []

    def surfaces(a, b, pose):
        asked.append(f"{names[a]} - {names[b]}")
        left = best[a, b] @ inverse(pose)
        return PoseEstimate(motion(None, 0.5 * left[:3, 3]) @ pose, COVARIANCE)

    watcher = Watcher()
    compared_anew(parts, surfaces, Systematic(5e-4, 2e-5), names, watcher, threads=2)
    assert [name for name, _, _ in watcher.phases] == [
        f"Comparing surfaces, round {k + 1}" for k in range(len(watcher.phases))
    ]
    assert len(watcher.phases) > 1
    assert all(total == len(told) for _, total, told in watcher.phases)
    assert sorted(detail for _, _, told in watcher.phases for detail in told) == sorted(asked)
    # All edges of both parts at first.
    assert watcher.phases[0][1] == sum(map(len, parts))


def test_solving_says_which_step_is_at_work():
    network = build(12, seed=3)
    watcher = Watcher()
    solve(
        network.members,
        network.links,
        surfaces=lambda a, b, pose: PoseEstimate(pose, COVARIANCE),
        progress=watcher,
        threads=2,
    )
    names = [name for name, _, _ in watcher.phases]
    assert (names[0], names[1], names[-1]) == (
        "Closing loops",
        "Comparing surfaces, round 1",
        "Adjusting all scans",
    )
    assert all(total == len(told) for _, total, told in watcher.phases)
