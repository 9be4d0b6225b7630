"""A yard of ground, two walls and clutter, in which planes are found and laid on each other."""

import numpy as np


def rectangle(rng: np.random.Generator, origin: list[float], u: list[float], v: list[float]) -> np.ndarray:
    """100 points a square metre, 5 mm of noise across."""
    u_, v_ = np.array(u), np.array(v)
    area = np.linalg.norm(np.cross(u_, v_))
    normal = np.cross(u_, v_) / area
    s, t = rng.uniform(size=(2, int(100 * area), 1))
    return origin + s * u_ + t * v_ + rng.normal(scale=0.005, size=s.shape) * normal


def yard(seed: int) -> np.ndarray:
    """Ground of 14 x 10 m, walls of 10 x 5 and 14 x 3 m that are 100 degrees apart, and clutter."""
    rng = np.random.default_rng(seed)
    skewed = [14 * np.cos(np.radians(10)), 14 * np.sin(np.radians(10)), 0.0]
    return np.concatenate(
        [
            rectangle(rng, [0, 0, -1.6], [14, 0, 0], [0, 10, 0]),
            rectangle(rng, [0, 0, -1.6], [0, 10, 0], [0, 0, 5]),
            rectangle(rng, [0, 0, -1.6], skewed, [0, 0, 3]),
            rng.uniform([1, 1, -1.6], [9, 8, 2], (2500, 3)),
        ]
    )
