"""A large site: parallel streets of houses with crossroads, gardens behind, trees and parked cars."""

import math

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from trihedral.simulate import outdoors, parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder, placement
from trihedral.simulate.noise import value_noise
from trihedral.simulate.scene import Float, Light, Mover, Scene
from trihedral.simulate.scenes.facade import house

Rng = np.random.Generator


def estate(seed: int) -> Scene:
    """Make an estate of three to four streets, about two hundred metres long."""
    rng = np.random.default_rng((seed, 0xE57A7E))
    streets, blocks = int(rng.integers(3, 5)), int(rng.integers(2, 4))
    block, crossing = rng.uniform(55, 75), rng.uniform(11, 15)
    road, garden = rng.uniform(13, 18), rng.uniform(16, 24)
    # Two rows of houses, each up to 12 m deep, back to back across their gardens.
    pitch = road + garden + 24.0
    long = blocks * block + (blocks + 1) * crossing
    wide = (streets - 1) * pitch
    slope = rng.normal(0, 0.008, 2)

    def ground(x: float, y: float) -> float:
        return float(slope[0] * x + slope[1] * y)

    b = MeshBuilder(int(rng.integers(1 << 32)))
    axis_x = np.arange(-60.0, long + 60.0, 1.0)
    axis_y = np.arange(-60.0, wide + 60.0, 1.0)
    xx, yy = np.meshgrid(axis_x, axis_y)
    texture = np.full(xx.size, int(rng.integers(1 << 32)), np.uint32)
    u, v = xx.ravel().astype(np.float32), yy.ravel().astype(np.float32)
    bumps = 0.04 * value_noise(u, v, 9.0, texture) + 0.1 * value_noise(u, v, 30.0, texture)
    z = slope[0] * xx + slope[1] * yy + bumps.reshape(xx.shape).astype(float)
    b.heights(axis_x, axis_y, z, M["asphalt"])

    for k in range(streets):
        for side in (-1, 1):
            front = k * pitch + side * road / 2
            for n in range(blocks):
                x = crossing + n * (block + crossing)
                last = x + block
                while last - x > 7.0:
                    width = min(rng.uniform(8, 17), last - x)
                    gap = 0.0 if rng.random() < 0.5 else rng.uniform(2.0, 6.0)
                    if rng.random() < 0.9:
                        left, yaw = (x, 0.0) if side == 1 else (x + width, math.pi)
                        low = min(ground(x, front), ground(x + width, front)) - 0.15
                        back_off = side * (rng.uniform(0.0, 3.0) if rng.random() < 0.5 else 0.0)
                        stood = placement(left, front + back_off, low, yaw + rng.normal(0, 0.01))
                        b.add(house(rng, width).placed(stood))
                    x += width + gap
            for x in np.arange(crossing, long - crossing, rng.uniform(9, 16)):
                spot = (float(x + rng.normal(0, 1.0)), front - side * 1.6)
                what = rng.random()
                if what < 0.45:
                    still, crown = outdoors.trunk_and_crown(rng)
                    tree = placement(*spot, ground(*spot), rng.uniform(0, 6.3))
                    b.add(still.placed(tree))
                    b.add(crown.placed(tree))
                elif what < 0.65:
                    b.add(
                        outdoors.lamp_post(rng).placed(placement(*spot, ground(*spot), -side * math.pi / 2))
                    )
                elif what < 0.85:
                    b.add(
                        outdoors.car(rng).placed(
                            placement(*spot, ground(*spot), 0.0 if side < 0 else math.pi)
                        )
                    )
                else:
                    b.add(
                        outdoors.bin_or_box(rng).placed(placement(*spot, ground(*spot), rng.uniform(0, 6.3)))
                    )
        if k < streets - 1:
            middle = (k + 0.5) * pitch
            for x in np.arange(crossing + 3, long - crossing - 3, 8.0):
                spot = (float(x + rng.uniform(-3, 3)), middle + rng.uniform(-garden / 3, garden / 3))
                thing = outdoors.bush(rng) if rng.random() < 0.7 else outdoors.trunk_and_crown(rng)[0]
                b.add(thing.placed(placement(*spot, ground(*spot))))

    def in_street(r: Rng) -> tuple[float, float]:
        return r.uniform(0, long), float(r.integers(streets)) * pitch + r.uniform(-road / 2 + 1, road / 2 - 1)

    def walking(r: Rng) -> Float:
        x, y = in_street(r)
        return placement(x, y, ground(x, y) + 0.05, r.uniform(0, 6.3))

    def driving(r: Rng) -> Float:
        x, y = in_street(r)
        return placement(x, y, ground(x, y) + 0.05, 0.0 if r.random() < 0.5 else math.pi)

    movers = [Mover(parts.person(rng), walking) for _ in range(int(rng.integers(8, 20)))]
    movers += [Mover(outdoors.car(rng), driving) for _ in range(int(rng.integers(3, 8)))]
    stands: list[tuple[float, float]] = []
    for k in range(streets):
        across = (-road / 2 + 2.5, -road / 5, 0.0, road / 5, road / 2 - 2.5)
        stands += [(x, k * pitch + y) for x in np.arange(2.0, long - 1.0, 3.0) for y in across]
        if k < streets - 1:
            ways = crossing / 2 + np.arange(blocks + 1) * (block + crossing)
            stands += [(x, k * pitch + y) for x in ways for y in np.arange(road / 2, pitch - road / 2, 3.0)]
    surface = RegularGridInterpolator((axis_y, axis_x), z)
    places = np.array([(x, y, float(surface((y, x)))) for x, y in stands])
    turn = rng.uniform(0, 2 * math.pi)
    light = Light(
        (0.50, 0.52, 0.56), 0.18, (0.55, 0.52, 0.45), (0.7 * math.cos(turn), 0.7 * math.sin(turn), 0.714)
    )
    return Scene("estate", seed, b.mesh(), tuple(movers), light, places, 15.0)
