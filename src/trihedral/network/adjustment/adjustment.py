"""All poses at once from all links and observations: weighted least squares, with what may be believed of each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from trihedral.geometry.arrays import Float64
from trihedral.geometry.kabsch import UndeterminedMotion, kabsch
from trihedral.geometry.se3 import inverse, motion, rotation_about_z, skew
from trihedral.network.adjustment.link_checks import Checked, checked
from trihedral.network.adjustment.link_observations import LinkObservations
from trihedral.network.adjustment.observations import Equation, Observations
from trihedral.network.adjustment.sparse_cholesky import NormalMatrix
from trihedral.network.adjustment.unknowns import Unknowns
from trihedral.network.graph.edge import Edge
from trihedral.network.graph.forest import Forest

# Sigma (m, rad) that holds what nothing else determines: the frame.
_HELD = 1e-7
# Sigmas (m, rad) from which a motion of the whole counts as open.
_LOOSE, _LOOSE_TURN = 10.0, 0.1
_ROUNDS = 30
_CONVERGED = 1e-7  # metres and radians


@dataclass(frozen=True)
class Adjusted:
    """Poses that fit everything best."""

    #: Of each station, ``frame_from_scanner`` 4x4.
    poses: dict[int, Float64]
    #: Of each station, 6x6 of ``(omega, v)`` on the left about the scanner: a rotation about axes of the frame through
    #: the scanner, and the scanner's displacement.
    covariances: dict[int, Float64]
    #: Of each edge, by its ends.
    checks: dict[tuple[int, int], Checked]
    #: Weighted squares of the residuals over the redundancy; covariances are scaled by it where it is over 1.
    unit_variance: float
    #: How many of the six motions of the whole the observations leave open.
    free: int
    #: (M, 6) and (M, 6, 6), of each edge in their order: what variance components are found from.
    weighted_residuals: Float64
    expected_residual_covariance: Float64


def adjust(
    anchor: int,
    edges: Sequence[Edge],
    observations: Observations | None = None,
    start: Float64 | None = None,
    *,
    poses_only: bool = False,
    checks: bool = True,
) -> Adjusted:
    """Adjust the stations that `edges` connect with the anchor.

    Parameters
    ----------
    anchor
        The station whose frame is that of the result, as far as the constraints leave it open.
    edges
        Links that agree with each other; every station must be reachable from the anchor.
    observations
        What is known beside them, in one project frame.
    start
        Pose of the anchor's scanner in the frame, if the observations say nothing of it.
    poses_only
        Leave out everything else, which takes most of the time.
    checks
        Whether to check each link, which takes most of the rest.
    """
    start = np.eye(4) if start is None else start
    with threadpool_limits(1, "blas"):  # small matrices; and the same digits on every machine
        return _Adjustment(anchor, edges, observations or Observations(), start).adjusted(poses_only, checks)


class _Adjustment:
    """Gauss and Newton's iteration."""

    def __init__(
        self, anchor: int, edges: Sequence[Edge], observations: Observations, start: Float64
    ) -> None:
        self.anchor = anchor
        self.observations = observations
        self.unknowns = _started(anchor, edges, observations, start)
        # Where the given poses take part themselves, edges that stand for them would count them twice.
        taking_part = [edge for edge in edges if not (edge.between_priors and observations.pose_priors)]
        self.links = LinkObservations(taking_part, self.unknowns.of_station)

    def adjusted(self, poses_only: bool, with_checks: bool) -> Adjusted:
        """Solve, and say what may be believed."""
        for _ in range(_ROUNDS):
            normal, right, _ = self._normal()
            step = normal.solve(right)
            self.unknowns = self.unknowns.moved(step)
            if np.abs(step).max() < _CONVERGED:
                break
            self.links.reweigh(self.unknowns)
        unknowns, links = self.unknowns, self.links
        poses = dict(zip(unknowns.stations, unknowns.poses, strict=True))
        if poses_only:
            return Adjusted(poses, {}, {}, 1.0, 0, np.zeros(2), np.zeros(2))
        normal, _, free = self._normal()
        inverse_blocks = normal.inverse_blocks()
        squares, redundancy = self._fit(free)
        unit_variance = squares / redundancy if redundancy else 1.0
        scale = max(1.0, unit_variance)
        covariances = {s: scale * inverse_blocks[k, k] for s, k in unknowns.of_station.items()}
        of_links = links.adjusted_covariance(unknowns, inverse_blocks)
        checks = checked(links, unknowns, normal, of_links, scale) if with_checks else []
        by_ends = {edge.ends: check for edge, check in zip(links.edges, checks, strict=with_checks)}
        weighted, expected = links.weighted_residuals(unknowns, of_links)
        return Adjusted(poses, covariances, by_ends, unit_variance, free, weighted, expected)

    def _normal(self) -> tuple[NormalMatrix, Float64, int]:
        """The normal matrix, the right side, and how many motions of the whole are open."""
        blocks: dict[tuple[int, int], Float64] = {}
        unknowns, first = self.unknowns, self.unknowns.first
        right = np.zeros(first[-1])

        def add(i: int, j: int, block: Float64) -> None:
            key, block = ((i, j), block) if i <= j else ((j, i), block.T)
            blocks[key] = blocks[key] + block if key in blocks else block

        of_a, of_b = self.links.jacobians(unknowns)
        weighted, residuals = self.links.weighted_information, self.links.residuals(unknowns)
        to_a, to_b = (np.swapaxes(jacobian, -1, -2) @ weighted for jacobian in (of_a, of_b))
        aa, ab, bb = to_a @ of_a, to_a @ of_b, to_b @ of_b
        right_a, right_b = (np.einsum("mij,mj->mi", to, residuals) for to in (to_a, to_b))
        for k, (a, b) in enumerate(self.links.pairs):
            add(a, a, aa[k])
            add(a, b, ab[k])
            add(b, b, bb[k])
            right[first[a] : first[a] + 6] += right_a[k]
            right[first[b] : first[b] + 6] += right_b[k]
        equations = self.observations.equations(unknowns)
        for one in equations:
            for i, jacobian_i in zip(one.unknowns, one.jacobians, strict=True):
                right[first[i] : first[i + 1]] += jacobian_i.T @ one.information @ one.residual
                for j, jacobian_j in zip(one.unknowns, one.jacobians, strict=True):
                    if i <= j:
                        add(i, j, jacobian_i.T @ one.information @ jacobian_j)
        open_motions = self._open(equations)
        # A prior without a residual: the anchor stays where it is in what nothing else says.
        held = open_motions.T @ open_motions / _HELD**2
        add(unknowns.of_station[self.anchor], unknowns.of_station[self.anchor], held)
        return NormalMatrix(unknowns.sizes, blocks), right, len(open_motions)

    def _open(self, equations: Sequence[Equation]) -> Float64:
        """Motions of the whole, as (omega, v) of the anchor, that the observations do not determine: rows."""
        unknowns, information = self.unknowns, np.zeros((6, 6))
        anchor = unknowns.pose(self.anchor)[:3, 3]
        sigma_of = {unknowns.of_point[p.point]: p.sigma for p in self.observations.point_priors}
        for one in equations:
            station, *points = one.unknowns
            if station >= len(unknowns.stations):
                continue
            carried = np.eye(6)
            carried[3:, :3] = -skew(unknowns.poses[station][:3, 3] - anchor)
            own, weight = one.jacobians[0] @ carried, one.information
            for point in points:
                weight = np.linalg.inv(np.linalg.inv(weight) + np.diag(sigma_of[point] ** 2))
            information += own.T @ weight @ own
        scale = np.array([_LOOSE_TURN] * 3 + [_LOOSE] * 3)
        values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
        return vectors[:, values < 1.0].T / (scale / _LOOSE)

    def _fit(self, free: int) -> tuple[float, int]:
        """Weighted squares of all residuals, and how many observations are more than needed."""
        squares = self.links.squares(self.unknowns)
        count = 6 * len(self.links.edges)
        for one in self.observations.equations(self.unknowns):
            squares += float(one.residual @ one.information @ one.residual)
            count += len(one.residual)
        return squares, count - (sum(self.unknowns.sizes) - free)


