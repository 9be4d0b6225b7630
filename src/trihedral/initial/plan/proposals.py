"""Poses from the plans of two scans.

Patches say which way is up and which ways walls face: that leaves a few rotations. For each of them the correlation of
the two plans says where upright surfaces would meet; floors, ceilings and wall tops say at which height.
"""

from dataclasses import dataclass, field

import numpy as np

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import inverse, motion
from trihedral.initial.plan.headings import turns, wall_headings
from trihedral.initial.plan.vertical import VerticalOptions, upright_rotations
from trihedral.scan.mounting import LEANING, MOST, STANDING, Mounting
from trihedral.scan.prepared import Prepared


@dataclass(frozen=True)
class PlanOptions:
    """How many poses are proposed, and on which plan."""

    #: How a leaning scan is set upright first.
    vertical: VerticalOptions = field(default_factory=VerticalOptions)
    #: Headings tried a pair of verticals, at the most.
    turns: int = 16
    #: Shifts kept a heading.
    shifts: int = 200
    #: Shifts kept over all headings.
    places: int = 1000
    #: Heights kept a shift.
    heights: int = 5
    #: Poses kept of all these.
    poses: int = 600
    #: Metres a side of a cell, where the plan has not more of them than `most_side`.
    cell: float = 0.25
    #: Cells a side of the plan, at the least.
    least_side: int = 384
    #: Cells a side of the plan, at the most.
    most_side: int = 768
    #: Metres; surfaces beyond it do not vote.
    farthest: float = 150.0
    #: Surfels that vote.
    samples: int = 20_000

    def __post_init__(self) -> None:
        if min(self.turns, self.shifts, self.places, self.heights, self.poses, self.samples) < 1:
            raise OptionError("turns, shifts, places, heights, poses and samples must be at least 1")
        if min(self.cell, self.farthest) <= 0 or not 16 <= self.least_side <= self.most_side:
            raise OptionError(
                "cell and farthest must be positive, least_side at least 16 and most_side no less"
            )


def plan_poses(a: Prepared, b: Prepared, options: PlanOptions) -> list[tuple[Float64, float]]:
    """Motions with the correlation of the plans under them times the share of heights that meet, best first."""
    seen = max(_farthest(a), _farthest(b))
    farthest = min(options.farthest, seen)
    # Shifts of up to twice the distance do not wrap round; sides that are products of small primes are fast.
    side = int(np.clip(64 * np.ceil(3 * farthest / options.cell / 64), options.least_side, options.most_side))
    found, scores = [np.empty((0, 4, 4))], [np.empty(0)]
    for upright_from_a, upright_from_b in _verticals(a, b, options.vertical):
        yaws = turns(wall_headings(a, upright_from_a), wall_headings(b, upright_from_b), options.turns)
        placements = _core.upright_placements(
            a.surfel_map,
            b.surfel_map,
            upright_from_a,
            upright_from_b,
            yaws,
            cell=3 * farthest / side,
            side=side,
            farthest=farthest,
            samples=options.samples,
            shifts=options.shifts,
            places=options.places,
            heights=options.heights,
        )
        yaw = placements.yaws.astype(np.float64)
        turned = np.tile(np.eye(4), (len(yaw), 1, 1))
        turned[:, 0, 0] = turned[:, 1, 1] = np.cos(yaw)
        turned[:, 1, 0] = np.sin(yaw)
        turned[:, 0, 1] = -turned[:, 1, 0]
        turned[:, :3, 3] = placements.shifts
        found.append(inverse(motion(upright_from_b)) @ turned @ motion(upright_from_a))
        scores.append(placements.scores.astype(np.float64))
    poses, values = np.concatenate(found), np.concatenate(scores)
    best = np.argsort(-values, kind="stable")[: options.poses]
    return list(zip(poses[best], values[best].tolist(), strict=True))


def _verticals(a: Prepared, b: Prepared, options: VerticalOptions) -> list[tuple[Float64, Float64]]:
    """Both scans as they stand, or both as their surfaces have it, in each way that they may both be mounted."""
    found = []
    for mounted_a, mounted_b in _mountings(a.mounting, b.mounting):
        # A leaning scan's own vertical comes first, that of the instrument last.
        uprights_a = upright_rotations(a, options, mounted_a)
        uprights_b = upright_rotations(b, options, mounted_b)
        found.append((uprights_a[-1], uprights_b[-1]))
        if len(uprights_a) + len(uprights_b) > 2:
            found.append((uprights_a[0], uprights_b[0]))
    return found


def _mountings(a: Mounting, b: Mounting) -> list[tuple[Float64, Float64]]:
    """Ways in which both may be mounted, the likeliest first: most scanners of a job are mounted alike."""
    likelihood = a.log_likelihood[:, None] + b.log_likelihood
    alike = a.upright_from_scanner[:, 2] @ b.upright_from_scanner[:, 2].T
    likelihood = np.where(alike > np.cos(LEANING), likelihood + STANDING, likelihood)
    order = np.argsort(-likelihood, axis=None, kind="stable")[:MOST]
    ways = [
        np.unravel_index(way, likelihood.shape)
        for way in order
        if likelihood.flat[way] > likelihood.max() - STANDING
    ]
    return [(a.upright_from_scanner[i], b.upright_from_scanner[j]) for i, j in ways]


def _farthest(prepared: Prepared) -> float:
    """Distance (m) within which all but one in a thousand surfels lie: far walls are few surfels, and say much."""
    return float(np.percentile(np.linalg.norm(prepared.surfels.points, axis=1), 99.9))
