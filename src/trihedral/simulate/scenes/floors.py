"""Storeys that repeat: the same rooms with the same furniture above and beside each other, and a stairwell."""

import math

import numpy as np

from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng, placement
from trihedral.simulate.scene import INDOORS, Scene, anywhere, movers

# Metres of a stairwell: depth of a landing, length of a flight.
LANDING = 1.2
RUN = 2.6


def floors(seed: int) -> Scene:
    """Make a building of storeys that are copies of each other in shape, and in half of the seeds in looks."""
    rng = np.random.default_rng((seed, 0xF1005))
    storeys, height = int(rng.integers(3, 6)), rng.uniform(2.9, 3.5)
    rooms, width = int(rng.integers(3, 7)), rng.uniform(3.0, 4.6)
    depth, corridor = rng.uniform(4.0, 6.0), rng.uniform(1.7, 2.4)
    same_looks = rng.random() < 0.5
    length = rooms * width
    well = rng.uniform(2.6, 3.2)
    storey = _storey(rng, rooms, width, depth, corridor, height)
    stairs = stair_flights(rng, well, height)
    b = MeshBuilder.drawn(rng)
    stands: list[tuple[float, float, float]] = []
    for k in range(storeys):
        looks = None if same_looks else k + 1
        b.add(storey.placed(placement(0, 0, k * height), texture=looks))
        if k < storeys - 1:
            b.add(stairs.placed(placement(length, 0, k * height), texture=looks))
            stands += [(length + LANDING + RUN + 0.55, y, (k + 0.5) * height) for y in (-0.6, 0.0, 0.6)]
        stands += [(x, 0.0, k * height) for x in np.arange(0.8, length + 1.0, 0.7)]
        for i in range(rooms):
            for side in (-1, 1):
                across = [side * (corridor / 2 + v * depth) for v in (0.15, 0.3, 0.5, 0.7)]
                stands += [((i + u) * width, y, k * height) for u in (0.3, 0.5, 0.7) for y in across]
    top = storeys * height
    end, half = length + LANDING + RUN + LANDING, well / 2
    # The stairwell's own walls run through all storeys.
    for y in (-half, half):
        b.wall((length, y), (end, y), 0, top, 0.2, M["plaster"])
    b.wall((end, -half), (end, half), 0, top, 0.2, M["plaster"])
    low, high = -corridor / 2 - depth, corridor / 2 + depth
    b.quad((0, low, top), (end, 0, 0), (0, high - low, 0), M["concrete"])
    b.quad((length, -half, 0), (end - length, 0, 0), (0, well, 0), M["tiles"])
    b.quad((-60, -60, -0.3), (150, 0, 0), (0, 120, 0), M["grass"])
    places = np.array(stands)
    people = movers(rng, parts.person, anywhere(places), 1, 5)
    return Scene("floors", seed, b.mesh(), people, INDOORS, places, 6.0)


