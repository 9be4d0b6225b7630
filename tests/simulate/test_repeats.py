"""Scenes that repeat do so in shape: rays from like places have like ranges."""

import numpy as np
import pytest

from trihedral.simulate.placement import sphere
from trihedral.simulate.scenes import build
from trihedral.simulate.tracer import Tracer


def ranges(tracer: Tracer, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    return tracer.cast(np.broadcast_to(origin, directions.shape), directions)[1]


def alike(a: np.ndarray, b: np.ndarray, within: float = 0.002) -> float:
    """Share of rays that end as far away, to `within` metres, or both nowhere."""
    same = np.isinf(a) & np.isinf(b)
    both = np.isfinite(a) & np.isfinite(b)
    same[both] = np.abs(a[both] - b[both]) < within
    return float(same.mean())


@pytest.mark.parametrize("seed", [1, 2])
def test_half_a_turn_takes_a_hall_onto_itself(seed: int) -> None:
    scene = build("hall", seed)
    tracer, rays = Tracer(scene.mesh), sphere(4000)
    turned = rays * [-1.0, -1.0, 1.0]
    for place in scene.stands[::37]:
        head = place + np.array([0.0, 0.0, 1.7])
        assert alike(ranges(tracer, head, rays), ranges(tracer, head * [-1.0, -1.0, 1.0], turned)) > 0.99


@pytest.mark.parametrize(("name", "least"), [("rooms", 0.85), ("corridor", 0.9), ("hotel", 0.85)])
def test_places_repeat_along_a_row(name: str, least: float) -> None:
    scene = build(name, 3)
    tracer, rays = Tracer(scene.mesh), sphere(1000)
    # Far rays along the row end elsewhere.
    rays = rays[np.abs(rays[:, 0]) < 0.7]
    head = np.append(np.median(scene.stands[:, :2], axis=0), 1.7)
    here = ranges(tracer, head, rays)

    def after(step: float, within: float = 0.002) -> float:
        return alike(here, ranges(tracer, head + np.array([step, 0.0, 0.0]), rays), within)

    coarse = max(np.arange(2.5, 6.0, 0.01), key=lambda step: after(step, 0.02))
    period = max(coarse + np.arange(-0.01, 0.01, 0.0005), key=after)
    assert after(period) > least
    assert after(period / 2) < after(period) - 0.1
