"""A street between houses: kerbs, gardens, cars, trees, lamps, people."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.simulate import outdoors, parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder, Rng, placement
from trihedral.simulate.noise import value_noise
from trihedral.simulate.scene import Mover, Scene, daylight, movers
from trihedral.simulate.scenes.house import house

Spot = tuple[float, float, float]


def facade(seed: int) -> Scene:
    """Make a street."""
    rng = np.random.default_rng((seed, 0xFACADE))
    b = MeshBuilder.drawn(rng)
    street = _Street.drawn(rng)
    _ground(rng, b, street)
    for side in street.fronts:
        _row(rng, b, street, side)
    _ends(rng, b, street)
    moving: list[Mover] = []
    for side in street.fronts:
        moving += _trees(rng, b, street, side)
        _kerbside(rng, b, street, side)
        moving += _parked(rng, b, street, side)
    moving += movers(rng, parts.person, street.walking, 3, 14)
    moving += movers(rng, outdoors.car, street.driving, 1, 4)
    light = daylight(rng.uniform(0, 2 * math.pi), 0.75, 0.66)
    return Scene("facade", seed, b.mesh(), tuple(moving), light, np.array(_stands(street)), 15.0)


@dataclass(frozen=True)
class _Street:
    """A street along x, its middle at 0: sizes in metres, slope and the road's crown as rise over run."""

    length: float
    road: float
    #: By side, -1 or 1: from the road's middle to the houses.
    fronts: dict[int, float]
    slope: float
    crown: float

    @staticmethod
    def drawn(rng: Rng) -> "_Street":
        length, road = rng.uniform(60, 110), rng.uniform(5.0, 9.0)
        fronts = {side: road / 2 + rng.uniform(1.8, 4.5) for side in (-1, 1)}
        return _Street(length, road, fronts, rng.normal(0, 0.012), rng.uniform(0.01, 0.025))

    @property
    def half(self) -> float:
        return self.length / 2

    @property
    def edge(self) -> float:
        """From the road's middle to a kerb."""
        return self.road / 2

    def rise(self, x: float) -> float:
        return self.slope * x

    def walking(self, rng: Rng) -> Float64:
        x, side = rng.uniform(-self.half, self.half), 1 if rng.random() < 0.5 else -1
        y = side * rng.uniform(self.edge + 0.5, self.fronts[side] - 0.3)
        return placement(x, y, self.rise(x) + 0.12, rng.uniform(0, 6.3))

    def driving(self, rng: Rng) -> Float64 | None:
        if rng.random() < 0.4:
            return None
        x = rng.uniform(-self.half, self.half)
        return placement(x, rng.normal(0, 0.3), self.rise(x), 0.0 if rng.random() < 0.5 else math.pi)


def _row(rng: Rng, b: MeshBuilder, street: _Street, side: int) -> None:
    """Houses and gardens on one side."""
    one_sided = side == 1 and rng.random() < 0.25
    x = -street.half - rng.uniform(0, 4)
    while x < street.half:
        width = rng.uniform(7, 19)
        if one_sided or rng.random() < 0.12:
            _garden(rng, b, street, x, x + width, side)
            x += width
            continue
        back_off = 0.0 if rng.random() < 0.7 else rng.uniform(0.0, 2.5)
        front_house = house(rng, width)
        left, yaw = (x, 0.0) if side == 1 else (x + width, math.pi)
        low, turn = min(street.rise(x), street.rise(x + width)) - 0.05, rng.normal(0, 0.012)
        spot = placement(left, side * (street.fronts[side] + back_off), low, yaw + turn)
        b.add(front_house.placed(spot))
        x += width + (0.0 if rng.random() < 0.6 else rng.uniform(0.5, 4.0))


def _ends(rng: Rng, b: MeshBuilder, street: _Street) -> None:
    """Houses across the street at its ends."""
    for end in (-1, 1):
        if rng.random() < 0.7:
            width = street.fronts[1] + street.fronts[-1] + rng.uniform(4, 10)
            far = end * (street.half + rng.uniform(9, 25))
            spot = placement(far, end * width / 2, street.rise(far) - 0.1, -end * math.pi / 2)
            b.add(house(rng, width).placed(spot))


def _trees(rng: Rng, b: MeshBuilder, street: _Street, side: int) -> list[Mover]:
    """Trees on the pavement, where it is wide enough; their crowns move."""
    crowns = []
    at = -street.half + rng.uniform(2, 8)
    step, kind = rng.uniform(6, 16), rng.random()
    while at < street.half:
        spot = (at + rng.normal(0, 0.5), side * (street.edge + 0.55), street.rise(at) + 0.12)
        if kind < 0.6 and street.fronts[side] - street.edge > 2.4:
            still, crown = outdoors.trunk_and_crown(rng)
            b.put(still, *spot)
            crowns.append(Mover(crown, _swaying(spot, rng.uniform(0, 6.28), rng.uniform(0.001, 0.008))))
        at += step * rng.uniform(0.7, 1.4)
    return crowns