def _started(anchor: int, edges: Sequence[Edge], observations: Observations, start: Float64) -> Unknowns:
    """Poses along the strongest links, moved onto what is known."""
    stations = sorted({anchor} | {end for edge in edges for end in edge.ends})
    known = {prior.point: prior.place for prior in observations.point_priors}
    points = sorted(known)
    places = np.array([known[point] for point in points], dtype=np.float64).reshape(-1, 3)
    number = {station: index for index, station in enumerate(stations)}
    numbered = [replace(edge, a=number[edge.a], b=number[edge.b]) for edge in edges]
    poses = Forest(numbered).poses if numbered else np.eye(4)[None].copy()
    frame_from_root = start @ inverse(poses[number[anchor]])
    if observations.pose_priors:
        prior = observations.pose_priors[0]
        frame_from_root = prior.pose @ inverse(poses[number[prior.station]])
    elif known:
        there = Unknowns(stations, points, frame_from_root @ poses, places)
        seen = [
            (p.seen(there.pose(p.station)), known[p.point]) for p in observations.points if p.point in known
        ]
        source, target = (np.array(places) for places in zip(*seen, strict=True))
        try:
            frame_from_root = kabsch(source, target) @ frame_from_root
        except UndeterminedMotion:
            frame_from_root = _upright(source, target) @ frame_from_root
    return Unknowns(stations, points, frame_from_root @ poses, places)


def _upright(source: Float64, target: Float64) -> Float64:
    """Motion with a turn about the vertical only that brings places (N, 3) near others; one or a line of them do."""
    centre, goal = source.mean(axis=0), target.mean(axis=0)
    a, b = (source - centre)[:, :2], (target - goal)[:, :2]
    turn = rotation_about_z(float(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))))
    return motion(turn, goal - turn @ centre)