def _storey(rng: Rng, rooms: int, width: float, depth: float, corridor: float, height: float) -> Mesh:
    b = MeshBuilder.drawn(rng)
    length, thin = rooms * width, rng.uniform(0.1, 0.16)
    room = one_room(rng, width, depth, height)
    door = rng.uniform(0.25, width - 1.3)
    leaf = MeshBuilder.drawn(rng)
    leaf.box((0.01, -0.02, 0.01), (0.93, 0.02, 2.08), M["wood"])
    swing = rng.uniform(1.2, 1.9)
    window = (width * 0.2, width * 0.8, 0.9, height - 0.5)
    for side in (-1, 1):
        inner, outer = side * corridor / 2, side * (corridor / 2 + depth)
        doors = [(i * width + door, i * width + door + 0.95, 0.0, 2.1) for i in range(rooms)]
        panes = [(i * width + window[0], i * width + window[1], *window[2:]) for i in range(rooms)]
        b.wall((0, inner), (length, inner), 0, height, thin, M["paint"], openings=doors, reveal=M["wood"])
        b.wall((0, outer), (length, outer), 0, height, 0.3, M["plaster"], openings=panes, back=M["paint"])
        for i in range(rooms):
            x0, x1, z0, z1 = panes[i]
            b.quad((x0, outer, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), M["glass"])
            b.put(leaf.mesh(), doors[i][0], inner, 0, side * swing)
            # A room is the same in every place; on the other side of the corridor it is turned about.
            x, yaw = (i * width, 0.0) if side == 1 else ((i + 1) * width, math.pi)
            b.put(room, x, inner, 0, yaw)
        for i in range(1, rooms):
            b.wall((i * width, inner), (i * width, outer), 0, height, thin, M["paint"])
    low, high = -corridor / 2 - depth, corridor / 2 + depth
    b.wall((0, low), (0, high), 0, height, 0.3, M["plaster"], back=M["paint"])
    # The corridor is open to the stairwell.
    opening = (depth, depth + corridor, 0.0, height - 0.25)
    b.wall((length, low), (length, high), 0, height, 0.3, M["plaster"], openings=[opening], back=M["paint"])
    b.quad((0, low, 0), (length, 0, 0), (0, high - low, 0), M["tiles"])
    b.quad((0, low, height - 0.2), (length, 0, 0), (0, high - low, 0), M["ceiling"])
    for x in np.arange(width / 2, length, width):
        b.box((x - 0.6, -0.12, height - 0.28), (x + 0.6, 0.12, height - 0.205), M["lamp"])
        b.box((x - 0.3, corridor / 2 - 0.1, 1.2), (x + 0.3, corridor / 2 - 0.08, 1.8), M["sign"])
    return b.mesh()


def one_room(rng: Rng, width: float, depth: float, height: float) -> Mesh:
    """Furniture of one room, its door side along y = 0."""
    b = MeshBuilder.drawn(rng)
    for _ in range(int(rng.integers(1, 3))):
        x, y = rng.uniform(0.9, width - 0.9), rng.uniform(depth * 0.45, depth - 0.8)
        b.put(parts.desk(rng), x, y, 0, float(rng.integers(0, 4)) * math.pi / 2)
        b.put(parts.chair(rng), x, y - 0.8, 0, rng.uniform(0, 6))
    shelf = parts.shelf(rng, min(1.6, width - 1.2), rng.uniform(1.2, 2.1))
    b.put(shelf, 0.5, depth - 0.2, 0)
    b.put(parts.cabinet(rng), 0.12, depth * 0.3, 0, math.pi / 2)
    x, y = width / 2, depth / 2
    b.box((x - 0.6, y - 0.1, height - 0.28), (x + 0.6, y + 0.1, height - 0.205), M["lamp"])
    b.box((width - 0.1, depth * 0.4, 1.1), (width - 0.08, depth * 0.4 + 1.0, 1.9), M["sign"])
    return b.mesh()


def stair_flights(rng: Rng, well: float, height: float) -> Mesh:
    """Two flights and a landing half way, from x = 0 where the corridor ends; the next storey's landing on top."""
    b = MeshBuilder.drawn(rng)
    half, run, first = well / 2, RUN, LANDING
    steps = max(7, round(height / 2 / 0.175))
    rise, tread = height / 2 / steps, run / steps
    for k in range(steps):
        x, z = first + k * tread, k * rise
        b.box((x, -half + 0.1, z - 0.04), (x + tread, -0.1, z + rise), M["concrete"])
        x, z = first + run - (k + 1) * tread, height / 2 + k * rise
        b.box((x, 0.1, z - 0.04), (x + tread, half - 0.1, z + rise), M["concrete"])
    z = height / 2
    b.box((first + run, -half + 0.1, z - 0.18), (first + run + 1.1, half - 0.1, z), M["tiles"])
    b.box((0.15, -half + 0.1, height - 0.18), (first, half - 0.1, height), M["tiles"])
    for y, x0, x1, z0, z1 in ((-0.1, first, first + run, 0.0, z), (0.1, first + run, first, z, height)):
        b.tube([(x0, y, z0 + 0.95), (x1, y, z1 + 0.95)], 0.022, M["steel"], sides=8)
        for t in (0.05, 0.35, 0.65, 0.95):
            x, foot = x0 + t * (x1 - x0), z0 + t * (z1 - z0)
            b.tube([(x, y, foot), (x, y, foot + 0.95)], 0.014, M["steel"], sides=6)
    return b.mesh()
