"""A building to survey in many stations: storeys alike in their walls, long corridors, rooms that repeat."""

import math
from itertools import pairwise

import numpy as np

from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder, placement
from trihedral.simulate.scene import Float, Light, Mover, Scene
from trihedral.simulate.scenes.floors import LANDING, RUN, one_room, stair_flights
from trihedral.simulate.scenes.office import Room, cuts_between, furnish, hang_door

Rng = np.random.Generator


def building(seed: int) -> Scene:
    """Make a building.

    The walls, doors and windows of its storeys are copies of each other. On one side of the corridor the rooms are
    equal and furnished alike; on the other they differ in size, and in what stands in them on each storey.
    """
    rng = np.random.default_rng((seed, 0xB111D))
    storeys, height = int(rng.integers(4, 6)), rng.uniform(3.0, 3.6)
    equal, width = int(rng.integers(9, 13)), rng.uniform(3.6, 4.4)
    depth, corridor = rng.uniform(4.5, 6.0), rng.uniform(2.0, 2.6)
    length, well, thin = equal * width, rng.uniform(2.7, 3.2), rng.uniform(0.1, 0.16)
    half, far = corridor / 2, corridor / 2 + depth
    cuts = cuts_between(rng, 0.0, length, 3.2, 7.5)
    door = rng.uniform(0.3, width - 1.3)
    south = [(k * width + door, k * width + door + 0.95, 0.0, 2.1) for k in range(equal)]
    north = []
    for a, c in pairwise(cuts):
        at = rng.uniform(a + 0.3, c - 1.3)
        north.append((at, at + rng.uniform(0.9, 1.05), 0.0, 2.1))
    panes = [(k * width + 0.2 * width, k * width + 0.8 * width, 0.9, height - 0.5) for k in range(equal)]

    shell = MeshBuilder(int(rng.integers(1 << 32)))
    shell.wall((0, -half), (length, -half), 0, height, thin, M["paint"], openings=south, reveal=M["wood"])
    shell.wall((0, half), (length, half), 0, height, thin, M["paint"], openings=north, reveal=M["wood"])
    for y in (-far, far):
        shell.wall((0, y), (length, y), 0, height, 0.3, M["plaster"], openings=panes, back=M["paint"])
        for x0, x1, z0, z1 in panes:
            shell.quad((x0, y, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), M["glass"])
    for k in range(1, equal):
        shell.wall((k * width, -far), (k * width, -half), 0, height, thin, M["paint"])
    for x in cuts[1:-1]:
        shell.wall((x, half), (x, far), 0, height, thin, M["paint"])
    # At both ends the corridor is open to a stairwell.
    opening = (depth, depth + corridor, 0.0, height - 0.25)
    for x in (0.0, length):
        shell.wall((x, -far), (x, far), 0, height, 0.3, M["plaster"], openings=[opening], back=M["paint"])
    shell.quad((0, -far, 0), (length, 0, 0), (0, 2 * far, 0), M["tiles"])
    shell.quad((0, -far, height - 0.2), (length, 0, 0), (0, 2 * far, 0), M["ceiling"])
    for x in np.arange(width / 2, length, width):
        shell.box((x - 0.6, -0.12, height - 0.28), (x + 0.6, 0.12, height - 0.205), M["lamp"])

    walls, like_room = shell.mesh(), one_room(rng, width, depth, height)
    flights = stair_flights(rng, well, height)
    end = LANDING + RUN + LANDING
    b = MeshBuilder(int(rng.integers(1 << 32)))
    stands: list[tuple[float, float, float]] = []
    for k in range(storeys):
        z = k * height
        b.add(walls.placed(placement(0, 0, z), texture=k + 1))
        storey = MeshBuilder(int(rng.integers(1 << 32)))
        for i in range(equal):
            here = placement((i + 1) * width, -half, z, math.pi)
            b.add(like_room.placed(here, texture=1000 * (k + 1) + i))
            hang_door(rng, storey, south[i][0], -half, 0.95, 1)
        for (a, c), (at, to, _, _) in zip(pairwise(cuts), north, strict=True):
            kind = str(rng.choice(["office", "open", "meeting", "storage", "lounge"]))
            furnish(rng, storey, Room(a, half, c, far, kind), height)
            hang_door(rng, storey, at, half, to - at, -1)
        furnish(rng, storey, Room(0.0, -half, length, half, "corridor"), height)
        b.add(storey.mesh().placed(placement(0, 0, z)))
        for x, yaw in ((length, 0.0), (0.0, math.pi)):
            out = 1.0 if yaw == 0.0 else -1.0
            if k < storeys - 1:
                b.add(flights.placed(placement(x, 0, z, yaw), texture=100 * (k + 1) + int(yaw)))
                stands += [(x + out * (LANDING + RUN + 0.55), y, z + height / 2) for y in (-0.6, 0.0, 0.6)]
            stands += [(x + out * 0.6, y, z) for y in (-0.5, 0.0, 0.5)]
        stands += [(x, y, z) for x in np.arange(0.7, length, 0.9) for y in (-0.3, 0.3)]
        for (at, to, _, _), y in [(o, -half) for o in south] + [(o, half) for o in north]:
            stands += [((at + to) / 2, y + step, z) for step in (-0.6, -0.2, 0.2, 0.6)]
        rooms = [(i * width, (i + 1) * width, -far, -half) for i in range(equal)]
        rooms += [(a, c, half, far) for a, c in pairwise(cuts)]
        for x0, x1, y0, y1 in rooms:
            stands += [
                (x, y, z)
                for x in np.arange(x0 + 0.7, x1 - 0.6, 0.8)
                for y in np.arange(y0 + 0.7, y1 - 0.6, 0.8)
            ]
    top = storeys * height
    for x, out in ((length, 1.0), (0.0, -1.0)):
        for y in (-well / 2, well / 2):
            ends = ((x, y), (x + out * end, y))
            b.wall(*ends, 0, top, 0.2, M["plaster"])
        b.wall((x + out * end, -well / 2), (x + out * end, well / 2), 0, top, 0.2, M["plaster"])
        b.quad((min(x, x + out * end), -well / 2, 0), (end, 0, 0), (0, well, 0), M["tiles"])
    b.quad((-end, -far, top), (length + 2 * end, 0, 0), (0, 2 * far, 0), M["concrete"])
    b.quad((-80, -90, -0.3), (length + 160, 0, 0), (0, 180, 0), M["grass"])
    for _ in range(int(rng.integers(4, 9))):
        # Neighbours, seen through the windows.
        side, w, h = float(rng.choice([-1.0, 1.0])), rng.uniform(8, 25), rng.uniform(6, 20)
        block = MeshBuilder(int(rng.integers(1 << 32)))
        block.box((-w / 2, -5, -0.3), (w / 2, 5, h), M[str(rng.choice(["brick", "plaster", "concrete"]))])
        spot = placement(
            rng.uniform(-20, length + 20), side * rng.uniform(far + 15, 60), 0, rng.uniform(-0.4, 0.4)
        )
        b.add(block.mesh().placed(spot))
    places = np.array(stands)

    def somewhere(r: Rng) -> Float:
        x, y, z = places[int(r.integers(len(places)))]
        return placement(x, y, z, r.uniform(0, 2 * math.pi))

    movers = tuple(Mover(parts.person(rng), somewhere) for _ in range(int(rng.integers(4, 12))))
    light = Light((0.62, 0.60, 0.56), 0.05, (0.18, 0.18, 0.18), (0.2, 0.45, 0.87))
    return Scene("building", seed, b.mesh(), movers, light, places, 6.0)
