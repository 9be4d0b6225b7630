"""A hall that is the same when it is turned by half a turn: columns, doors, windows and stages lie in pairs."""

import math

import numpy as np

from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng, placement
from trihedral.simulate.scene import Light, Scene, anywhere, movers


def hall(seed: int) -> Scene:
    """Make a hall symmetric to its middle, in half of the seeds in looks too."""
    rng = np.random.default_rng((seed, 0x4A11))
    length, width, height = rng.uniform(18, 40), rng.uniform(11, 22), rng.uniform(4.5, 9.0)
    one = _half(rng, length, width, height)
    other = None if rng.random() < 0.5 else 1
    b = MeshBuilder.drawn(rng)
    b.add(one)
    b.add(one.placed(placement(0, 0, 0, math.pi), texture=other))
    b.quad((-length / 2 - 30, -width / 2 - 30, -0.1), (length + 60, 0, 0), (0, width + 60, 0), M["asphalt"])
    xs = np.arange(-length / 2 + 1.0, length / 2 - 0.9, 1.2)
    ys = np.arange(-width / 2 + 1.0, width / 2 - 0.9, 1.2)
    places = np.array([(x, y, 0.0) for x in xs for y in ys])
    people = movers(rng, parts.person, anywhere(places), 0, 4)
    light = Light((0.6, 0.6, 0.58), 0.08, (0.2, 0.2, 0.2), (0.0, 0.0, 1.0))
    return Scene("hall", seed, b.mesh(), people, light, places, 9.0)


def _half(rng: Rng, length: float, width: float, height: float) -> Mesh:
    """The half with x > 0, floor and ceiling with it."""
    b = MeshBuilder.drawn(rng)
    x, y = length / 2, width / 2
    skin = M[str(rng.choice(["paint", "plaster", "concrete", "blocks"]))]
    gate = rng.uniform(1.0, width - 4.5)
    b.wall((x, -y), (x, y), 0, height, 0.3, skin, openings=[(gate, gate + 3.0, 0.0, 3.0)])
    b.quad((x + 0.1, -y + gate, 0), (0, 3.0, 0), (0, 0, 3.0), M["painted-metal"])
    step = rng.uniform(2.6, 4.2)
    windows = [(at, at + 1.4, 1.0, min(3.2, height - 0.5)) for at in np.arange(0.8, x - 1.6, step)]
    doors = [(at + 1.6, at + 2.5, 0.0, 2.1) for at in np.arange(0.8, x - 2.6, 2 * step)]
    b.wall((0, -y), (x, -y), 0, height, 0.3, skin, openings=windows)
    b.wall((x, y), (0, y), 0, height, 0.3, skin, openings=doors)
    for at, to, low, high in windows:
        b.quad((at, -y, low), (to - at, 0, 0), (0, 0, high - low), M["glass"])
    for at, to, low, high in doors:
        b.quad((x - to, y + 0.1, low), (to - at, 0, 0), (0, 0, high - low), M["wood"])
    b.quad((0, -y, 0), (x, 0, 0), (0, width, 0), M["wood"])
    b.quad((0, -y, height), (x, 0, 0), (0, width, 0), M["ceiling"])
    row, wide = rng.uniform(0.25, 0.4) * width, rng.uniform(0.15, 0.35)
    for at in np.arange(rng.uniform(1.5, 3.0), x - 1.0, rng.uniform(3.5, 6.0)):
        for side in (-row, row):
            b.box((at - wide, side - wide, 0), (at + wide, side + wide, height), M["concrete"])
    stage = rng.uniform(2.0, 4.0)
    b.box((x - stage - 0.2, -y + 0.5, 0), (x - 0.2, -y + 0.5 + rng.uniform(3, 6), 0.6), M["wood"])
    for _ in range(int(rng.integers(3, 9))):
        spot = placement(rng.uniform(1, x - 1.5), rng.uniform(-y + 1.5, y - 1.5), 0, rng.uniform(0, 6.3))
        b.add(parts.table(rng).placed(spot))
    for at in np.arange(1.5, x - 1, 3.0):
        b.box((at - 0.75, -0.12, height - 0.3), (at + 0.75, 0.12, height - 0.2), M["lamp"])
    return b.mesh()
