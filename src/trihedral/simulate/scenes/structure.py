"""A structure half built: raft, columns, decks, walls, formwork, props, bars, a stair, scaffolding."""

import math
from dataclasses import dataclass

import numpy as np

from trihedral.simulate import outdoors
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder, Rng, placement

Place = tuple[float, float]


@dataclass(frozen=True)
class Bays:
    """A grid of columns: its lowest corner, how many bays each way, their widths, and the raft's height."""

    low: Place
    count: tuple[int, int]
    pitch: Place
    level: float

    @property
    def size(self) -> Place:
        """Metres along x and y."""
        return self.count[0] * self.pitch[0], self.count[1] * self.pitch[1]

    @property
    def high(self) -> Place:
        """The highest corner."""
        return self.low[0] + self.size[0], self.low[1] + self.size[1]

    def at(self, i: int, j: int) -> Place:
        """Where a column stands."""
        return self.low[0] + i * self.pitch[0], self.low[1] + j * self.pitch[1]

    def around(self, x: float, y: float, margin: float) -> bool:
        """Whether a place lies inside or nearer than this."""
        (x0, y0), (x1, y1) = self.low, self.high
        return x0 - margin < x < x1 + margin and y0 - margin < y < y1 + margin


@dataclass(frozen=True)
class _Storey:
    """Heights of a storey: its floor, the underside of its deck and the deck's top; whether it is the last."""

    floor: float
    under: float
    deck: float
    last: bool


def structure(rng: Rng, b: MeshBuilder, bays: Bays) -> list[float]:
    """Add a structure; returns the heights of the decks that can be walked on."""
    (x0, y0), (x1, y1), level = bays.low, bays.high, bays.level
    height, thick = rng.uniform(2.9, 3.7), rng.uniform(0.2, 0.3)
    storeys, over = int(rng.integers(1, 4)), rng.uniform(0.3, 1.0)
    b.box((x0 - over, y0 - over, level - 1.2), (x1 + over, y1 + over, level), M["concrete"])
    decks = [level]
    width, round_columns = rng.uniform(0.3, 0.5), rng.random() < 0.35
    stair = (int(rng.integers(0, bays.count[0])), int(rng.integers(0, bays.count[1])))
    for s in range(storeys):
        under = level + (s + 1) * height - thick
        storey = _Storey(level + s * height, under, under + thick, s == storeys - 1)
        _columns(rng, b, bays, storey, width, round_columns)
        _deck(rng, b, bays, storey, stair)
        if not storey.last or rng.random() < 0.4:
            decks.append(storey.deck)
        _walls(rng, b, bays, storey)
    for _ in range(int(rng.integers(1, 3))):
        _scaffold(rng, b, bays, storeys * height + 1.0, over + 0.3)
    for deck in decks:
        for _ in range(int(rng.integers(1, 6))):
            x, y = rng.uniform(x0 + 1, x1 - 1), rng.uniform(y0 + 1, y1 - 1)
            b.put(outdoors.pallet(rng), x, y, deck, rng.uniform(0, 6.3))
    return decks


def _columns(
    rng: Rng, b: MeshBuilder, bays: Bays, storey: _Storey, width: float, round_columns: bool
) -> None:
    """Columns poured, in formwork, or only their bars."""
    z0, z1, h = storey.floor, storey.under, width / 2
    for i in range(bays.count[0] + 1):
        for j in range(bays.count[1] + 1):
            x, y = bays.at(i, j)
            if storey.last and rng.random() < 0.35:
                _bars(rng, b, x, y, z0, width)
            elif round_columns:
                b.tube([(x, y, z0), (x, y, z1)], h, M["concrete"], sides=28, caps=False)
            else:
                skin = M["ply"] if rng.random() < 0.12 else M["concrete"]
                b.box((x - h, y - h, z0), (x + h, y + h, z1), skin, bottom=False)


def _deck(rng: Rng, b: MeshBuilder, bays: Bays, storey: _Storey, stair: tuple[int, int]) -> None:
    """Pour a deck bay by bay, the last one not everywhere yet; one bay has the stair."""
    pitch, z0, z1 = bays.pitch, storey.floor, storey.under
    for i in range(bays.count[0]):
        for j in range(bays.count[1]):
            xa, ya = bays.at(i, j)
            if (i, j) == stair:
                if not storey.last:
                    _stair(b, xa + 0.6, ya + 0.6, z0, storey.deck, min(pitch[0] - 1.2, 4.5))
                continue
            missing = storey.last and rng.random() < 0.45
            if not missing:
                b.box((xa, ya, z1), (xa + pitch[0], ya + pitch[1], storey.deck), M["concrete"])
            if missing or rng.random() < 0.25:
                _props(rng, b, (xa, ya), (xa + pitch[0], ya + pitch[1]), storey, formwork=missing)


