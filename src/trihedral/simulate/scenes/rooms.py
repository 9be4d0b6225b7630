"""A row of rooms that are copies of each other, joined by doorways in line."""

import math

import numpy as np

from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng, placement
from trihedral.simulate.scene import INDOORS, Scene, anywhere, movers


def rooms(seed: int) -> Scene:
    """Make a row of rooms alike in shape, in half of the seeds in looks too."""
    rng = np.random.default_rng((seed, 0x8005))
    count, width = int(rng.integers(4, 9)), rng.uniform(3.2, 5.5)
    depth, height = rng.uniform(3.5, 6.5), rng.uniform(2.5, 3.2)
    room = _room(rng, width, depth, height)
    same_looks = rng.random() < 0.5
    b = MeshBuilder.drawn(rng)
    for k in range(count):
        b.add(room.placed(placement(k * width, 0, 0), texture=None if same_looks else k + 1))
    b.wall((0, 0), (0, depth), 0, height, 0.3, M["plaster"], back=M["paint"])
    # The last room ends with a wall as the others do, its doorway shut.
    b.quad((count * width + 0.06, 0, 0), (0, depth, 0), (0, 0, height), M["wood"])
    b.quad((-30, -30, -0.3), (count * width + 60, 0, 0), (0, depth + 60, 0), M["grass"])
    across = [(0.5 + u) * width for u in np.arange(-0.4, 0.51, 0.1)]
    along = [v * depth for v in np.arange(0.1, 0.95, 0.1)]
    places = np.array([(k * width + x, y, 0.0) for k in range(count) for x in across for y in along])
    people = movers(rng, parts.person, anywhere(places), 0, 3)
    return Scene("rooms", seed, b.mesh(), people, INDOORS, places, 5.0)


def _room(rng: Rng, width: float, depth: float, height: float) -> Mesh:
    """One room from x = 0 to its far wall, which has the doorway to the next."""
    b = MeshBuilder.drawn(rng)
    gap = rng.uniform(0.1, 0.4) * depth
    doorway = (gap, gap + rng.uniform(1.2, 2.0), 0.0, 2.1)
    b.wall((width, 0), (width, depth), 0, height, 0.12, M["paint"], openings=[doorway], reveal=M["wood"])
    at = rng.uniform(0.4, width - 2.0)
    window = (at, at + 1.5, 0.9, 2.2)
    b.wall((0, 0), (width, 0), 0, height, 0.3, M["plaster"], openings=[window], back=M["paint"])
    b.quad((at, 0, 0.9), (1.5, 0, 0), (0, 0, 1.3), M["glass"])
    b.wall((width, depth), (0, depth), 0, height, 0.3, M["plaster"], back=M["paint"])
    b.quad((0, 0, 0), (width, 0, 0), (0, depth, 0), M["carpet"])
    b.quad((0, 0, height), (width, 0, 0), (0, depth, 0), M["ceiling"])
    x, y = width / 2, depth / 2
    b.box((x - 0.6, y - 0.1, height - 0.08), (x + 0.6, y + 0.1, height), M["lamp"])
    b.put(parts.desk(rng), rng.uniform(1.0, width - 1.0), depth - 0.9, 0, 0)
    b.put(parts.chair(rng), rng.uniform(0.8, width - 0.8), depth - 1.7, 0, rng.uniform(0, 6))
    shelf = parts.shelf(rng, min(1.4, width - 2.0), rng.uniform(1.2, 2.1))
    b.put(shelf, width - 0.6, 0.2, 0, math.pi)
    return b.mesh()
