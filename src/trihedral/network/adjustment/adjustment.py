"""All poses at once from all links and constraints: weighted least squares, with what may be believed of each part."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri
from threadpoolctl import threadpool_limits

from trihedral.geometry.arrays import Float64
from trihedral.geometry.kabsch import UndeterminedMotion, kabsch
from trihedral.geometry.se3 import inverse, motion, rotation_about_z, skew
from trihedral.network.adjustment.sparse_cholesky import NormalMatrix
from trihedral.network.graph.edge import Edge
from trihedral.network.graph.forest import Forest

# Sigma (m, rad) that holds what nothing else determines: the frame.
_HELD = 1e-7
# Sigmas (m, rad) from which a motion of the whole counts as open.
_LOOSE, _LOOSE_TURN = 10.0, 0.1
# Sigmas of a link's offset from the others (six at once) at which it begins to lose weight: one right link in 1,000.
_ROBUST = float(np.sqrt(chdtri(6, 1 - 0.999)))
_ROUNDS = 30
_CONVERGED = 1e-7  # metres and radians
# Share of a link's own information that others must add before it counts as checked by them.
_LEAST_REDUNDANCY = 1e-4
_BATCH = 256  # links whose removal is solved for at once


@dataclass(frozen=True)
class Given:
    """A pose that is known: ``project_from_scanner`` and its 6x6 covariance, as those of `Adjusted`."""

    station: int
    pose: Float64
    covariance: Float64


@dataclass(frozen=True)
class Plumb:
    """A station whose z axis is vertical within sigma (rad)."""

    station: int
    sigma: float


@dataclass(frozen=True)
class Sighting:
    """A control point as a scan shows it: its place from the scanner, in the scanner's axes."""

    station: int
    point: int
    place: Float64  # (3,) metres
    sigma: Float64  # (3,) metres


@dataclass(frozen=True)
class Known:
    """A control point whose project coordinates are known."""

    point: int
    place: Float64  # (3,) metres
    sigma: Float64  # (3,) metres


@dataclass(frozen=True)
class Facts:
    """What is known beside the links; the frame keeps what they leave open."""

    given: tuple[Given, ...] = ()
    plumb: tuple[Plumb, ...] = ()
    sightings: tuple[Sighting, ...] = ()
    known: tuple[Known, ...] = ()

    def of(self, stations: Sequence[int]) -> "Facts":
        """Those that speak of some stations."""
        inside = set(stations)
        sightings = tuple(s for s in self.sightings if s.station in inside)
        seen = {s.point for s in sightings}
        return Facts(
            tuple(g for g in self.given if g.station in inside),
            tuple(p for p in self.plumb if p.station in inside),
            sightings,
            tuple(k for k in self.known if k.point in seen),
        )

    def __bool__(self) -> bool:
        return bool(self.given or self.plumb or self.known)


@dataclass(frozen=True)
class Checked:
    """How far the rest of the network bears a link out.

    Attributes
    ----------
    redundancy
        0: nothing else holds the stations together, an error of the link goes unseen; 6: it decides nothing.
    standardised
        Its largest residual (three of rotation, three of translation) over the sigma to expect of it; None where
        nothing checks it.
    moves, moves_station
        Metres by which the poses would change most without it, and of which station; None where a part would come off.
    """

    residual: Float64  # (6,) of (omega, v): measured less adjusted
    redundancy: float
    standardised: float | None
    moves: float | None
    moves_station: int | None


@dataclass(frozen=True)
class Adjusted:
    """Poses that fit everything best.

    Attributes
    ----------
    poses
        Of each station, ``frame_from_scanner`` 4x4.
    covariances
        Of each station, 6x6 of ``(omega, v)`` on the left about the scanner: a rotation about axes of the frame
        through the scanner, and the scanner's displacement.
    checks
        Of each edge, by its ends.
    unit_variance
        Weighted squares of the residuals over the redundancy; covariances are scaled by it where it is over 1.
    free
        How many of the six motions of the whole the facts leave open.
    pulls, rooms
        (M, 6) and (M, 6, 6), of each edge in their order: weighted residuals, and the covariance that is to be expected
        of these: what variance components are found from.
    """

    poses: dict[int, Float64]
    covariances: dict[int, Float64]
    checks: dict[tuple[int, int], Checked]
    unit_variance: float
    free: int
    pulls: Float64
    rooms: Float64


