"""An office floor: rooms along a corridor, thin walls with two faces, doors open and shut, furniture."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.simulate import parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng, placement
from trihedral.simulate.scene import INDOORS, Scene, anywhere, movers
from trihedral.simulate.wall import Opening


@dataclass(frozen=True)
class Room:
    """A rectangle of the plan, between wall axes."""

    x0: float
    y0: float
    x1: float
    y1: float
    kind: str

    @property
    def size(self) -> tuple[float, float]:
        """Width and depth."""
        return self.x1 - self.x0, self.y1 - self.y0

    def at_wall(self, wall: int, along: float, off: float, z: float = 0.0) -> Float64:
        """Give the placement of a thing whose back is towards a wall: far, near, left, right."""
        return (
            placement(self.x0 + along, self.y1 - off, z, 0.0),
            placement(self.x1 - along, self.y0 + off, z, math.pi),
            placement(self.x0 + off, self.y0 + along, z, math.pi / 2),
            placement(self.x1 - off, self.y1 - along, z, -math.pi / 2),
        )[wall]


def office(seed: int) -> Scene:
    """Make an office floor."""
    rng = np.random.default_rng((seed, 0x0FF1CE))
    b = MeshBuilder.drawn(rng)
    plan = _OfficePlan.drawn(rng)
    rooms = [Room(plan.x0, plan.inner(1), plan.x1, plan.inner(-1), "corridor")]
    doors: list[tuple[float, float]] = []
    for side in (1, -1):
        cuts = cuts_between(rng, plan.x0, plan.x1, 2.8, 8.0)
        rooms += _rooms(rng, b, plan, cuts, side)
        doors += _corridor_wall(rng, b, plan, cuts, side)
        _outer_wall(rng, b, plan, side)
    _ends(rng, b, plan)
    _surroundings(rng, b)
    _ceiling(rng, b, rooms, plan.height)
    for room in rooms:
        furnish(rng, b, room, plan.height)
    stands = [(x, y + step, 0.0) for x, y in doors for step in (-0.7, -0.35, 0.0, 0.35, 0.7)]
    for room in rooms:
        xs, ys = np.arange(room.x0 + 0.6, room.x1 - 0.5, 0.5), np.arange(room.y0 + 0.6, room.y1 - 0.5, 0.5)
        stands += [(x, y, 0.0) for x in xs for y in ys]
    places = np.array(stands)
    moving = movers(rng, parts.person, anywhere(places), 1, 5)
    moving += movers(rng, parts.chair, anywhere(places), 1, 4)
    return Scene("office", seed, b.mesh(), moving, INDOORS, places, 6.0)


@dataclass(frozen=True)
class _OfficePlan:
    """Sizes, metres, and materials; the corridor runs along x, rooms lie on its sides: 1 south of it, -1 north."""

    length: float
    height: float
    corridor: float
    south: float
    north: float
    thin: float
    thick: float
    paint: int
    floor: int

    @staticmethod
    def drawn(rng: Rng) -> "_OfficePlan":
        length, height = rng.uniform(18, 38), rng.uniform(2.5, 3.3)
        corridor, south, north = rng.uniform(1.6, 2.6), rng.uniform(4.0, 7.5), rng.uniform(4.0, 7.5)
        thin, thick = rng.uniform(0.09, 0.16), rng.uniform(0.25, 0.4)
        paint = M[str(rng.choice(["paint", "paint", "paint-dark", "blocks"]))]
        floor = M[str(rng.choice(["carpet", "tiles", "wood"]))]
        return _OfficePlan(length, height, corridor, south, north, thin, thick, paint, floor)

    @property
    def x0(self) -> float:
        return -self.length / 2

    @property
    def x1(self) -> float:
        return self.length / 2

    def inner(self, side: int) -> float:
        """Where the corridor's wall stands, y."""
        return -side * self.corridor / 2

    def outer(self, side: int) -> float:
        """Where the outer wall stands, y."""
        return self.inner(1) - self.south if side == 1 else self.inner(-1) + self.north


def _rooms(rng: Rng, b: MeshBuilder, plan: _OfficePlan, cuts: list[float], side: int) -> list[Room]:
    """Rooms on one side, and the walls between them."""
    y0, y1 = sorted((plan.inner(side), plan.outer(side)))
    rooms = []
    for a, c in pairwise(cuts):
        small = ["office", "office", "meeting", "storage", "lounge"]
        large = ["office", "open", "meeting", "lounge"]
        rooms.append(Room(a, y0, c, y1, str(rng.choice(small if c - a < 5.5 else large))))
    for x in cuts[1:-1]:
        b.wall((x, y0), (x, y1), 0, plan.height, plan.thin, plan.paint, back=M["paint"])
    return rooms


