"""The finite beam: which beams lie over an edge, and what range the instrument gives for them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64
from trihedral.simulate.material import REFLECTANCE
from trihedral.simulate.optics import follow
from trihedral.simulate.returns import ReturnKind, Returns
from trihedral.simulate.tracer import Tracer, dot

# Seven rays with the power and the second moment of a Gaussian beam: one in the middle, six on a ring.
CENTRE_WEIGHT = 0.25
RING_RADIUS = (2.0 / 3.0) ** 0.5  # of the beam's 1/e^2 radius
RING = 6
_HEIGHT = 3.0**0.5 / 2
HEXAGON = ((1.0, 0.0), (0.5, _HEIGHT), (-0.5, _HEIGHT), (-1.0, 0.0), (-0.5, -_HEIGHT), (0.5, -_HEIGHT))
WEIGHTS = (CENTRE_WEIGHT, *[(1 - CENTRE_WEIGHT) / RING] * RING)
STEEP = 3.0  # ranges that change by more than this, in beam spacings, are looked at as a jump


def edge_beams(
    tracer: Tracer, origin: Float64, face: NDArray[np.int32], directions: Float64
) -> NDArray[np.bool_]:
    """Which beams (C, R) of C columns have a jump in range to a neighbour.

    They met `face` (C, R), -1 for none, along unit `directions` (C, R, 3), project axes. A crease, where two
    surfaces meet between two beams, is no jump: the planes' inverse ranges, which are linear in the direction,
    change order between the beams.
    """
    surface = tracer.surface(face)
    edge = np.zeros(face.size, bool)
    rows = face.shape[1]
    flat_face, flat_direction = face.reshape(-1), directions.reshape(-1, 3)
    for differs, step in ((surface[:, :-1] != surface[:, 1:], 1), (surface[:-1] != surface[1:], rows)):
        i, j = np.nonzero(differs)
        first = i * rows + j
        both = (flat_face[first] >= 0) & (flat_face[first + step] >= 0)
        jump = ~both
        m = first[both]
        jump[both] = ~_crease(tracer, origin, flat_face, flat_direction, m, m + step)
        edge[first[jump]] = edge[first[jump] + step] = True
    return edge.reshape(face.shape)


def _crease(
    tracer: Tracer,
    origin: Float64,
    face: NDArray[np.int32],
    direction: Float64,
    a: NDArray[np.int64],
    b: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Whether beams `a` and their neighbours `b` lie on either side of a crease."""
    planes = tracer.planes
    n_a, n_b = planes.normal[face[a]], planes.normal[face[b]]
    d_a, d_b = direction[a], direction[b]
    h_a = dot(planes.corner[face[a]] - origin, n_a)
    h_b = dot(planes.corner[face[b]] - origin, n_b)
    scale = h_a * h_b
    a_at_a, b_at_b = dot(n_a, d_a), dot(n_b, d_b)
    at_a = (a_at_a * h_b - dot(n_b, d_a) * h_a) * scale
    at_b = (dot(n_a, d_b) * h_b - b_at_b * h_a) * scale
    # The last facet of a round thing, seen almost edge-on, also runs into what lies behind it.
    apart = d_a - d_b
    with np.errstate(divide="ignore", invalid="ignore"):
        range_a = h_a / a_at_a
        gentle = np.abs(range_a - h_b / b_at_b) < STEEP * np.abs(range_a) * np.sqrt(dot(apart, apart))
    return np.asarray((at_a * at_b <= 0) & gentle)


@dataclass(frozen=True)
class Beam:
    """A beam that is not infinitely thin."""

    #: At its exit, metres, 1/e^2.
    diameter: float
    #: Full angle, radians, 1/e^2.
    divergence: float
    #: Metres; echoes nearer to each other are one.
    pulse: float
    #: Metres that each pane on the way adds.
    pane_delay: float = 0.0


@dataclass(frozen=True)
class Footprints:
    """What the rays of (M,) footprints met, (M, RING + 1) each; the central ray is the first."""

    face: NDArray[np.int32]
    #: -1 for none.
    surface: NDArray[np.int32]
    distance: Float64
    #: (M, RING + 1, 3).
    point: Float64
    cosine: Float64
    #: What comes back along each ray.
    power: Float64


@dataclass(frozen=True)
class _Echo:
    """The rays that make up one echo of (M,) beams, (M, RING + 1) each, from near to far."""

    order: NDArray[np.int64]
    #: Whether the ray belongs to the echo.
    kept: NDArray[np.bool_]
    #: Both 0 where the ray does not belong to it.
    power: Float64
    distance: Float64


def footprints(
    tracer: Tracer,
    beam: Beam,
    origins: Float64,
    directions: Float64,
    over: NDArray[np.int64],
    rng: np.random.Generator,
) -> Footprints | None:
    """Follow the rays of those of (N, 3) beams, project axes, that lie `over` an edge; None where there are none.

    `rng` turns their rings of rays about the axis.
    """
    if not len(over):
        return None
    draws = rng.random((len(over), 2)) * 2.0 - 1.0
    norm = np.sqrt(draws[:, 0] ** 2 + draws[:, 1] ** 2)
    turn = np.where(norm[:, None] > 1e-6, draws / np.maximum(norm, 1e-6)[:, None], [1.0, 0.0])
    return _footprints(tracer, beam, origins[over], directions[over], turn)


