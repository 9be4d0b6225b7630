"""A scanner that moves while it measures, as mobile ones do: many turns, each from another place."""

import math
from dataclasses import replace

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.simulate.exports import FileScan, as_measured, merged
from trihedral.simulate.site import Site

STEP_M = 0.25  # between the places of two turns
SHARE = 0.7  # of the free way ahead that is gone
HEADINGS = 72  # that the longest free way is looked for in


def trajectory(site: Site, k: int, metres: float) -> FileScan:
    """Measure along a straight way of at most so many metres from station `k`, with as many beams as a scan has.

    The frame is that of the first turn; `scanners` are the places of all.
    """
    start = site.poses[k]
    heading, free = _longest_way(site, start)
    length = min(metres, SHARE * free)
    turns = max(2, round(length / STEP_M) + 1)
    rows, columns = site.scanner.grid
    slower = replace(site.scanner.with_beams(max(1, rows * columns // turns)), color=site.scanner.color)
    still = replace(site, scanner=slower)
    parts = []
    for turn, gone in enumerate(np.linspace(0.0, length, turns)):
        pose = start.copy()
        # Exact in float32, as stations are.
        pose[:3, 3] = np.rint((start[:3, 3] + gone * heading) * 1024.0) / 1024.0
        parts.append(as_measured(still.scan_from(k, pose, turn), (site.scene.seed, k)))
    return merged(parts)


def _longest_way(site: Site, pose: Float64) -> tuple[Float64, float]:
    """The level direction (3,) with nothing ahead for the longest way, and that way."""
    turn = np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS)
    rays = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    _, free = site.still.cast(np.broadcast_to(pose[:3, 3], rays.shape), rays)
    free = np.minimum(free, site.scanner.max_range_m)
    best = int(np.argmax(free))
    return rays[best], float(free[best])