def _corridor_wall(
    rng: Rng, b: MeshBuilder, plan: _OfficePlan, cuts: list[float], side: int
) -> list[tuple[float, float]]:
    """Wall with doors and some glazing; returns the places of the doors."""
    x0, y = plan.x0, plan.inner(side)
    openings: list[Opening] = []
    glazed: list[Opening] = []
    for a, c in pairwise(cuts):
        width = rng.uniform(0.85, 1.1)
        at = rng.uniform(a + 0.25, c - 0.25 - width) - x0
        openings.append((at, at + width, 0.0, 2.1))
        if c - a > 5.0:
            free = c - x0 - 0.2 - at - width
            if free > 2.0 and rng.random() < 0.5:
                glazed.append((at + width + 0.3, at + width + 0.3 + min(free - 0.6, 3.0), 0.2, 2.1))
    pierced, wood = sorted(openings + glazed), M["wood"]
    b.wall((x0, y), (plan.x1, y), 0, plan.height, plan.thin, plan.paint, openings=pierced, reveal=wood)
    for at, end, low, high in glazed:
        b.quad((x0 + at, y, low), (end - at, 0, 0), (0, 0, high - low), M["glass"])
    for at, end, _, _ in openings:
        hang_door(rng, b, x0 + at, y, end - at, side)
    return [(x0 + (at + end) / 2, y) for at, end, _, _ in openings]


def _outer_wall(rng: Rng, b: MeshBuilder, plan: _OfficePlan, side: int) -> None:
    x0, y, windows = plan.x0, plan.outer(side), _windows(rng, plan.length, plan.height)
    skin, paint = M["plaster"], M["paint"]
    b.wall((x0, y), (plan.x1, y), 0, plan.height, plan.thick, skin, openings=windows, back=paint)
    for at, end, low, high in windows:
        _window(b, x0 + at, y, end - at, low, high)


def _ends(rng: Rng, b: MeshBuilder, plan: _OfficePlan) -> None:
    """Walls at the corridor's ends, some with a window, floor and ceiling."""
    y0, y1, height, middle = plan.outer(1), plan.outer(-1), plan.height, plan.south + plan.corridor / 2
    for x in (plan.x0, plan.x1):
        windows = [(middle - 0.5, middle + 0.5, 0.3, 2.2)] if rng.random() < 0.7 else []
        b.wall((x, y0), (x, y1), 0, height, plan.thick, M["plaster"], openings=windows, back=M["paint"])
        for at, end, low, high in windows:
            b.quad((x, y0 + at, low), (0, end - at, 0), (0, 0, high - low), M["glass"])
    for z, material in ((0.0, plan.floor), (height, M["ceiling"])):
        b.quad((plan.x0, y0, z), (plan.length, 0, 0), (0, y1 - y0, 0), material)


def _surroundings(rng: Rng, b: MeshBuilder) -> None:
    """Ground and houses outside, seen through windows."""
    b.quad((-70, -70, -3.2), (140, 0, 0), (0, 140, 0), M["grass"])
    for _ in range(int(rng.integers(2, 6))):
        a, far = rng.uniform(0, 2 * math.pi), rng.uniform(25, 55)
        w, h = rng.uniform(8, 20), rng.uniform(5, 16)
        s = MeshBuilder.drawn(rng)
        s.box((-w / 2, -5, -3.2), (w / 2, 5, h - 3.2), M[str(rng.choice(["brick", "plaster", "concrete"]))])
        b.put(s.mesh(), far * math.cos(a), far * math.sin(a), 0, rng.uniform(0, 6))


def cuts_between(rng: Rng, low: float, high: float, least: float, most: float) -> list[float]:
    """Split a length into pieces of unequal size."""
    cuts = [low]
    while high - cuts[-1] > most:
        cuts.append(cuts[-1] + rng.uniform(least, min(most, high - cuts[-1] - least)))
    return [*cuts, high]


def hang_door(rng: Rng, b: MeshBuilder, x: float, y: float, width: float, side: int) -> None:
    """Hang a door leaf: shut, ajar or wide open into the room hung left or right."""
    state = rng.random()
    angle = 0.0 if state < 0.15 else rng.uniform(0.5, 2.7) if state < 0.9 else rng.uniform(0.05, 0.3)
    leaf = MeshBuilder.drawn(rng)
    skin = M[str(rng.choice(["wood", "paint", "paint-dark"]))]
    leaf.box((0.01, -0.02, 0.01), (width - 0.01, 0.02, 2.08), skin)
    for y_side in (-0.06, 0.02):
        leaf.box((width - 0.14, y_side, 1.0), (width - 0.04, y_side + 0.04, 1.03), M["steel"])
    turn = -side * angle
    hinge, yaw = (x, turn) if rng.random() < 0.5 else (x + width, math.pi - turn)
    b.put(leaf.mesh(), hinge, y, 0, yaw)


def _windows(rng: Rng, length: float, height: float) -> list[Opening]:
    windows: list[Opening] = []
    at = rng.uniform(0.4, 1.5)
    low, high = rng.uniform(0.6, 1.0), rng.uniform(2.0, height - 0.3)
    while True:
        width = rng.uniform(0.9, 2.6)
        if at + width > length - 0.4:
            return windows
        windows.append((at, at + width, low, high))
        at += width + rng.uniform(0.35, 1.8)


