"""A large site: parallel streets of houses with crossroads, gardens behind, trees and parked cars."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from trihedral.geometry.arrays import Float64
from trihedral.simulate import outdoors, parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder, Rng, placement
from trihedral.simulate.noise import value_noise
from trihedral.simulate.scene import Scene, daylight, movers
from trihedral.simulate.scenes.house import house


def estate(seed: int) -> Scene:
    """Make an estate of three to four streets, about two hundred metres long."""
    rng = np.random.default_rng((seed, 0xE57A7E))
    plan = _EstatePlan.drawn(rng)
    b = MeshBuilder.drawn(rng)
    surface = _ground(rng, b, plan)
    for k in range(plan.streets):
        for side in (-1, 1):
            front = k * plan.pitch + side * plan.road / 2
            _houses(rng, b, plan, front, side)
            _kerbside(rng, b, plan, front, side)
        if k < plan.streets - 1:
            _gardens(rng, b, plan, (k + 0.5) * plan.pitch)
    moving = movers(rng, parts.person, plan.walking, 8, 20) + movers(rng, outdoors.car, plan.driving, 3, 8)
    places = np.array([(x, y, float(surface((y, x)))) for x, y in _stands(plan)])
    light = daylight(rng.uniform(0, 2 * math.pi), 0.7, 0.714)
    return Scene("estate", seed, b.mesh(), moving, light, places, 15.0)


@dataclass(frozen=True)
class _EstatePlan:
    """Sizes, metres: streets run along x, one every `pitch`; blocks of houses lie between crossings."""

    streets: int
    blocks: int
    block: float
    crossing: float
    road: float
    garden: float
    slope: Float64

    @staticmethod
    def drawn(rng: Rng) -> "_EstatePlan":
        streets, blocks = int(rng.integers(3, 5)), int(rng.integers(2, 4))
        block, crossing = rng.uniform(55, 75), rng.uniform(11, 15)
        road, garden = rng.uniform(13, 18), rng.uniform(16, 24)
        return _EstatePlan(streets, blocks, block, crossing, road, garden, rng.normal(0, 0.008, 2))

    @property
    def pitch(self) -> float:
        """Two rows of houses, each up to 12 m deep, stand back to back across their gardens."""
        return self.road + self.garden + 24.0

    @property
    def long(self) -> float:
        return self.blocks * self.block + (self.blocks + 1) * self.crossing

    def height(self, x: float, y: float) -> float:
        """Of the ground without its bumps."""
        return float(self.slope[0] * x + self.slope[1] * y)

    def _in_street(self, rng: Rng) -> tuple[float, float]:
        x, street = rng.uniform(0, self.long), float(rng.integers(self.streets))
        return x, street * self.pitch + rng.uniform(-self.road / 2 + 1, self.road / 2 - 1)

    def walking(self, rng: Rng) -> Float64:
        x, y = self._in_street(rng)
        return placement(x, y, self.height(x, y) + 0.05, rng.uniform(0, 6.3))

    def driving(self, rng: Rng) -> Float64:
        x, y = self._in_street(rng)
        return placement(x, y, self.height(x, y) + 0.05, 0.0 if rng.random() < 0.5 else math.pi)


def _ground(rng: Rng, b: MeshBuilder, plan: _EstatePlan) -> RegularGridInterpolator:
    """Sloping asphalt with bumps; returns its height at (y, x)."""
    axis_x = np.arange(-60.0, plan.long + 60.0, 1.0)
    axis_y = np.arange(-60.0, (plan.streets - 1) * plan.pitch + 60.0, 1.0)
    xx, yy = np.meshgrid(axis_x, axis_y)
    texture = np.full(xx.size, int(rng.integers(1 << 32)), np.uint32)
    u, v = xx.ravel().astype(np.float32), yy.ravel().astype(np.float32)
    bumps = 0.04 * value_noise(u, v, 9.0, texture) + 0.1 * value_noise(u, v, 30.0, texture)
    z = plan.slope[0] * xx + plan.slope[1] * yy + bumps.reshape(xx.shape).astype(float)
    b.heights(axis_x, axis_y, z, M["asphalt"])
    return RegularGridInterpolator((axis_y, axis_x), z)


def _houses(rng: Rng, b: MeshBuilder, plan: _EstatePlan, front: float, side: int) -> None:
    """One side of a street."""
    for n in range(plan.blocks):
        x = plan.crossing + n * (plan.block + plan.crossing)
        last = x + plan.block
        while last - x > 7.0:
            width = min(rng.uniform(8, 17), last - x)
            gap = 0.0 if rng.random() < 0.5 else rng.uniform(2.0, 6.0)
            if rng.random() < 0.9:
                left, yaw = (x, 0.0) if side == 1 else (x + width, math.pi)
                low = min(plan.height(x, front), plan.height(x + width, front)) - 0.15
                back_off = side * (rng.uniform(0.0, 3.0) if rng.random() < 0.5 else 0.0)
                stood = placement(left, front + back_off, low, yaw + rng.normal(0, 0.01))
                b.add(house(rng, width).placed(stood))
            x += width + gap


def _kerbside(rng: Rng, b: MeshBuilder, plan: _EstatePlan, front: float, side: int) -> None:
    """Trees, lamps, cars and bins along one side of a street."""
    for x in np.arange(plan.crossing, plan.long - plan.crossing, rng.uniform(9, 16)):
        px, py = float(x + rng.normal(0, 1.0)), front - side * 1.6
        what, z = rng.random(), plan.height(px, py)
        if what < 0.45:
            thing, yaw = outdoors.tree(rng), rng.uniform(0, 6.3)
        elif what < 0.65:
            thing, yaw = outdoors.lamp_post(rng), -side * math.pi / 2
        elif what < 0.85:
            thing, yaw = outdoors.car(rng), 0.0 if side < 0 else math.pi
        else:
            thing, yaw = outdoors.bin_or_box(rng), rng.uniform(0, 6.3)
        b.put(thing, px, py, z, yaw)


def _gardens(rng: Rng, b: MeshBuilder, plan: _EstatePlan, middle: float) -> None:
    """Bushes and trunks between two rows of houses."""
    for x in np.arange(plan.crossing + 3, plan.long - plan.crossing - 3, 8.0):
        px, py = float(x + rng.uniform(-3, 3)), middle + rng.uniform(-plan.garden / 3, plan.garden / 3)
        thing = outdoors.bush(rng) if rng.random() < 0.7 else outdoors.trunk_and_crown(rng)[0]
        b.put(thing, px, py, plan.height(px, py))


def _stands(plan: _EstatePlan) -> list[tuple[float, float]]:
    """Places in plan: along the streets and on the ways between them."""
    stands: list[tuple[float, float]] = []
    road, pitch = plan.road, plan.pitch
    for k in range(plan.streets):
        across = (-road / 2 + 2.5, -road / 5, 0.0, road / 5, road / 2 - 2.5)
        stands += [(x, k * pitch + y) for x in np.arange(2.0, plan.long - 1.0, 3.0) for y in across]
        if k < plan.streets - 1:
            ways = plan.crossing / 2 + np.arange(plan.blocks + 1) * (plan.block + plan.crossing)
            stands += [(x, k * pitch + y) for x in ways for y in np.arange(road / 2, pitch - road / 2, 3.0)]
    return stands
