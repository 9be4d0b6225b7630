"""A long bare corridor with equal doors at equal distances: what a scan sees is the same some metres farther on."""

import math

import numpy as np

from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder, placement
from trihedral.simulate.scene import INDOORS, Scene, anywhere, movers


def corridor(seed: int) -> Scene:
    """Make a corridor; in half of the seeds a few cupboards tell its places apart, in the others nothing does."""
    rng = np.random.default_rng((seed, 0xC0881))
    b = MeshBuilder.drawn(rng)
    width, height = rng.uniform(1.8, 3.0), rng.uniform(2.5, 3.2)
    bay, bays = rng.uniform(2.8, 4.5), int(rng.integers(12, 30))
    length, thin = bay * bays, rng.uniform(0.1, 0.16)
    half, door = width / 2, rng.uniform(0.4, bay - 1.5)
    openings = [(k * bay + door, k * bay + door + 0.95, 0.0, 2.1) for k in range(bays)]
    for y, ends in ((-half, (0.0, length)), (half, (length, 0.0))):
        b.wall((ends[0], y), (ends[1], y), 0, height, thin, M["paint"], openings=openings, reveal=M["wood"])
        # Doors are shut, a hand's breadth behind the wall's face.
        for at, to, low, high in openings:
            x0, x1 = sorted(abs(ends[0] - u) for u in (at, to))
            y0 = y + math.copysign(thin, y)
            b.quad((x0, y0, low), (x1 - x0, 0, 0), (0, 0, high - low), M["wood"])
            b.box((x0 + 0.06, y0 - 0.03, 1.0), (x0 + 0.18, y0 + 0.03, 1.03), M["steel"])
    for x in (0.0, length):
        b.quad((x, -half, 0), (0, width, 0), (0, 0, height), M["paint"])
    b.quad((0, -half, 0), (length, 0, 0), (0, width, 0), M["tiles"])
    b.quad((0, -half, height), (length, 0, 0), (0, width, 0), M["ceiling"])
    for k in range(bays):
        x = (k + 0.5) * bay
        b.box((x - 0.6, -0.1, height - 0.08), (x + 0.6, 0.1, height - 0.005), M["lamp"])
    if rng.random() < 0.5:
        for _ in range(int(rng.integers(2, 5))):
            side = float(rng.choice([-1.0, 1.0]))
            spot = placement(rng.uniform(1, length - 1), side * half, 0, 0.0 if side > 0 else math.pi)
            b.add(parts.cabinet(rng).placed(spot))
    places = np.array([(x, y, 0.0) for x in np.arange(1.0, length - 0.9, 0.5) for y in (-0.3, 0.0, 0.3)])
    people = movers(rng, parts.person, anywhere(places), 0, 3)
    return Scene("corridor", seed, b.mesh(), people, INDOORS, places, 8.0)
