"""Small closed places to scan: a room of which there are copies, and a hall that is the same after half a turn."""

import math

import numpy as np

from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, joined, placement

HEIGHT = 2.8


def bent_room(*, closet: bool = False, poster: bool = False, pictures: int | None = None) -> Mesh:
    """A room of 7 x 5 m with an alcove of 2.5 x 3 m, the same in shape each time.

    Parameters
    ----------
    closet
        Whether a closet as high as the room stands in the alcove, out of sight of a part of the room.
    poster
        Whether a poster of 2 x 1.4 m hangs on a wall.
    pictures
        Number of what is on its walls, floor and furniture.
    """
    rng, b = np.random.default_rng(4), MeshBuilder(4)
    corners = [(0, 0), (7, 0), (7, 8), (4.5, 8), (4.5, 5), (0, 5)]
    for (x, y), (u, v) in zip(corners, [*corners[1:], corners[0]], strict=True):
        b.quad((x, y, 0), (u - x, v - y, 0), (0, 0, HEIGHT), M["brick"])
    for z, material in ((0.0, "tiles"), (HEIGHT, "ceiling")):
        b.quad((0, 0, z), (7, 0, 0), (0, 5, 0), M[material])
        b.quad((4.5, 5, z), (2.5, 0, 0), (0, 3, 0), M[material])
    b.add(parts.desk(rng).placed(placement(1.2, 3.9)))
    b.add(parts.desk(rng).placed(placement(5.6, 0.8, yaw=math.pi)))
    b.add(parts.shelf(rng, 1.6, 1.9).placed(placement(2.2, 0.1, yaw=math.pi)))
    b.add(parts.cabinet(rng).placed(placement(6.9, 2.2, yaw=-math.pi / 2)))
    b.add(parts.sofa(rng).placed(placement(0.1, 1.0, yaw=math.pi / 2)))
    if closet:
        b.box((4.5, 6.4, 0), (6.0, 8, HEIGHT), M["wood"])
    if poster:
        b.box((6.998, 2.9, 0.8), (7, 4.9, 2.2), M["sign"])
    return b.mesh().placed(np.eye(4), texture=pictures)


def turned_hall(*, moved: bool) -> Mesh:
    """A hall of 9 x 6 m that is the same in shape after half a turn, but for a crate; its pictures are not.

    Parameters
    ----------
    moved
        Whether the crate stands where half a turn would put it.
    """
    rng, half = np.random.default_rng(5), MeshBuilder(6)
    half.quad((4.5, -3, 0), (0, 6, 0), (0, 0, HEIGHT), M["painted-metal"])
    half.quad((-4.5, 3, 0), (9, 0, 0), (0, 0, HEIGHT), M["painted-metal"])
    half.quad((0, -3, 0), (4.5, 0, 0), (0, 6, 0), M["tiles"])
    half.quad((0, -3, HEIGHT), (4.5, 0, 0), (0, 6, 0), M["ceiling"])
    half.add(parts.desk(rng).placed(placement(1.5, 2.4)))
    half.add(parts.shelf(rng, 1.6, 1.9).placed(placement(4.4, 1.2, yaw=-math.pi / 2)))
    half.add(parts.sofa(rng).placed(placement(-2.5, 2.9)))
    half.box((2.0, -1.4, 0), (2.4, -1.0, HEIGHT), M["concrete"])
    crate = MeshBuilder(7)
    crate.box((-1.6, 0.8, 0), (-1.1, 1.2, 0.9), M["cardboard"])
    turn = placement(0, 0, 0, math.pi)
    placed = crate.mesh().placed(turn) if moved else crate.mesh()
    return joined([half.mesh(), half.mesh().placed(turn, texture=1), placed])