def with_mixed(
    tracer: Tracer, pulse: float, central: Returns, over: NDArray[np.int64], seen: Footprints | None
) -> Returns:
    """Average echoes that the pulse cannot tell apart, and keep the strongest group.

    Within one surface the range is never averaged: on an oblique plane the near side of the footprint sends
    more back, and an average would shorten all ranges there. A beam whose rays all meet the surface that its
    central ray met keeps the central range.

    `central` is what the central rays of (N,) beams bring back; `over` are the numbers of those that lie over an
    edge, and `seen` is what their rays met.
    """
    if seen is None:
        return central
    changed = (seen.surface != seen.surface[:, :1]).any(axis=1)
    changed |= seen.surface[:, 0] != tracer.surface(central.face[over])
    mixed = _averaged(seen, _echo(seen, pulse))
    return central.replaced(over[changed], mixed.of(changed))


def further_echoes(beams: int, pulse: float, over: NDArray[np.int64], seen: Footprints, rank: int) -> Returns:
    """Give of each of (N,) beams the echo that is weaker than `rank` others; face -1 where there is none."""
    none = Returns(
        np.full(beams, -1, np.int32), np.full(beams, np.inf), np.zeros((beams, 3)), np.zeros(beams), np.zeros(beams),
        np.zeros(beams, np.uint8),
    )  # fmt: skip
    return none.replaced(over, _averaged(seen, _echo(seen, pulse, rank)))


def _footprints(
    tracer: Tracer, beam: Beam, origins: Float64, directions: Float64, turn: Float64
) -> Footprints:
    """Follow the rays of footprints whose rings are turned by (M, 2) unit vectors (cosine, sine)."""
    helper = np.where(np.abs(directions[:, 2:3]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(helper, directions)
    side /= np.sqrt(dot(side, side))[:, None]
    up = np.cross(directions, side)
    paths = [follow(tracer, origins, directions, pane_delay=beam.pane_delay)]
    for c, s in HEXAGON:
        x = turn[:, 0] * c - turn[:, 1] * s
        y = turn[:, 1] * c + turn[:, 0] * s
        offset = RING_RADIUS * (x[:, None] * side + y[:, None] * up)
        ray = directions + (beam.divergence / 2) * offset
        ray /= np.sqrt(dot(ray, ray))[:, None]
        begin = origins + (beam.diameter / 2) * offset
        paths.append(follow(tracer, begin, ray, pane_delay=beam.pane_delay))
    power = []
    for path, weight in zip(paths, WEIGHTS, strict=True):
        rho = REFLECTANCE[tracer.mesh.material[path.face]]
        safe = np.where(path.face >= 0, path.distance, 1.0)
        power.append(np.where(path.face >= 0, weight * path.share**2 * rho * path.cosine / safe**2, 0.0))
    face = np.stack([path.face for path in paths], axis=1)
    distance, point, cosine = (
        np.stack([getattr(path, key) for path in paths], axis=1) for key in ("distance", "point", "cosine")
    )
    return Footprints(face, tracer.surface(face), distance, point, cosine, np.stack(power, axis=1))


def _echo(seen: Footprints, pulse: float, rank: int = 0) -> _Echo:
    """Group the rays whose ranges the pulse cannot tell apart; of the groups take the strongest after `rank` others."""
    m = len(seen.face)
    order = np.argsort(seen.distance, axis=1, kind="stable")
    distance = np.take_along_axis(seen.distance, order, axis=1)
    power = np.take_along_axis(seen.power, order, axis=1)
    with np.errstate(invalid="ignore"):
        apart = ~(np.diff(distance, axis=1) <= pulse)
    group = np.concatenate([np.zeros((m, 1), int), np.cumsum(apart, axis=1)], axis=1)
    total = np.zeros((m, RING + 1))
    for k in range(RING + 1):
        total[np.arange(m), group[:, k]] += power[:, k]
    chosen = np.argsort(-total, axis=1, kind="stable")[:, rank]
    kept = (group == chosen[:, None]) & (power > 0)
    return _Echo(order, kept, np.where(kept, power, 0.0), np.where(kept, distance, 0.0))


def _averaged(seen: Footprints, echo: _Echo) -> Returns:
    """One return of each beam: the echo's mean range, and the surface that sends most of it back."""
    m, rows = len(seen.face), np.arange(len(seen.face))
    summed, summed_range = np.zeros(m), np.zeros(m)
    for k in range(RING + 1):
        summed += echo.power[:, k]
        summed_range += echo.power[:, k] * echo.distance[:, k]
    mean = summed_range / np.where(summed > 0, summed, 1.0)
    strongest = echo.order[rows, np.argmax(echo.power, axis=1)]
    # The central ray stands for its group where it belongs to it.
    central = ((echo.order == 0) & echo.kept).any(axis=1)
    chosen = np.where(central, 0, strongest)
    surface = np.take_along_axis(seen.surface, echo.order, axis=1)
    one_surface = (~echo.kept | (surface == seen.surface[rows, chosen][:, None])).all(axis=1)
    mean = np.where(one_surface & central, seen.distance[:, 0], mean)
    own = seen.power[rows, chosen]
    weight = np.where(chosen == 0, WEIGHTS[0], WEIGHTS[1])
    empty = summed <= 0
    return Returns(
        np.where(empty, -1, seen.face[rows, chosen]).astype(np.int32),
        np.where(empty, np.inf, mean),
        seen.point[rows, chosen],
        seen.cosine[rows, chosen],
        np.where(empty, 0.0, summed / np.where(own > 0, own, 1.0) * weight),
        np.full(m, ReturnKind.MIXED, np.uint8),
    )
