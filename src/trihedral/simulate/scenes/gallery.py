"""A corridor round a courtyard, some 150 m of it: who follows it comes back to where he was."""

import math

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder, Rng
from trihedral.simulate.scene import INDOORS, Scene, anywhere, movers

AROUND = 150.0  # metres along the middle of the corridor


def gallery(seed: int) -> Scene:
    """Make a corridor in a rectangle: doors outside, shutters inside, cupboards; all at uneven distances."""
    rng = np.random.default_rng((seed, 0x6A11))
    b = MeshBuilder.drawn(rng)
    width, height, thin = rng.uniform(2.4, 3.4), rng.uniform(2.6, 3.4), rng.uniform(0.12, 0.3)
    long = rng.uniform(0.27, 0.33) * AROUND
    across = AROUND / 2 - long
    outer, inner = ((long + side, across + side) for side in (width, -width))
    for size, inside in ((outer, False), (inner, True)):
        sx, sy = size
        # The front face is to the right: anticlockwise for the courtyard's walls, clockwise for the outer ones.
        corners = [(-sx / 2, -sy / 2), (sx / 2, -sy / 2), (sx / 2, sy / 2), (-sx / 2, sy / 2)]
        for k in range(4):
            start, end = corners[k], corners[(k + 1) % 4]
            if not inside:
                start, end = end, start
            length = math.dist(start, end)
            openings = _openings(rng, length, inside, height)
            b.wall(start, end, 0, height, thin, M["paint"], openings=openings, reveal=M["wood"])
            ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
            for at, to, low, high in openings:
                # Doors and shutters are shut, behind the wall's face.
                x, y = start[0] + at * ux - thin / 2 * uy, start[1] + at * uy + thin / 2 * ux
                b.quad((x, y, low), ((to - at) * ux, (to - at) * uy, 0), (0, 0, high - low), M["wood"])
            for along in np.arange(rng.uniform(2, 5), length - 2.5, rng.uniform(4, 7)):
                if any(at - 1.9 < along < to + 0.1 for at, to, _, _ in openings):
                    continue
                x, y = start[0] + along * ux + thin / 2 * uy, start[1] + along * uy - thin / 2 * ux
                cupboard = rng.random() < 0.6
                thing = parts.cabinet(rng) if cupboard else parts.shelf(rng, rng.uniform(0.8, 1.8), 1.9)
                b.put(thing, x, y, 0, math.atan2(uy, ux))
    (x, y), (u, v) = (outer[0] / 2, outer[1] / 2), (inner[0] / 2, inner[1] / 2)
    for x0, x1, y0, y1 in ((-x, x, -y, -v), (-x, x, v, y), (-x, -u, -v, v), (u, x, -v, v)):
        b.quad((x0, y0, 0), (x1 - x0, 0, 0), (0, y1 - y0, 0), M["tiles"])
        b.quad((x0, y0, height), (x1 - x0, 0, 0), (0, y1 - y0, 0), M["ceiling"])
    middle = _middle(long, across)
    for k in range(0, len(middle), int(rng.integers(5, 9))):
        px, py = middle[k]
        b.box((px - 0.3, py - 0.3, height - 0.08), (px + 0.3, py + 0.3, height - 0.005), M["lamp"])
    places = np.column_stack([middle, np.zeros(len(middle))])
    people = movers(rng, parts.person, anywhere(places), 1, 5)
    return Scene("gallery", seed, b.mesh(), people, INDOORS, places, 8.0)


def _openings(
    rng: Rng, length: float, windows: bool, height: float
) -> list[tuple[float, float, float, float]]:
    """Doors, or windows with shutters, at uneven distances."""
    openings = []
    at = rng.uniform(1.5, 4.0)
    while at < length - 3.0:
        size = rng.uniform(1.2, 2.4) if windows else rng.uniform(0.85, 1.05)
        low, high = (0.9, min(height - 0.3, 2.4)) if windows else (0.0, 2.1)
        openings.append((at, at + size, low, high))
        at += size + rng.uniform(2.0, 6.0)
    return openings


def _middle(long: float, across: float) -> Float64:
    """(N, 2) places along the middle of the corridor, half a metre apart."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array([long, across]) / 2
    sides = [(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    return np.concatenate([np.linspace(a, c, int(2 * math.dist(a, c)), endpoint=False) for a, c in sides])
