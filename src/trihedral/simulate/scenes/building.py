"""A building to survey in many stations: storeys alike in their walls, long corridors, rooms that repeat."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng, placement
from trihedral.simulate.scene import INDOORS, Scene, anywhere, movers
from trihedral.simulate.scenes.floors import LANDING, RUN, one_room, stair_flights
from trihedral.simulate.scenes.office import Room, cuts_between, furnish, hang_door
from trihedral.simulate.wall import Opening

END = LANDING + RUN + LANDING  # depth of a stairwell


def building(seed: int) -> Scene:
    """Make a building.

    The walls, doors and windows of its storeys are copies of each other. On one side of the corridor the rooms are
    equal and furnished alike; on the other they differ in size, and in what stands in them on each storey.
    """
    rng = np.random.default_rng((seed, 0xB111D))
    plan = _Plan.drawn(rng)
    walls, like_room = _walls(rng, plan), one_room(rng, plan.width, plan.depth, plan.height)
    flights = stair_flights(rng, plan.well, plan.height)
    b = MeshBuilder.drawn(rng)
    for k in range(plan.storeys):
        b.add(walls.placed(placement(0, 0, k * plan.height), texture=k + 1))
        for i in range(plan.equal):
            here = placement((i + 1) * plan.width, -plan.half, k * plan.height, math.pi)
            b.add(like_room.placed(here, texture=1000 * (k + 1) + i))
        b.put(_storey(rng, plan), 0, 0, k * plan.height)
        for x, yaw in ((plan.length, 0.0), (0.0, math.pi)):
            if k < plan.storeys - 1:
                stairs = placement(x, 0, k * plan.height, yaw)
                b.add(flights.placed(stairs, texture=100 * (k + 1) + int(yaw)))
    _stairwells(b, plan)
    _surroundings(rng, b, plan)
    places = np.array([place for k in range(plan.storeys) for place in _stands(plan, k)])
    people = movers(rng, parts.person, anywhere(places), 4, 12)
    return Scene("building", seed, b.mesh(), people, INDOORS, places, 6.0)


@dataclass(frozen=True)
class _Plan:
    """Sizes, metres; the corridor runs along x from 0, equal rooms lie south of it, others north."""

    storeys: int
    height: float
    #: How many equal rooms there are, and how wide each is.
    equal: int
    width: float
    #: Of all rooms.
    depth: float
    corridor: float
    #: Width of a stairwell.
    well: float
    #: Thickness of inner walls.
    thin: float
    cuts: list[float]
    south: list[Opening]
    north: list[Opening]

    @staticmethod
    def drawn(rng: Rng) -> "_Plan":
        storeys, height = int(rng.integers(4, 6)), rng.uniform(3.0, 3.6)
        equal, width = int(rng.integers(9, 13)), rng.uniform(3.6, 4.4)
        depth, corridor = rng.uniform(4.5, 6.0), rng.uniform(2.0, 2.6)
        well, thin = rng.uniform(2.7, 3.2), rng.uniform(0.1, 0.16)
        cuts = cuts_between(rng, 0.0, equal * width, 3.2, 7.5)
        door = rng.uniform(0.3, width - 1.3)
        south = [(k * width + door, k * width + door + 0.95, 0.0, 2.1) for k in range(equal)]
        north = []
        for a, c in pairwise(cuts):
            at = rng.uniform(a + 0.3, c - 1.3)
            north.append((at, at + rng.uniform(0.9, 1.05), 0.0, 2.1))
        return _Plan(storeys, height, equal, width, depth, corridor, well, thin, cuts, south, north)

    @property
    def length(self) -> float:
        return self.equal * self.width

    @property
    def half(self) -> float:
        return self.corridor / 2

    @property
    def far(self) -> float:
        """From the corridor's middle to the outer walls."""
        return self.corridor / 2 + self.depth


def _walls(rng: Rng, plan: _Plan) -> Mesh:
    """Walls, windows, floor and ceiling of one storey."""
    b = MeshBuilder.drawn(rng)
    length, height, half, far, thin = plan.length, plan.height, plan.half, plan.far, plan.thin
    for y, doors in ((-half, plan.south), (half, plan.north)):
        b.wall((0, y), (length, y), 0, height, thin, M["paint"], openings=doors, reveal=M["wood"])
    at, width = [k * plan.width for k in range(plan.equal)], plan.width
    panes = [(x + 0.2 * width, x + 0.8 * width, 0.9, height - 0.5) for x in at]
    for y in (-far, far):
        b.wall((0, y), (length, y), 0, height, 0.3, M["plaster"], openings=panes, back=M["paint"])
        for x0, x1, z0, z1 in panes:
            b.quad((x0, y, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), M["glass"])
    for x in at[1:]:
        b.wall((x, -far), (x, -half), 0, height, thin, M["paint"])
    for x in plan.cuts[1:-1]:
        b.wall((x, half), (x, far), 0, height, thin, M["paint"])
    # At both ends the corridor is open to a stairwell.
    opening = (plan.depth, plan.depth + plan.corridor, 0.0, height - 0.25)
    for x in (0.0, length):
        b.wall((x, -far), (x, far), 0, height, 0.3, M["plaster"], openings=[opening], back=M["paint"])
    b.quad((0, -far, 0), (length, 0, 0), (0, 2 * far, 0), M["tiles"])
    b.quad((0, -far, height - 0.2), (length, 0, 0), (0, 2 * far, 0), M["ceiling"])
    for x in np.arange(plan.width / 2, length, plan.width):
        b.box((x - 0.6, -0.12, height - 0.28), (x + 0.6, 0.12, height - 0.205), M["lamp"])
    return b.mesh()