def _window(b: MeshBuilder, x: float, y: float, width: float, low: float, high: float) -> None:
    bar = 0.06
    b.quad((x, y, low), (width, 0, 0), (0, 0, high - low), M["glass"])
    for z in (low, high - bar):
        b.box((x, y - 0.03, z), (x + width, y + 0.03, z + bar), M["white-plastic"])
    for at in (x, x + width / 2 - bar / 2, x + width - bar):
        b.box((at, y - 0.03, low + bar), (at + bar, y + 0.03, high - bar), M["white-plastic"])


def _ceiling(rng: Rng, b: MeshBuilder, rooms: list[Room], height: float) -> None:
    for room in rooms:
        w, d = room.size
        nx, ny = max(1, round(w / rng.uniform(1.8, 3.2))), max(1, round(d / rng.uniform(1.8, 3.2)))
        for i in range(nx):
            for j in range(ny):
                if rng.random() < 0.85:
                    x, y = room.x0 + (i + 0.5) * w / nx, room.y0 + (j + 0.5) * d / ny
                    b.box((x - 0.6, y - 0.1, height - 0.08), (x + 0.6, y + 0.1, height - 0.005), M["lamp"])
        if room.kind in ("open", "storage") or (room.kind == "corridor" and rng.random() < 0.7):
            y, r = room.y0 + rng.uniform(0.35, 0.6), rng.uniform(0.08, 0.2)
            duct = [(x, y, height - r - 0.1) for x in (room.x0 + 0.1, room.x1 - 0.1)]
            b.tube(duct, r, M["steel"], sides=20)
        if w > 4.5 and rng.random() < 0.6:
            x, drop = room.x0 + w * rng.uniform(0.3, 0.7), rng.uniform(0.15, 0.35)
            b.box((x - 0.12, room.y0 + 0.09, height - drop), (x + 0.12, room.y1 - 0.09, height), M["paint"])


def furnish(rng: Rng, b: MeshBuilder, room: Room, height: float) -> None:
    """Fill a room: things along the walls, things in the middle, pictures on the walls."""
    w, d = room.size

    def against_wall(mesh: Mesh, wall: int, along: float) -> None:
        b.add(mesh.placed(room.at_wall(wall, along, 0.22)))

    def free(mesh: Mesh, yaw: float | None = None) -> None:
        x, y = rng.uniform(room.x0 + 0.9, room.x1 - 0.9), rng.uniform(room.y0 + 0.9, room.y1 - 0.9)
        b.put(mesh, x, y, 0, rng.uniform(0, 2 * math.pi) if yaw is None else yaw)

    if room.kind == "corridor":
        for _ in range(int(rng.integers(4, 12))):
            _picture(rng, b, room, sides=(0, 1))
        for _ in range(int(rng.integers(1, 5))):
            against_wall(parts.cabinet(rng), int(rng.integers(0, 2)), rng.uniform(0.5, w - 2))
        return
    for _ in range(int(rng.integers(2, 6))):
        _picture(rng, b, room, sides=(0, 1, 2, 3))
    if room.kind in ("office", "open"):
        for _ in range(max(1, int(w * d / rng.uniform(7, 13)))):
            yaw = float(rng.integers(0, 4)) * math.pi / 2 + rng.normal(0, 0.05)
            free(parts.desk(rng), yaw)
            free(parts.chair(rng))
    if room.kind == "meeting":
        free(parts.table(rng))
        for _ in range(int(rng.integers(4, 9))):
            free(parts.chair(rng))
    if room.kind == "lounge":
        against_wall(parts.sofa(rng), int(rng.integers(0, 4)), rng.uniform(0.3, max(0.4, min(w, d) - 2.6)))
        free(parts.table(rng))
        for _ in range(int(rng.integers(2, 5))):
            free(parts.potted_plant(rng))
    for _ in range(int(rng.integers(1, 4)) + (4 if room.kind == "storage" else 0)):
        wall = int(rng.integers(0, 4))
        span = (w if wall < 2 else d) - 0.6
        size = min(rng.uniform(0.8, 2.4), span - 0.3)
        shelf = parts.shelf(rng, size, rng.uniform(1.0, min(2.2, height - 0.3)))
        against_wall(shelf, wall, rng.uniform(0.3, max(0.31, span - size)))
    if rng.random() < 0.5:
        free(parts.potted_plant(rng))


def _picture(rng: Rng, b: MeshBuilder, room: Room, sides: tuple[int, ...]) -> None:
    """Put a poster, board or sign a finger's breadth before a wall."""
    w, d = room.size
    pw, ph = rng.uniform(0.3, 1.6), rng.uniform(0.3, 1.1)
    side = int(rng.choice(sides))
    span = (w if side < 2 else d) - 0.4 - pw
    if span < 0.1:
        return
    at, z = rng.uniform(0.2, 0.2 + span), rng.uniform(0.9, 1.3)
    board = MeshBuilder.drawn(rng)
    board.box((0, -0.02, 0), (pw, 0, ph), M["sign"])
    b.add(board.mesh().placed(room.at_wall(side, at, 0.09, z)))
