"""The finite beam: which beams lie over an edge, and what range the instrument gives for them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.simulate.material import REFLECTANCE
from trihedral.simulate.optics import follow
from trihedral.simulate.tracer import Float, Tracer, dot

# Seven rays with the power and the second moment of a Gaussian beam: one in the middle, six on a ring.
CENTRE_WEIGHT = 0.25
RING_RADIUS = (2.0 / 3.0) ** 0.5  # of the beam's 1/e^2 radius
RING = 6
STEEP = 3.0  # ranges that change by more than this, in beam spacings, are looked at as a jump


def edge_beams(
    tracer: Tracer, origin: Float, face: NDArray[np.int32], directions: Float
) -> NDArray[np.bool_]:
    """Beams with a jump in range to a neighbour.

    A crease, where two surfaces meet between two beams, is no jump: the planes' inverse ranges, which are
    linear in the direction, change order between the beams.

    Parameters
    ----------
    face
        (C, R) face met by each beam of C columns, -1 for none.
    directions
        (C, R, 3) unit directions, project axes.

    Returns
    -------
    (C, R) bool.
    """
    surface = np.where(face >= 0, tracer.mesh.surface[face], -1)
    edge = np.zeros(face.shape, bool)
    rows = face.shape[1]
    flat_face, flat_direction = face.reshape(-1), directions.reshape(-1, 3)
    for a, b in (
        ((surface[:, :-1] != surface[:, 1:]), 1),
        ((surface[:-1] != surface[1:]), rows),
    ):
        i, j = np.nonzero(a)
        first = i * rows + j
        second = first + b
        both = (flat_face[first] >= 0) & (flat_face[second] >= 0)
        jump = ~both
        m, n = first[both], second[both]
        jump[both] = ~_crease(
            tracer, origin, flat_face[m], flat_face[n], flat_direction[m], flat_direction[n]
        )
        edge.reshape(-1)[first[jump]] = True
        edge.reshape(-1)[second[jump]] = True
    return edge


def _crease(
    tracer: Tracer,
    origin: Float,
    face_a: NDArray[np.int32],
    face_b: NDArray[np.int32],
    d_a: Float,
    d_b: Float,
) -> NDArray[np.bool_]:
    planes = tracer.planes
    n_a, n_b = planes.normal[face_a], planes.normal[face_b]
    h_a = dot(planes.corner[face_a] - origin, n_a)
    h_b = dot(planes.corner[face_b] - origin, n_b)
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
class Mixed:
    """What (M,) beams over edges return.

    Attributes
    ----------
    changed
        The footprint reached another surface; the rest are as the central ray found them.
    face
        The face that sends most back, -1 if nothing does.
    range
        Metres.
    point
        (M, 3) on that face.
    cosine
        Of the incidence there.
    signal
        Share of a whole beam's signal, relative to that face's own.
    """

    changed: NDArray[np.bool_]
    face: NDArray[np.int32]
    range: Float
    point: Float
    cosine: Float
    signal: Float


def mixed_returns(
    tracer: Tracer,
    origin: Float,
    directions: Float,
    surface: NDArray[np.int32],
    turn: Float,
    diameter: float,
    divergence: float,
    pulse: float,
    pane_delay: float,
) -> Mixed:
    """Average echoes that the pulse cannot tell apart, and keep the strongest group.

    Within one surface the range is never averaged: on an oblique plane the near side of the footprint sends
    more back, and an average would shorten all ranges there. A beam whose rays all meet the surface that its
    central ray met keeps the central range.

    Parameters
    ----------
    directions
        (M, 3) central rays, project axes.
    surface
        (M,) surface met by the central ray, -1 for none.
    turn
        (M, 2) unit vectors (cosine, sine) that turn the ring of rays about the axis.
    diameter, divergence
        Of the beam at its exit, metres, and its full angle, radians, both at 1/e^2.
    pulse
        Metres; echoes nearer to each other are one.
    pane_delay
        Metres that each pane on the way adds.
    """
    m = len(directions)
    helper = np.where(np.abs(directions[:, 2:3]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(helper, directions)
    side /= np.sqrt(dot(side, side))[:, None]
    up = np.cross(directions, side)
    face = np.full((m, RING + 1), -1, np.int32)
    length = np.full((m, RING + 1), np.inf)
    power = np.zeros((m, RING + 1))
    cosine = np.ones((m, RING + 1))
    point = np.zeros((m, RING + 1, 3))
    height = 3.0**0.5 / 2
    hexagon = ((1.0, 0.0), (0.5, height), (-0.5, height), (-1.0, 0.0), (-0.5, -height), (0.5, -height))
    start = np.broadcast_to(origin, (m, 3))
    for k in range(RING + 1):
        if k == 0:
            begin, ray = start, directions
        else:
            c, s = hexagon[k - 1]
            x = turn[:, 0] * c - turn[:, 1] * s
            y = turn[:, 1] * c + turn[:, 0] * s
            offset = RING_RADIUS * (x[:, None] * side + y[:, None] * up)
            begin = start + (diameter / 2) * offset
            ray = directions + (divergence / 2) * offset
            ray /= np.sqrt(dot(ray, ray))[:, None]
        path = follow(tracer, begin, ray, pane_delay=pane_delay)
        face[:, k], length[:, k], point[:, k], cosine[:, k] = (
            path.face,
            path.distance,
            path.point,
            path.cosine,
        )
        weight = CENTRE_WEIGHT if k == 0 else (1 - CENTRE_WEIGHT) / RING
        rho = REFLECTANCE[tracer.mesh.material[path.face]]
        safe = np.where(path.face >= 0, path.distance, 1.0)
        power[:, k] = np.where(path.face >= 0, weight * path.share**2 * rho * path.cosine / safe**2, 0.0)
    met = np.where(face >= 0, tracer.mesh.surface[face], -1)
    changed = (met != met[:, :1]).any(axis=1)
    changed |= met[:, 0] != surface
    order = np.argsort(length, axis=1, kind="stable")
    ranked = np.take_along_axis(length, order, axis=1)
    with np.errstate(invalid="ignore"):
        apart = ~(np.diff(ranked, axis=1) <= pulse)
    group = np.concatenate([np.zeros((m, 1), int), np.cumsum(apart, axis=1)], axis=1)
    ranked_power = np.take_along_axis(power, order, axis=1)
    total = np.zeros((m, RING + 1))
    rows = np.arange(m)
    for k in range(RING + 1):
        total[rows, group[:, k]] += ranked_power[:, k]
    best = np.argmax(total, axis=1)
    kept = (group == best[:, None]) & (ranked_power > 0)
    safe_length = np.where(kept, ranked, 0.0)
    weights = np.where(kept, ranked_power, 0.0)
    summed, summed_range = np.zeros(m), np.zeros(m)
    for k in range(RING + 1):
        summed += weights[:, k]
        summed_range += weights[:, k] * safe_length[:, k]
    mean = summed_range / np.where(summed > 0, summed, 1.0)
    chosen = np.take_along_axis(order, np.argmax(weights, axis=1)[:, None], axis=1)[:, 0]
    # The central ray stands for its group where it belongs to it.
    central = np.zeros(m, bool)
    for k in range(RING + 1):
        central |= (order[:, k] == 0) & kept[:, k]
    chosen = np.where(central, 0, chosen)
    one_surface = np.ones(m, bool)
    sorted_met = np.take_along_axis(met, order, axis=1)
    for k in range(RING + 1):
        one_surface &= ~kept[:, k] | (sorted_met[:, k] == met[rows, chosen])
    mean = np.where(one_surface & central, length[:, 0], mean)
    own = power[rows, chosen]
    share = CENTRE_WEIGHT * (chosen == 0) + (1 - CENTRE_WEIGHT) / RING * (chosen != 0)
    empty = summed <= 0
    return Mixed(
        changed,
        np.where(empty, -1, face[rows, chosen]).astype(np.int32),
        np.where(empty, np.inf, mean),
        point[rows, chosen],
        cosine[rows, chosen],
        np.asarray(np.where(empty, 0.0, summed / np.where(own > 0, own, 1.0) * share)),
    )