def _storey(rng: Rng, plan: _Plan) -> Mesh:
    """What differs from storey to storey: door leaves, and furniture of the northern rooms and the corridor."""
    b = MeshBuilder.drawn(rng)
    for at, _, _, _ in plan.south:
        hang_door(rng, b, at, -plan.half, 0.95, 1)
    for (a, c), (at, to, _, _) in zip(pairwise(plan.cuts), plan.north, strict=True):
        kind = str(rng.choice(["office", "open", "meeting", "storage", "lounge"]))
        furnish(rng, b, Room(a, plan.half, c, plan.far, kind), plan.height)
        hang_door(rng, b, at, plan.half, to - at, -1)
    furnish(rng, b, Room(0.0, -plan.half, plan.length, plan.half, "corridor"), plan.height)
    return b.mesh()


def _stands(plan: _Plan, storey: int) -> list[tuple[float, float, float]]:
    """Places on a storey: stairs, corridor, doors, rooms."""
    z, half, far, width = storey * plan.height, plan.half, plan.far, plan.width
    stands = []
    for x, out in ((plan.length, 1.0), (0.0, -1.0)):
        if storey < plan.storeys - 1:
            landing = x + out * (LANDING + RUN + 0.55)
            stands += [(landing, y, z + plan.height / 2) for y in (-0.6, 0.0, 0.6)]
        stands += [(x + out * 0.6, y, z) for y in (-0.5, 0.0, 0.5)]
    stands += [(x, y, z) for x in np.arange(0.7, plan.length, 0.9) for y in (-0.3, 0.3)]
    for (at, to, _, _), y in [(o, -half) for o in plan.south] + [(o, half) for o in plan.north]:
        stands += [((at + to) / 2, y + step, z) for step in (-0.6, -0.2, 0.2, 0.6)]
    rooms = [(i * width, (i + 1) * width, -far, -half) for i in range(plan.equal)]
    for x0, x1, y0, y1 in [*rooms, *((a, c, half, far) for a, c in pairwise(plan.cuts))]:
        xs, ys = np.arange(x0 + 0.7, x1 - 0.6, 0.8), np.arange(y0 + 0.7, y1 - 0.6, 0.8)
        stands += [(x, y, z) for x in xs for y in ys]
    return stands


def _stairwells(b: MeshBuilder, plan: _Plan) -> None:
    """Walls and floors of the stairwells, through all storeys, and the roof."""
    top, well, far = plan.storeys * plan.height, plan.well, plan.far
    for x, out in ((plan.length, 1.0), (0.0, -1.0)):
        end = x + out * END
        for y in (-well / 2, well / 2):
            b.wall((x, y), (end, y), 0, top, 0.2, M["plaster"])
        b.wall((end, -well / 2), (end, well / 2), 0, top, 0.2, M["plaster"])
        b.quad((min(x, end), -well / 2, 0), (END, 0, 0), (0, well, 0), M["tiles"])
    b.quad((-END, -far, top), (plan.length + 2 * END, 0, 0), (0, 2 * far, 0), M["concrete"])


def _surroundings(rng: Rng, b: MeshBuilder, plan: _Plan) -> None:
    """Ground and neighbours, seen through the windows."""
    b.quad((-80, -90, -0.3), (plan.length + 160, 0, 0), (0, 180, 0), M["grass"])
    for _ in range(int(rng.integers(4, 9))):
        side, w, h = float(rng.choice([-1.0, 1.0])), rng.uniform(8, 25), rng.uniform(6, 20)
        block = MeshBuilder.drawn(rng)
        block.box((-w / 2, -5, -0.3), (w / 2, 5, h), M[str(rng.choice(["brick", "plaster", "concrete"]))])
        x, y = rng.uniform(-20, plan.length + 20), side * rng.uniform(plan.far + 15, 60)
        b.put(block.mesh(), x, y, 0, rng.uniform(-0.4, 0.4))
