"""Where a testbed's stations find room in a scene, with overlaps as nearly as possible those of the paper."""

import math
from dataclasses import dataclass

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.simulate.covisible import reaches
from trihedral.simulate.mesh import Rng
from trihedral.simulate.placement import seen_from, sphere
from trihedral.simulate.rig import RigOptions
from trihedral.simulate.scene import Scene
from trihedral.simulate.testbeds import Testbed
from trihedral.simulate.tracer import Tracer

HEAD_M = 1.32  # of the line scanners above the ground
CLEAR_M = 0.55  # around the rig's head
ROOM_M = 0.45  # around the robot's foot
PROBE_RAYS = 1500  # sent from a place to learn what it shows
FAR_M = 40.0  # surfaces farther away count no more than at this range, as few rays fall on them
PLACES_TRIED = 60  # of those with room for the robot everywhere
DRAWS = 4000  # of position and direction


@dataclass(frozen=True)
class PlaceSearch:
    """A testbed to be laid out in a scene."""

    testbed: Testbed
    scene: Scene
    tracer: Tracer
    options: RigOptions

    def best(self, rng: Rng) -> tuple[float, Float64] | None:
        """How far the overlaps are from the paper's (RMS), and places (K, 3) on the ground."""
        plan, stands = np.array(self.testbed.plan), self.scene.stands
        low, high = stands.min(axis=0), stands.max(axis=0)
        middle, reach = (low[:2] + high[:2]) / 2, (high[:2] - low[:2]) / 2
        best: tuple[float, Float64] | None = None
        tried = 0
        for _ in range(DRAWS):
            turn, mirror = rng.uniform(0.0, 2.0 * math.pi), rng.choice([-1.0, 1.0])
            centre = middle + rng.uniform(-0.8, 0.8, 2) * reach
            c, s = math.cos(turn), math.sin(turn)
            plane = (plan * [1.0, mirror]) @ np.array([[c, s], [-s, c]]) + centre
            if ((plane < low[:2] - 2.0) | (plane > high[:2] + 2.0)).any():
                continue
            places = self.on_ground(plane)
            if places is None:
                continue
            error = self.overlap_error(places + np.array([0.0, 0.0, HEAD_M]))
            if best is None or error < best[0]:
                best = (error, places)
            tried += 1
            if tried >= PLACES_TRIED:
                break
        return best

    def on_ground(self, plane: Float64) -> Float64 | None:
        """Places (K, 3) below (K, 2), or None where the robot has no room or could not drive there."""
        stands, n = self.scene.stands, len(plane)
        off = ((stands[None, :, :2] - plane[:, None]) ** 2).sum(axis=2)
        level = stands[np.argmin(off + 0.2 * stands[None, :, 2] ** 2, axis=1), 2]
        above, down = np.column_stack([plane, level + 1.0]), np.array([0.0, 0.0, -1.0])
        face, drop = self.tracer.cast(above, np.broadcast_to(down, (n, 3)))
        if (face < 0).any() or (np.abs(drop - 1.0) > 0.9).any():
            return None
        z = level + 1.0 - drop
        if np.ptp(z) > 4.0:
            return None
        # Exact in float32, so that Embree and float64 start rays at the same place.
        places = np.rint(np.column_stack([plane, z]) * 1024.0) / 1024.0
        around = sphere(96)
        k = np.arange(24) * math.pi / 12
        level_rays = np.stack([np.cos(k), np.sin(k), 0.0 * k], axis=1)
        for height, rays, room in (
            (HEAD_M, around[around[:, 2] > -0.6], CLEAR_M),
            (0.45, level_rays, ROOM_M),
        ):
            starts = np.repeat(places + np.array([0.0, 0.0, height]), len(rays), axis=0)
            _, near = self.tracer.cast(starts, np.tile(rays, (n, 1)))
            if near.min() < room:
                return None
        return places

    def overlap_error(self, heads: Float64) -> float:
        """RMS difference of the overlaps from the paper's."""
        first, most = self.testbed.first, self.options.max_range_m
        rays = sphere(PROBE_RAYS)
        rays = rays[rays[:, 2] > math.sin(math.radians(self.options.lowest_deg))]
        seen = [seen_from(self.tracer, head, rays, most, FAR_M) for head in heads]
        squares = []
        for (a, b), wanted in self.testbed.overlap.items():
            shares = []
            for own, other in ((a, b), (b, a)):
                points, area = seen[own - first]
                reached = reaches(self.tracer, heads[other - first], points, most)
                shares.append(float(area[reached].sum() / max(float(area.sum()), 1e-9)))
            squares.append((min(shares) - wanted) ** 2)
        return math.sqrt(sum(squares) / len(squares))