def adjust(
    anchor: int,
    edges: Sequence[Edge],
    facts: Facts | None = None,
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
    facts
        What is known beside them, in one project frame.
    start
        Pose of the anchor's scanner in the frame, if the facts say nothing of it.
    poses_only
        Leave out everything else, which takes most of the time.
    checks
        Whether to check each link, which takes most of the rest.
    """
    with threadpool_limits(1, "blas"):  # small matrices; and the same digits on every machine
        network = _Network(anchor, edges, facts or Facts(), np.eye(4) if start is None else start)
        return network.adjusted(poses_only, checks)


class _Network:
    """Unknowns: (omega, v) on the left of each station about its scanner, then the control points."""

    def __init__(self, anchor: int, edges: Sequence[Edge], facts: Facts, start: Float64) -> None:
        self.anchor = anchor
        # Where the given poses take part themselves, edges that stand for them would count them twice.
        self.edges = [edge for edge in edges if not (edge.between_priors and facts.given)]
        self.all_edges = edges
        self.facts = facts
        stations = sorted({anchor} | {end for edge in edges for end in edge.ends})
        self.stations = stations
        self.place = {station: index for index, station in enumerate(stations)}
        points = sorted({k.point for k in facts.known})
        self.point_place = {point: len(stations) + index for index, point in enumerate(points)}
        self.sightings = [s for s in facts.sightings if s.point in self.point_place]
        self.sizes = [6] * len(stations) + [3] * len(points)
        self.poses = self._start(start)
        known = {k.point: k.place for k in facts.known}
        self.points = np.array([known[point] for point in points], dtype=np.float64).reshape(-1, 3)
        self.a = np.array([self.place[edge.a] for edge in self.edges], dtype=np.int64)
        self.b = np.array([self.place[edge.b] for edge in self.edges], dtype=np.int64)
        self.measured = np.array([edge.transform for edge in self.edges]).reshape(-1, 4, 4)
        self.covariance = np.array([edge.covariance for edge in self.edges]).reshape(-1, 6, 6)
        self.information = np.linalg.inv(self.covariance)
        self.weights = np.ones(len(self.edges))

    def _start(self, start: Float64) -> Float64:
        """Poses along the strongest links, moved onto what is known."""
        numbered = [
            Edge(self.place[e.a], self.place[e.b], e.transform, e.covariance, e.strength, e.locked)
            for e in self.all_edges
        ]
        poses = Forest(numbered).poses if numbered else np.eye(4)[None].copy()
        frame_from_root = start @ inverse(poses[self.place[self.anchor]])
        given = [(poses[self.place[g.station]], g.pose) for g in self.facts.given]
        if given:
            frame_from_root = given[0][1] @ inverse(given[0][0])
        elif self.facts.known:
            frame_from_root = self._onto_control(frame_from_root @ poses) @ frame_from_root
        moved: Float64 = frame_from_root @ poses
        return moved

    def _onto_control(self, poses: Float64) -> Float64:
        known = {k.point: k.place for k in self.facts.known}
        seen = [(self._seen(poses, s), known[s.point]) for s in self.sightings]
        source, target = (np.array(places) for places in zip(*seen, strict=True))
        try:
            return kabsch(source, target)
        except UndeterminedMotion:
            return _upright(source, target)

    def _seen(self, poses: Float64, sighting: Sighting) -> Float64:
        pose = poses[self.place[sighting.station]]
        seen: Float64 = pose[:3, :3] @ sighting.place + pose[:3, 3]
        return seen

    def adjusted(self, poses_only: bool, with_checks: bool) -> Adjusted:
        """Solve, and say what may be believed."""
        for _ in range(_ROUNDS):
            normal, right, _ = self._normal()
            step = normal.solve(right)
            self._move(step)
            if np.abs(step).max() < _CONVERGED:
                break
            self._weigh()
        poses = dict(zip(self.stations, self.poses, strict=True))
        if poses_only:
            return Adjusted(poses, {}, {}, 1.0, 0, np.zeros(2), np.zeros(2))
        normal, _, free = self._normal()
        inverse_blocks = normal.inverse_blocks()
        squares, redundancy = self._fit(free)
        unit_variance = squares / redundancy if redundancy else 1.0
        scale = max(1.0, unit_variance)
        covariances = {s: scale * inverse_blocks[k, k] for s, k in self.place.items()}
        known = self._known_of_links(inverse_blocks)
        checks = self._checks(normal, known, scale) if with_checks else []
        by_ends = {edge.ends: check for edge, check in zip(self.edges, checks, strict=with_checks)}
        pulls, rooms = self._pulls(known)
        return Adjusted(poses, covariances, by_ends, unit_variance, free, pulls, rooms)

    def _residuals(self) -> Float64:
        """Of each link, (omega, v) on the left that takes the adjusted motion to the measured one."""
        expected = np.linalg.inv(self.poses[self.b]) @ self.poses[self.a]
        left = self.measured @ np.linalg.inv(expected)
        turn = Rotation.from_matrix(left[:, :3, :3]).as_rotvec() if len(left) else np.zeros((0, 3))
        return np.concatenate([turn, left[:, :3, 3]], axis=1)

    def _jacobians(self) -> tuple[Float64, Float64]:
        """How the adjusted motion of each link follows its two stations, (M, 6, 6) each."""
        back = np.swapaxes(self.poses[self.b][:, :3, :3], -1, -2)
        apart = self.poses[self.a][:, :3, 3] - self.poses[self.b][:, :3, 3]
        of_a = np.zeros((len(back), 6, 6))
        of_a[:, :3, :3] = of_a[:, 3:, 3:] = back
        of_b = -of_a
        of_a[:, 3:, :3] = back @ skew(apart)
        return of_a, of_b

    def _normal(self) -> tuple[NormalMatrix, Float64, int]:
        blocks: dict[tuple[int, int], Float64] = {}
        first = np.concatenate([[0], np.cumsum(self.sizes)])
        right = np.zeros(first[-1])

        def add(i: int, j: int, block: Float64) -> None:
            key, block = ((i, j), block) if i <= j else ((j, i), block.T)
            blocks[key] = blocks[key] + block if key in blocks else block

        of_a, of_b = self._jacobians()
        weighted = self.information * self.weights[:, None, None]
        residuals = self._residuals()
        to_a, to_b = (np.swapaxes(jacobian, -1, -2) @ weighted for jacobian in (of_a, of_b))
        parts = (to_a @ of_a, to_a @ of_b, to_b @ of_b)
        right_a, right_b = (np.einsum("mij,mj->mi", to, residuals) for to in (to_a, to_b))
        for k, (a, b) in enumerate(zip(self.a.tolist(), self.b.tolist(), strict=True)):
            add(a, a, parts[0][k])
            add(a, b, parts[1][k])
            add(b, b, parts[2][k])
            right[first[a] : first[a] + 6] += right_a[k]
            right[first[b] : first[b] + 6] += right_b[k]
        for nodes, jacobian, residual, information in self._known():
            for i, jacobian_i in zip(nodes, jacobian, strict=True):
                right[first[i] : first[i] + self.sizes[i]] += jacobian_i.T @ information @ residual
                for j, jacobian_j in zip(nodes, jacobian, strict=True):
                    if i <= j:
                        add(i, j, jacobian_i.T @ information @ jacobian_j)
        open_motions = self._open()
        # A prior without a residual: the anchor stays where it is in what nothing else says.
        held = open_motions.T @ open_motions / _HELD**2
        add(self.place[self.anchor], self.place[self.anchor], held)
        return NormalMatrix(self.sizes, blocks), right, len(open_motions)

    def _known(self) -> list[tuple[list[int], list[Float64], Float64, Float64]]:
        """Facts: the unknowns of each, its Jacobians, what is left of it, its information."""
        found: list[tuple[list[int], list[Float64], Float64, Float64]] = []
        for given in self.facts.given:
            at = self.place[given.station]
            turn = Rotation.from_matrix(given.pose[:3, :3] @ self.poses[at][:3, :3].T).as_rotvec()
            residual = np.concatenate([turn, given.pose[:3, 3] - self.poses[at][:3, 3]])
            weight: Float64 = np.asarray(np.linalg.inv(given.covariance), dtype=np.float64)
            found.append(([at], [np.eye(6)], residual, weight))
        for plumb in self.facts.plumb:
            at = self.place[plumb.station]
            x, y, _ = self.poses[at][:3, 2]
            # As for an axis that is upright: what it leans by must not tell a turn about the vertical.
            jacobian = np.zeros((2, 6))
            jacobian[0, 1], jacobian[1, 0] = 1.0, -1.0
            found.append(([at], [jacobian], -np.array([x, y]), np.eye(2) / plumb.sigma**2))
        for sighting in self.sightings:
            at, point = self.place[sighting.station], self.point_place[sighting.point]
            pose = self.poses[at]
            arm = pose[:3, :3] @ sighting.place
            jacobian = np.concatenate([-skew(arm), np.eye(3)], axis=1)
            residual = self.points[point - len(self.stations)] - (arm + pose[:3, 3])
            information: Float64 = pose[:3, :3] @ np.diag(1 / sighting.sigma**2) @ pose[:3, :3].T
            found.append(([at, point], [jacobian, -np.eye(3)], residual, information))
        for known in self.facts.known:
            point = self.point_place[known.point]
            off: Float64 = known.place - self.points[point - len(self.stations)]
            found.append(([point], [np.eye(3)], off, np.diag(1 / known.sigma**2)))
        return found

    def _open(self) -> Float64:
        """Motions of the whole, as (omega, v) of the anchor, that the constraints do not determine: rows."""
        anchor = self.poses[self.place[self.anchor]][:3, 3]
        information = np.zeros((6, 6))
        sigma_of = {k.point: k.sigma for k in self.facts.known}
        for nodes, jacobian, _, information_of in self._known():
            weight = information_of
            if nodes[0] >= len(self.stations):
                continue
            carried = np.eye(6)
            carried[3:, :3] = -skew(self.poses[nodes[0]][:3, 3] - anchor)
            own = jacobian[0] @ carried
            if len(nodes) == 2:
                point = next(p for p, at in self.point_place.items() if at == nodes[1])
                weight = np.linalg.inv(np.linalg.inv(weight) + np.diag(sigma_of[point] ** 2))
            information += own.T @ weight @ own
        scale = np.array([_LOOSE_TURN] * 3 + [_LOOSE] * 3)
        values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
        open_motions: Float64 = vectors[:, values < 1.0].T / (scale / _LOOSE)
        return open_motions

    def _move(self, step: Float64) -> None:
        steps = step[: 6 * len(self.stations)].reshape(-1, 6)
        self.poses = self.poses.copy()
        self.poses[:, :3, :3] = Rotation.from_rotvec(steps[:, :3]).as_matrix() @ self.poses[:, :3, :3]
        self.poses[:, :3, 3] += steps[:, 3:]
        self.points = self.points + step[6 * len(self.stations) :].reshape(-1, 3)

    def _weigh(self) -> None:
        """Huber's weights of whole links (1964)."""
        residuals = self._residuals()
        squares = np.einsum("mi,mij,mj->m", residuals, self.information, residuals)
        self.weights = np.minimum(1.0, _ROBUST / np.sqrt(np.maximum(squares, 1e-12)))

    def _fit(self, free: int) -> tuple[float, int]:
        """Weighted squares of all residuals, and how many observations are more than needed."""
        residuals = self._residuals()
        squares = float(np.einsum("m,mi,mij,mj->", self.weights, residuals, self.information, residuals))
        observations = 6 * len(residuals)
        for _, _, residual, information in self._known():
            squares += float(residual @ information @ residual)
            observations += len(residual)
        return squares, observations - (sum(self.sizes) - free)

    def _known_of_links(self, blocks: Mapping[tuple[int, int], Float64]) -> Float64:
        """Covariance (M, 6, 6) of each link's adjusted motion."""
        of_a, of_b = self._jacobians()
        pairs = list(zip(self.a.tolist(), self.b.tolist(), strict=True))
        cross = np.array([blocks[a, b] if a <= b else blocks[b, a].T for a, b in pairs]).reshape(-1, 6, 6)
        own_a = np.array([blocks[a, a] for a, _ in pairs]).reshape(-1, 6, 6)
        own_b = np.array([blocks[b, b] for _, b in pairs]).reshape(-1, 6, 6)
        mixed = of_a @ cross @ np.swapaxes(of_b, -1, -2)
        known = of_a @ own_a @ np.swapaxes(of_a, -1, -2) + of_b @ own_b @ np.swapaxes(of_b, -1, -2)
        total: Float64 = known + mixed + np.swapaxes(mixed, -1, -2)
        return total

    def _pulls(self, known: Float64) -> tuple[Float64, Float64]:
        weight = self.information * self.weights[:, None, None]
        return np.einsum("mij,mj->mi", weight, self._residuals()), weight - weight @ known @ weight

    def _checks(self, normal: NormalMatrix, known: Float64, scale: float) -> list[Checked]:
        if not self.edges:
            return []
        of_a, of_b = self._jacobians()
        residuals = self._residuals()
        pairs = list(zip(self.a.tolist(), self.b.tolist(), strict=True))
        own = self.covariance / self.weights[:, None, None]
        redundancies = 6.0 - np.trace(np.linalg.inv(own) @ known, axis1=1, axis2=2)
        # Of the residuals' covariance, what the others leave open is no more than rounding.
        left = own - known
        root = np.linalg.cholesky(own)
        whitened = np.linalg.solve(root, np.swapaxes(np.linalg.solve(root, left), -1, -2))
        values = np.linalg.eigvalsh((whitened + np.swapaxes(whitened, -1, -2)) / 2)
        checked = values[:, 0] > _LEAST_REDUNDANCY
        first = np.concatenate([[0], np.cumsum(self.sizes)])
        result = []
        for begin in range(0, len(pairs), _BATCH):
            batch = range(begin, min(begin + _BATCH, len(pairs)))
            pulls = np.zeros((first[-1], len(batch)))
            for k in batch:
                if checked[k]:
                    pull = np.linalg.solve(left[k], residuals[k])
                    a, b = pairs[k]
                    pulls[first[a] : first[a] + 6, k - begin] = of_a[k].T @ pull
                    pulls[first[b] : first[b] + 6, k - begin] = of_b[k].T @ pull
            moved = normal.solve(pulls)[: 6 * len(self.stations)]
            distances = np.linalg.norm(moved.reshape(len(self.stations), 6, -1)[:, 3:], axis=1)
            for k in batch:
                if not checked[k]:
                    result.append(Checked(residuals[k], max(0.0, float(redundancies[k])), None, None, None))
                    continue
                sigmas = np.sqrt(scale * np.diag(left[k]))
                far = int(distances[:, k - begin].argmax())
                result.append(
                    Checked(
                        residuals[k],
                        float(redundancies[k]),
                        float(np.abs(residuals[k] / sigmas).max()),
                        float(distances[far, k - begin]),
                        self.stations[far],
                    )
                )
        return result


def _upright(source: Float64, target: Float64) -> Float64:
    """Motion with a turn about the vertical only that brings places (N, 3) near others; one or a line of them do."""
    centre, goal = source.mean(axis=0), target.mean(axis=0)
    a, b = (source - centre)[:, :2], (target - goal)[:, :2]
    turn = rotation_about_z(float(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))))
    return motion(turn, goal - turn @ centre)
