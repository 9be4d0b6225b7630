"""All poses at once from all links: a pose graph in least squares."""

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.motion import inverse
from trihedral.network.consistency import Edge

Float64 = NDArray[np.float64]

# Of the station that defines the frame: metres and radians that nobody will ask for.
_ANCHOR_SIGMA = 1e-9


def adjust(anchor: int, edges: Sequence[Edge]) -> tuple[dict[int, Float64], dict[int, Float64]]:
    """Adjust the stations that `edges` connect with the anchor.

    Parameters
    ----------
    anchor
        The station whose frame is that of the result.
    edges
        Links that agree with each other; every station must be reachable from the anchor.

    Returns
    -------
    poses
        Of each station, ``anchor_from_scanner`` 4x4.
    covariances
        Of each station, 6x6 of ``(omega, v)`` on the left about the scanner: a rotation about axes of the anchor's
        frame through the scanner, and the scanner's displacement. Where the links contradict each other by more than
        their covariances say, those of the stations are larger by the same factor (variance of unit weight).
    """
    initial = _chained(anchor, edges)
    graph = gtsam.NonlinearFactorGraph()
    values = gtsam.Values()
    for station, pose in initial.items():
        values.insert(station, gtsam.Pose3(pose))
    graph.add(
        gtsam.PriorFactorPose3(anchor, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, _ANCHOR_SIGMA))
    )
    for edge in edges:
        # Measured from a to b, the factor's error is minus the motion on the left of b_from_a.
        noise = gtsam.noiseModel.Gaussian.Covariance(edge.covariance)
        graph.add(gtsam.BetweenFactorPose3(edge.a, edge.b, gtsam.Pose3(inverse(edge.transform)), noise))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    parameters.setAbsoluteErrorTol(1e-12)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    marginals = gtsam.Marginals(graph, result)
    redundancy = 6 * (len(edges) - (len(initial) - 1))
    unit_variance = max(1.0, 2 * graph.error(result) / redundancy) if redundancy else 1.0
    poses, covariances = {}, {}
    for station in initial:
        pose = result.atPose3(station).matrix()
        # GTSAM's motions are in the scanner's own axes.
        turn = np.kron(np.eye(2), pose[:3, :3])
        poses[station] = pose
        covariances[station] = unit_variance * (turn @ marginals.marginalCovariance(station) @ turn.T)
    return poses, covariances


def _chained(anchor: int, edges: Sequence[Edge]) -> dict[int, Float64]:
    """Poses along the strongest links, breadth first."""
    poses = {anchor: np.eye(4)}
    queue = [anchor]
    ordered = sorted(edges, key=lambda edge: (-edge.strength, edge.a, edge.b))
    for here in queue:
        for edge in ordered:
            if edge.a == here and edge.b not in poses:
                poses[edge.b] = poses[here] @ inverse(edge.transform)
                queue.append(edge.b)
            elif edge.b == here and edge.a not in poses:
                poses[edge.a] = poses[here] @ edge.transform
                queue.append(edge.a)
    return poses