def _props(rng: Rng, b: MeshBuilder, low: Place, high: Place, storey: _Storey, *, formwork: bool) -> None:
    """Props under one bay of a deck, and beams and boards where it is not poured yet."""
    (xa, ya), (xb, yb), top = low, high, storey.under
    for px in np.arange(xa + 0.7, xb - 0.3, rng.uniform(1.0, 1.6)):
        for py in np.arange(ya + 0.7, yb - 0.3, rng.uniform(1.0, 1.6)):
            prop = [(px, py, storey.floor), (px, py, top - 0.25)]
            b.tube(prop, [0.03, 0.024], M["painted-metal"], sides=7)
    if formwork:
        for y in np.arange(ya + 0.7, yb - 0.2, 1.2):
            b.box((xa + 0.3, y - 0.04, top - 0.25), (xb - 0.3, y + 0.04, top - 0.05), M["wood"])
        b.box((xa + 0.3, ya + 0.3, top - 0.05), (xb - 0.3, yb - 0.3, top - 0.03), M["ply"])


def _scaffold(rng: Rng, b: MeshBuilder, bays: Bays, height: float, gap: float) -> None:
    """Scaffold one side, or a part of it."""
    (x0, y0), (x1, y1), z = bays.low, bays.high, bays.level - 0.3
    side = int(rng.integers(0, 4))
    run = (x1 - x0 if side < 2 else y1 - y0) * rng.uniform(0.5, 1.0)
    spot = (
        placement(x0 + run, y0 - gap, z, math.pi),
        placement(x0, y1 + gap, z, 0.0),
        placement(x0 - gap, y0, z, math.pi / 2),
        placement(x1 + gap, y0 + run, z, -math.pi / 2),
    )[side]
    b.add(outdoors.scaffold(rng, run, height).placed(spot))


def _walls(rng: Rng, b: MeshBuilder, bays: Bays, storey: _Storey) -> None:
    """Close some bays: concrete, block work half way up, or formwork panels with their stays."""
    sides = [
        ((xa + 0.3, y), (xb - 0.3, y))
        for i in range(bays.count[0])
        for (xa, y), (xb, _) in ((bays.at(i, j), bays.at(i + 1, j)) for j in (0, bays.count[1]))
    ]
    sides += [
        ((x, ya + 0.3), (x, yb - 0.3))
        for j in range(bays.count[1])
        for (x, ya), (_, yb) in ((bays.at(i, j), bays.at(i, j + 1)) for i in (0, bays.count[0]))
    ]
    z0, z1 = storey.floor, storey.under
    for start, end in sides:
        kind = rng.random()
        length = math.hypot(end[0] - start[0], end[1] - start[1])
        if kind < 0.25:
            holes = []
            if rng.random() < 0.6:
                holes = [(length * 0.3, length * 0.6, rng.uniform(0.0, 1.0), rng.uniform(2.0, 2.4))]
            b.wall(start, end, z0, z1, 0.25, M["concrete"], openings=holes)
        elif kind < 0.42:
            b.wall(start, end, z0, z0 + rng.uniform(0.6, z1 - z0 - 0.1), 0.24, M["blocks"])
        elif kind < 0.52:
            _panels(b, start, end, storey)


def _panels(b: MeshBuilder, start: Place, end: Place, storey: _Storey) -> None:
    """Formwork of a wall, stayed on both sides."""
    z0, z1 = storey.floor, storey.under
    b.wall(start, end, z0, z1 - 0.4, 0.3, M["ply"])
    length = math.hypot(end[0] - start[0], end[1] - start[1])
    dx, dy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    for along in np.arange(0.5, length - 0.3, 1.3):
        x, y = start[0] + dx * along, start[1] + dy * along
        for side in (-1, 1):
            foot = (x + side * -dy * 1.6, y + side * dx * 1.6, z0)
            head = (x + side * -dy * 0.16, y + side * dx * 0.16, z1 - 0.9)
            b.tube([foot, head], 0.03, M["painted-metal"], sides=7)


def _bars(rng: Rng, b: MeshBuilder, x: float, y: float, z: float, width: float) -> None:
    """Set the starter bars of a column that is not there yet."""
    tall = rng.uniform(0.8, 2.6)
    for dx in (-0.4, 0.0, 0.4):
        for dy in (-0.4, 0.0, 0.4):
            if dx or dy:
                px, py = x + dx * width, y + dy * width
                end = (px + rng.normal(0, 0.02), py + rng.normal(0, 0.02), z + tall)
                b.tube([(px, py, z), end], 0.01, M["steel"], sides=5)
    for h in np.arange(0.2, tall, 0.25):
        r = 0.42 * width
        ring = [(x - r, y - r, z + h), (x + r, y - r, z + h), (x + r, y + r, z + h), (x - r, y + r, z + h)]
        for k in range(4):
            b.tube([ring[k], ring[(k + 1) % 4]], 0.006, M["steel"], sides=4, caps=False)


def _stair(b: MeshBuilder, x: float, y: float, z0: float, z1: float, run: float) -> None:
    steps = max(8, round((z1 - z0) / 0.17))
    rise, tread = (z1 - z0) / steps, run / steps
    for k in range(steps):
        high = (x + (k + 1) * tread, y + 1.2, z0 + (k + 1) * rise)
        b.box((x + k * tread, y, z0 + k * rise - 0.05), high, M["concrete"])
