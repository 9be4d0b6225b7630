"""Where the tripod goes: clear places, each sharing enough of what it sees with one chosen before."""

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import TrihedralError
from trihedral.geometry.arrays import Float64
from trihedral.simulate.covisible import reaches
from trihedral.simulate.mesh import Rng
from trihedral.simulate.scene import Scene
from trihedral.simulate.tracer import Tracer, dot

CLEARANCE_M = 0.42  # nothing within this of the scanner, all round
PROBE_RAYS = 600  # sent from each candidate to learn what it sees
WEIGHT_RANGE_M = 25.0  # farther surfaces count no more than this, as they are sampled thinly
CANDIDATES = 240  # at least; a project of many stations has more
CANDIDATES_A_STATION = 6


def sphere(count: int) -> Float64:
    """(N, 3) directions spread evenly over the sphere (a Fibonacci spiral)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = k * (np.pi * (3.0 - np.sqrt(5.0)))
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def plan_stations(
    scene: Scene, tracer: Tracer, stations: int, overlap: tuple[float, float], max_range: float, rng: Rng
) -> Float64:
    """Choose stations (K, 3), project frame, that each share `overlap` (least, most) of their view with an earlier one.

    Raises
    ------
    TrihedralError
        The scene has no room for so many.
    """
    most = max(CANDIDATES, CANDIDATES_A_STATION * stations)
    places = scene.stands[rng.permutation(len(scene.stands))][: 3 * most]
    heads = places.copy()
    heads[:, 2] += rng.uniform(1.5, 1.9, len(places))
    # Exact in float32, so that Embree and float64 start rays at the same place.
    heads = np.rint(heads * 1024.0) / 1024.0
    heads = heads[_clear(tracer, places, heads)][:most]
    if len(heads) < stations:
        raise TrihedralError(f"The {scene.name} of seed {scene.seed} has no room for {stations} stations.")
    rays = sphere(PROBE_RAYS)
    views = [seen_from(tracer, head, rays, max_range, WEIGHT_RANGE_M) for head in heads]
    amount = np.array([weight.sum() for _, weight in views])
    chosen = [int(np.argmax(amount[: max(8, len(heads) // 4)]))]
    best = np.zeros(len(heads))
    low, high = overlap
    while len(chosen) < stations:
        column = _shared_with(tracer, chosen[-1], heads, views, amount, max_range)
        best = np.maximum(best, column)
        best[chosen] = 2.0
        within = np.flatnonzero((best >= low) & (best <= high))
        if len(within):
            # Among good candidates the one that shows most that is new, with some chance in it.
            gain = amount[within] * (1.0 - best[within]) * rng.uniform(0.7, 1.0, len(within))
            chosen.append(int(within[np.argmax(gain)]))
        else:
            miss = np.maximum(low - best, best - high)
            miss[chosen] = np.inf
            chosen.append(int(np.argmin(miss)))
    return heads[chosen]


def _clear(tracer: Tracer, places: Float64, heads: Float64) -> NDArray[np.bool_]:
    """Whether nothing is near the scanner and its legs, and the ground is below it."""
    n = len(heads)
    down = np.broadcast_to(np.array([0.0, 0.0, -1.0]), (n, 3))
    _, drop = tracer.cast(heads, down)
    good = np.abs(drop - (heads[:, 2] - places[:, 2])) < 0.05
    at = np.flatnonzero(good)
    around = sphere(96)
    _, near = tracer.cast(np.repeat(heads[at], len(around), axis=0), np.tile(around, (len(at), 1)))
    good[at] = near.reshape(len(at), -1).min(axis=1) > CLEARANCE_M
    return good


def seen_from(
    tracer: Tracer, head: Float64, rays: Float64, max_range: float, far: float
) -> tuple[Float64, Float64]:
    """Points hit by evenly spread rays, and the area that each stands for; beyond `far` it grows no more."""
    face, length = tracer.cast(np.broadcast_to(head, rays.shape), rays)
    hit = np.flatnonzero(length < max_range)
    cosine = np.abs(dot(rays[hit], tracer.planes.normal[face[hit]]))
    area = np.minimum(length[hit], far) ** 2 / np.maximum(cosine, 0.1)
    return head + rays[hit] * length[hit, None], area


def _shared_with(
    tracer: Tracer,
    one: int,
    heads: Float64,
    views: list[tuple[Float64, Float64]],
    amount: Float64,
    max_range: float,
) -> Float64:
    """(N,) the share of its view that each candidate has in common with `one`, the smaller of both ways."""
    of = np.repeat(np.arange(len(views)), [len(points) for points, _ in views])
    points = np.concatenate([points for points, _ in views])
    area = np.concatenate([area for _, area in views])
    there = np.bincount(of, area * reaches(tracer, heads[one], points, max_range), len(views))
    seen, weight = views[one]
    back = np.empty(len(views))
    for k, head in enumerate(heads):
        # A candidate that sees nothing of `one` need not be asked the other way round.
        back[k] = weight[reaches(tracer, head, seen, max_range)].sum() if there[k] > 0 else 0.0
    return np.minimum(there / np.maximum(amount, 1e-9), back / max(float(amount[one]), 1e-9))
