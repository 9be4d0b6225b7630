"""A straight wall's geometry: its two faces with rectangular openings."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

Point = tuple[float, float, float]
Opening = tuple[float, float, float, float]  # from, to: metres along a wall; bottom, top: above its foot


@dataclass(frozen=True)
class Course:
    """Where a wall runs: from its start along (ux, uy), its front to the right."""

    start: tuple[float, float]
    ux: float
    uy: float
    length: float
    foot: float
    height: float
    thickness: float

    @staticmethod
    def between(
        start: tuple[float, float], end: tuple[float, float], foot: float, height: float, thickness: float
    ) -> "Course":
        """From one end of the centre line to the other."""
        dx, dy = end[0] - start[0], end[1] - start[1]
        length = math.hypot(dx, dy)
        return Course(start, dx / length, dy / length, length, foot, height, thickness)

    def at(self, along: float, across: float, up: float) -> Point:
        """Give the place so far along the centre line, to its right and above its foot."""
        x, y = self.start
        return x + self.ux * along + self.uy * across, y + self.uy * along - self.ux * across, self.foot + up

    def step(self, length: float) -> Point:
        """So far along the wall."""
        return self.ux * length, self.uy * length, 0.0

    @property
    def depth(self) -> Point:
        """Through the wall, from its back to its front."""
        return self.uy * self.thickness, -self.ux * self.thickness, 0.0

    def face(
        self, across: float, openings: Sequence[Opening]
    ) -> tuple[list[Point], list[list[int]], list[tuple[float, float]]]:
        """Give vertices, triangles and texture coordinates of one face: a grid without its cells in openings."""
        cuts = sorted({0.0, self.length, *(c for o in openings for c in o[:2])})
        levels = sorted({0.0, self.height, *(c for o in openings for c in o[2:])})
        faces, n = [], len(cuts)
        for j, (below, above) in enumerate(pairwise(levels)):
            for i, (left, right) in enumerate(pairwise(cuts)):
                a, h = (left + right) / 2, (below + above) / 2
                if not any(o[0] < a < o[1] and o[2] < h < o[3] for o in openings):
                    k = j * n + i
                    faces += [[k, k + 1, k + n + 1], [k, k + n + 1, k + n]]
        uv = [(a, h) for h in levels for a in cuts]
        return [self.at(a, across, h) for a, h in uv], faces, uv