def _kerbside(rng: Rng, b: MeshBuilder, street: _Street, side: int) -> None:
    """Lamps, signs and bins on the pavement."""
    at = -street.half + rng.uniform(5, 15)
    while at < street.half:
        yaw = -side * math.pi / 2 + rng.normal(0, 0.1)
        spot = placement(at, side * (street.edge + 0.4), street.rise(at) + 0.12, yaw)
        b.add(outdoors.lamp_post(rng).placed(spot))
        at += rng.uniform(14, 30)
    for _ in range(int(rng.integers(3, 10))):
        x, y = rng.uniform(-street.half, street.half), side * (street.edge + rng.uniform(0.4, 0.9))
        thing = outdoors.traffic_sign(rng) if rng.random() < 0.5 else outdoors.bin_or_box(rng)
        b.put(thing, x, y, street.rise(x) + 0.12, rng.uniform(0, 6.3))


def _parked(rng: Rng, b: MeshBuilder, street: _Street, side: int) -> list[Mover]:
    """Cars at the kerb; returns those that come and go."""
    coming = []
    x, parked = -street.half, rng.uniform(0.2, 0.8)
    while x < street.half:
        if rng.random() < parked:
            mesh, z = outdoors.car(rng), street.rise(x + 2.5) - 0.02
            spot = placement(x + 2.5, side * (street.edge - 1.0), z, 0.0 if side < 0 else math.pi)
            if rng.random() < 0.8:
                b.add(mesh.placed(spot))
            else:
                coming.append(Mover(mesh, _sometimes(spot)))
        x += rng.uniform(5.4, 8.5)
    return coming


def _stands(street: _Street) -> list[Spot]:
    """Places on the pavements and on the road."""
    stands: list[Spot] = []
    for x in np.arange(-street.half + 4, street.half - 4, 1.5):
        z = street.rise(float(x))
        for side, front in street.fronts.items():
            across = (street.edge + 0.9, (street.edge + front) / 2, front - 0.8)
            stands += [(x, side * y, z + 0.12) for y in across]
        for y in (-street.road / 4, 0.0, street.road / 4):
            stands.append((x, y, z + street.crown * (street.edge - abs(y))))
    return stands


def _swaying(foot: Spot, yaw: float, amount: float) -> Callable[[Rng], Float64]:
    """Bend about the foot by a fraction of a degree, another one at each scan."""

    def place(rng: Rng) -> Float64:
        pose = placement(*foot, yaw)
        lean = amount * rng.standard_normal(2)
        out = pose.copy()
        for i in range(3):
            out[i, 2] = pose[i, 0] * lean[0] + pose[i, 1] * lean[1] + pose[i, 2]
        return out

    return place


def _sometimes(spot: Float64) -> Callable[[Rng], Float64 | None]:
    return lambda rng: spot if rng.random() < 0.5 else None


def _ground(rng: Rng, b: MeshBuilder, street: _Street) -> None:
    """Road with a crown and small bumps, kerbs, pavements, all along a slope; earth beyond."""
    far, half, slope = street.half + 45, street.edge, street.slope
    x, y = np.arange(-far, far + 0.01, 0.75), np.linspace(-half, half, 25)
    xx, yy = np.meshgrid(x, y)
    seed = np.full(xx.size, int(rng.integers(1 << 32)), np.uint32)
    u, v = xx.ravel().astype(np.float32), yy.ravel().astype(np.float32)
    bumps = 0.008 * value_noise(u, v, 2.3, seed) + 0.015 * value_noise(u, v, 9.0, seed)
    z = slope * xx + street.crown * (half - np.abs(yy)) + bumps.reshape(xx.shape).astype(float)
    b.heights(x, y, z, M["asphalt"])
    along, foot = (2 * far, 0, 2 * far * slope), -slope * far
    for side, front in street.fronts.items():
        kerb0, kerb1, y1 = half * side, (half + 0.15) * side, (front + 3.0) * side
        b.quad((-far, kerb0, foot - 0.05), along, (0, 0, 0.17), M["stone"])
        b.quad((-far, kerb0, foot + 0.12), along, (0, kerb1 - kerb0, 0), M["stone"])
        b.quad((-far, kerb1, foot + 0.12), along, (0, y1 - kerb1, 0), M["paving"])
        b.quad((-far, y1, foot + 0.1), along, (0, 50.0 * side, 0), M["grass"])


def _garden(rng: Rng, b: MeshBuilder, street: _Street, x0: float, x1: float, side: int) -> None:
    """Leave a gap in the row: a low wall, bushes, trees."""
    front, rise = street.fronts[side], street.rise
    y = side * (front + 0.3)
    if rng.random() < 0.7:
        h = rng.uniform(0.6, 1.9)
        low = min(rise(x0), rise(x1)) - 0.1
        b.wall((x0, y), (x1, y), low, low + 0.3 + h, 0.25, M[str(rng.choice(["brick", "stone", "plaster"]))])
    for _ in range(int(rng.integers(2, 7))):
        x, deep = rng.uniform(x0, x1), front + rng.uniform(0.9, 8.0)
        b.put(outdoors.bush(rng), x, side * deep, rise(x) + 0.1)
    if rng.random() < 0.7:
        middle = (x0 + x1) / 2
        b.put(outdoors.tree(rng), middle, side * (front + 4.5), rise(middle) + 0.1)
