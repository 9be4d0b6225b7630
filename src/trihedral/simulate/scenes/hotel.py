"""Rooms along a corridor that are copies of each other but for the small: posters, the sign at the door, a chair."""

import math

import numpy as np

from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng, placement
from trihedral.simulate.scene import INDOORS, Scene, anywhere, movers

# Metres: width of a door; thickness of posters, of the walls between rooms, half that of walls to the corridor.
_DOOR, _THIN, _WALL, _HALF = 0.95, 0.02, 0.06, 0.07
# Metres by which furniture is off in a room, at the most, in half of the seeds.
_ASIDE = 0.15


def hotel(seed: int) -> Scene:
    """Make rooms with open doors on both sides of a corridor; in half of the seeds furniture is a little off."""
    rng = np.random.default_rng((seed, 0x407E1))
    count, width = int(rng.integers(4, 8)), rng.uniform(3.2, 4.4)
    depth, height = rng.uniform(4.2, 6.5), rng.uniform(2.5, 2.9)
    length, half = count * width, rng.uniform(0.8, 1.1)
    door = rng.uniform(0.3, width - 1.6)
    shell, furniture = _shell(rng, width, depth, height, door), _furniture(rng, width, depth)
    posters = [_poster(rng, width, depth) for _ in range(int(rng.integers(1, 4)))]
    aside = float(rng.choice([0.0, _ASIDE]))
    b = MeshBuilder.drawn(rng)
    stands = [(x, 0.0, 0.0) for x in np.arange(0.8, length - 0.7, 0.8)]
    for i in range(count):
        for side in (-1, 1):
            # A room is the same in every place; on the other side of the corridor it is turned about.
            x, yaw = (i * width, 0.0) if side == 1 else ((i + 1) * width, math.pi)
            room = placement(x, side * (half + _HALF), 0, yaw)
            b.add(shell.placed(room))
            for piece in furniture:
                dx, dy, turn = rng.uniform(-aside, aside, 3)
                b.add(piece.placed(room @ placement(dx, dy, 0, turn)))
            own = MeshBuilder.drawn(rng)
            for low, high in posters:
                own.box(low, high, M["sign"])
            own.box((door - 0.25, -_HALF - _THIN, 1.4), (door - 0.05, -_HALF, 1.6), M["sign"])
            b.add(own.mesh().placed(room))
            stands += [
                ((i + u) * width, side * (half + v * depth), 0.0)
                for u in (0.35, 0.5, 0.65)
                for v in (0.3, 0.5, 0.7)
            ]
        b.box(
            ((i + 0.5) * width - 0.15, -0.15, height - 0.06),
            ((i + 0.5) * width + 0.15, 0.15, height),
            M["lamp"],
        )
    for x in (0.0, length):
        b.quad((x, -half, 0), (0, 2 * half, 0), (0, 0, height), M["paint"])
    b.quad((0, -half, 0), (length, 0, 0), (0, 2 * half, 0), M["carpet"])
    b.quad((0, -half, height), (length, 0, 0), (0, 2 * half, 0), M["ceiling"])
    b.quad((-60, -60, -0.3), (length + 120, 0, 0), (0, 120, 0), M["grass"])
    places = np.array(stands)
    people = movers(rng, parts.person, anywhere(places), 0, 3)
    return Scene("hotel", seed, b.mesh(), people, INDOORS, places, 5.0)


def _shell(rng: Rng, width: float, depth: float, height: float, door: float) -> Mesh:
    """One room: the wall to the corridor along y = 0 with its door, the window at the other end."""
    b = MeshBuilder.drawn(rng)
    opening = (door, door + _DOOR, 0.0, 2.1)
    b.wall((0, 0), (width, 0), 0, height, 2 * _HALF, M["paint"], openings=[opening], reveal=M["wood"])
    leaf = MeshBuilder.drawn(rng)
    leaf.box((0.01, -0.02, 0.01), (_DOOR - 0.02, 0.02, 2.08), M["wood"])
    b.put(leaf.mesh(), door, 0.0, 0, rng.uniform(1.2, 1.9))
    at = rng.uniform(0.4, width - 1.9)
    pane = (at, at + 1.5, 0.9, 2.2)
    b.wall((0, depth), (width, depth), 0, height, 0.2, M["paint"], openings=[pane], back=M["plaster"])
    b.quad((at, depth, 0.9), (1.5, 0, 0), (0, 0, 1.3), M["glass"])
    for x in (_WALL / 2, width - _WALL / 2):
        b.wall((x, _HALF), (x, depth), 0, height, _WALL, M["paint"])
    b.quad((0, -_HALF, 0), (width, 0, 0), (0, depth + _HALF, 0), M["carpet"])
    b.quad((0, 0, height), (width, 0, 0), (0, depth, 0), M["ceiling"])
    x, y = width / 2, depth / 2
    b.box((x - 0.2, y - 0.2, height - 0.08), (x + 0.2, y + 0.2, height), M["lamp"])
    return b.mesh()


def _furniture(rng: Rng, width: float, depth: float) -> list[Mesh]:
    """What stands in every room, each where it stands."""
    x, y = rng.uniform(1.1, width - 1.1), depth - 0.65
    shelf = parts.shelf(rng, min(1.2, depth - 3.0), rng.uniform(1.2, 2.1))
    return [
        parts.desk(rng).placed(placement(x, y, 0, 0)),
        parts.chair(rng).placed(placement(x, y - 0.8, 0, rng.uniform(0, 6))),
        shelf.placed(placement(0.1, depth * 0.3, 0, math.pi / 2)),
        parts.sofa(rng).placed(placement(width - 0.2, depth * 0.75, 0, -math.pi / 2)),
    ]


def _poster(
    rng: Rng, width: float, depth: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Lowest and highest corner of a poster on the wall at x = `width`."""
    face, y, z = width - _WALL, rng.uniform(0.3 * depth, depth - 1.2), rng.uniform(1.1, 1.5)
    return (face - _THIN, y, z), (face, y + rng.uniform(0.3, 0.9), z + rng.uniform(0.4, 0.8))
