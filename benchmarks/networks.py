"""Networks of links with known truth, right and wrong: what is refused, what is believed, and how long it takes.

    python -m benchmarks.networks

Stations stand on a grid of corridors and rooms, 8 m apart, storey upon storey; each is linked with the nearest ones.
Links err by their covariances. Wrong ones are of two kinds: anywhere at random, and coherent: along an axis by one bay,
the same for all links between two groups of stations, as repeated bays give them.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import distance, inverse, motion
from trihedral.model.link import Link, LinkEvidence, LinkVerdict, PoseEstimate
from trihedral.model.registration import Registration
from trihedral.model.station import Station, StationStatus
from trihedral.network.decision.loop_closure import Triangles
from trihedral.network.graph.edge import Edge
from trihedral.network.graph.forest import Forest
from trihedral.network.options import NetworkOptions
from trihedral.network.solve import solve
from trihedral.scan import ScanHeader

Float64 = NDArray[np.float64]

SIGMA_T, SIGMA_R = 0.001, 5e-5  # metres and radians of a link
BAY = 6.0  # metres that a coherent wrong link is off


@dataclass(frozen=True)
class Network:
    """Stations with known poses, links between them, and which of these are wrong."""

    poses: list[Float64]
    members: list[Station]
    links: list[Link]
    wrong: frozenset[int]  # numbers of links


def header(
    name: str, origin: Sequence[float] = (0.0, 0.0, 0.0), file_pose: Float64 | None = None
) -> ScanHeader:
    return ScanHeader(
        source=Path(f"{name}.e57"),
        scan_index=0,
        name=name,
        format="e57",
        points=1,
        grid=None,
        has_color=False,
        has_intensity=False,
        photos=0,
        file_pose=file_pose,
        scanner_origin=np.array(origin),
        origin_stated=True,
        units="m",
        units_stated=True,
    )


def places(count: int) -> Float64:
    """Stations (N, 3) on a square grid, storeys of at most 200."""
    storeys = -(-count // 200)
    a_storey = -(-count // storeys)
    side = int(np.ceil(np.sqrt(a_storey)))
    index = np.arange(count)
    within = index % a_storey
    return np.stack([8.0 * (within % side), 8.0 * (within // side), 3.5 * (index // a_storey)], axis=1)


def build(
    count: int,
    links_a_station: float = 5.0,
    seed: int = 0,
    random_wrong: float = 0.0,
    bays: int = 0,
    lean: float = 0.01,
    more: tuple[float, float] = (0.0, 0.0),
) -> Network:
    """Make a network.

    Parameters
    ----------
    random_wrong
        Share of links that lead anywhere.
    bays
        How many times half of the links between a station and its neighbours are off by one bay alike.
    lean
        Standard deviation (rad) of the scanners' axes about the vertical, in each of two directions.
    more
        What links err by beside what their covariances say, one sigma: metres and radians.
    """
    rng = np.random.default_rng(seed)
    where = places(count) + rng.normal(scale=0.5, size=(count, 3))
    poses = [
        motion(
            Rotation.from_euler(
                "zyx", [rng.uniform(-np.pi, np.pi), *rng.normal(scale=lean, size=2)]
            ).as_matrix(),
            place,
        )
        for place in where
    ]
    members = [Station(f"s{k:04d}", header(f"s{k:04d}"), 1000, f"{k:04d}") for k in range(count)]
    _, near = KDTree(where).query(where, k=min(count, 14))
    pairs = sorted({(min(a, b), max(a, b)) for a in range(count) for b in near[a, 1:].tolist()})
    chosen = rng.permutation(len(pairs))[: round(links_a_station * count)]
    pairs = [pairs[k] for k in sorted(chosen.tolist())]
    shifted: dict[tuple[int, int], Float64] = {}
    around = {k: [pair for pair in pairs if k in pair] for k in range(count)}
    # With fewer links than four, two that agree on a wrong place are all that there is to know.
    candidates = [k for k in range(count) if len(around[k]) >= 4]
    for lonely in rng.permutation(candidates)[:bays].tolist():
        for pair in around[lonely][: len(around[lonely]) // 2]:
            # The lonely station is seen one bay off along x of the building by half of its neighbours.
            shifted[pair] = np.array([BAY if pair[0] == lonely else -BAY, 0.0, 0.0])
    covariance = np.diag([SIGMA_R**2] * 3 + [SIGMA_T**2] * 3)
    links, wrong = [], set()
    for number, (a, b) in enumerate(pairs):
        noise = motion(
            Rotation.from_rotvec(np.hypot(SIGMA_R, more[1]) * rng.normal(size=3)).as_matrix(),
            np.hypot(SIGMA_T, more[0]) * rng.normal(size=3),
        )
        between = noise @ inverse(poses[b]) @ poses[a]
        if rng.uniform() < random_wrong:
            turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
            between = motion(turn, rng.uniform(-8, 8, size=3) * [1, 1, 0.2]) @ between
            wrong.add(number)
        elif (a, b) in shifted:
            moved = motion(None, shifted[a, b]) @ poses[a]
            between = noise @ inverse(poses[b]) @ moved
            wrong.add(number)
        score = rng.uniform(0.3, 0.9)
        links.append(
            Link(
                from_station=members[a].name,
                to_station=members[b].name,
                verdict=LinkVerdict.ACCEPTED,
                estimate=PoseEstimate(between, covariance),
                evidence=neutral_evidence(score),
            )
        )
    return Network(poses, members, links, frozenset(wrong))


def neutral_evidence(score: float) -> LinkEvidence:
    """Of a pose that nothing speaks against, in the open; of its appearance nothing is known."""
    return LinkEvidence(
        score=score,
        held_area_m2=100.0,
        holding=0.4,
        solid_conflict=0.0,
        patch_blocks=(200.0, 0.0),
        loose_blocks=(100.0, 1.0),
        misfit=0.05,
        redundancy=5.0,
        free_space_conflict=0.0,
        overlap_from=0.5,
        overlap_to=0.5,
        appearance_similarity=None,
        least_similarity=0.45,
        by_intensity=False,
        enclosed=False,
    )


def errors(network: Network, result: Registration) -> dict[int, float]:
    """Error of position (m) of each placed station of the largest part, in the frame that suits most of them best."""
    placed = {k: s.pose for k, s in enumerate(result.stations) if s.pose is not None and s.component == 0}
    return _errors(network, placed)


def _errors(network: Network, placed: dict[int, Float64]) -> dict[int, float]:
    candidates = []
    for base in list(placed)[:: max(1, len(placed) // 10)]:
        moved = network.poses[base] @ inverse(placed[base])
        candidates.append({k: distance(network.poses[k], moved @ pose)[0] for k, pose in placed.items()})
    return min(candidates, key=lambda off: float(np.median(list(off.values()))))


def gnc(network: Network, *, closed: bool) -> tuple[int, int, int]:
    """Graduated non-convexity of gtsam instead of loops; `closed`: links that only close triangles are known inliers.

    Returns
    -------
    Wrong links kept, right ones refused, stations placed wrongly.
    """
    import gtsam

    number = {member.name: k for k, member in enumerate(network.members)}
    more = NetworkOptions().systematic.covariance
    edges = [
        Edge(
            number[link.from_station],
            number[link.to_station],
            link.transform,
            link.covariance + more,
            link.score,
        )
        for link in network.links
    ]
    start = Forest(edges).poses
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, pose in enumerate(start):
        values.insert(k, gtsam.Pose3(pose))
    for edge in edges:
        noise = gtsam.noiseModel.Gaussian.Covariance(edge.covariance)
        graph.add(gtsam.BetweenFactorPose3(edge.a, edge.b, gtsam.Pose3(inverse(edge.transform)), noise))
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(start[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)))
    triangles = Triangles(edges, NetworkOptions().closure)
    sure = triangles.bearing_out() & (triangles.failing == 0)
    parameters = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams())
    parameters.setLossType(gtsam.GncLossType.TLS)
    parameters.setKnownInliers([*(np.flatnonzero(sure).tolist() if closed else []), len(edges)])
    optimizer = gtsam.GncLMOptimizer(graph, values, parameters)
    optimizer.setInlierCostThresholdsAtProbability(0.999)
    solution = optimizer.optimize()
    kept = {k for k in range(len(edges)) if optimizer.getWeights()[k] > 0.5}
    poses = [solution.atPose3(k).matrix() for k in range(len(start))]
    return (
        len(kept & network.wrong),
        len(edges) - len(kept | network.wrong),
        sum(metres > 0.05 for metres in _errors(network, dict(enumerate(poses))).values()),
    )


def worst_error(network: Network, result: Registration) -> float:
    """Largest of the errors (m)."""
    return max(errors(network, result).values())


KINDS = (
    (20, 0.0, 0), (20, 0.05, 0), (20, 0.2, 0), (20, 0.0, 2), (100, 0.05, 0), (100, 0.2, 0), (100, 0.0, 10),
    (300, 0.05, 10), (1000, 0.0, 0), (1000, 0.05, 30),
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--most", type=int, default=1000, help="stations of the largest network")
    parser.add_argument("--gnc", action="store_true", help="gtsam's GNC beside it")
    arguments = parser.parse_args()
    print(
        f"{'stations':>8} {'links':>6} {'wrong':>6} {'kind':20} {'wrong kept':>10} {'right refused':>13} "
        f"{'placed':>6} {'wrong':>6} {'verified wrong':>14} {'worst mm, rest':>14} {'seconds':>8}"
    )
    for count, share, bays in KINDS:
        if count > arguments.most:
            continue
        for seed in range(arguments.seeds if count <= 100 else 1):
            network = build(count, seed=seed, random_wrong=share, bays=bays)
            began = time.perf_counter()
            result = solve(network.members, network.links, NetworkOptions())
            seconds = time.perf_counter() - began
            accepted = {k for k, link in enumerate(result.links) if link.accepted}
            off = errors(network, result)
            wrong = {k for k, metres in off.items() if metres > 0.05}
            sure = {k for k in wrong if result.stations[k].status is StationStatus.VERIFIED}
            rest = max(metres for k, metres in off.items() if k not in wrong)
            print(
                f"{count:8d} {len(network.links):6d} {len(network.wrong):6d} {f'{share:.0%} random, {bays} bays':20} "
                f"{len(accepted & network.wrong):10d} {len(network.links) - len(accepted | network.wrong):13d} "
                f"{len(off):6d} {len(wrong):6d} {len(sure):14d} {1e3 * rest:14.1f} {seconds:8.2f}",
                flush=True,
            )
            for closed in (False, True) if arguments.gnc else ():
                wrong_kept, right_refused, misplaced = gnc(network, closed=closed)
                name = "GNC, closed known" if closed else "GNC"
                print(
                    f"{'':23}{name:20} {wrong_kept:10d} {right_refused:13d} {'':6} {misplaced:6d}", flush=True
                )


if __name__ == "__main__":
    main()
