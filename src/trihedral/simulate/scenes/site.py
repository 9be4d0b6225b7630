"""A construction site: sloping ground, a structure half built, machines, fences, houses around."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.simulate import outdoors, parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng, placement
from trihedral.simulate.noise import value_noise
from trihedral.simulate.scene import Scene, daylight, movers
from trihedral.simulate.scenes.house import house
from trihedral.simulate.scenes.structure import Bays, Place, structure


def site(seed: int) -> Scene:
    """Make a construction site."""
    rng = np.random.default_rng((seed, 0x517E))
    b = MeshBuilder.drawn(rng)
    half = rng.uniform(20, 34)
    ground = _Ground(rng, half)
    bays = _bays(rng, ground, half)
    decks = structure(rng, b, bays)
    centre = (bays.low[0] + bays.size[0] / 2, bays.low[1] + bays.size[1] / 2)
    yard = _Yard(ground, half, bays, [(centre, 0.0)])
    _machines(rng, b, yard)
    _fences(rng, b, ground, half)
    _neighbours(rng, b, ground, half)
    b.add(ground.mesh(rng))
    moving = movers(rng, parts.person, yard.walks(0.8), 3, 10)
    moving += movers(rng, outdoors.excavator, yard.walks(4.0), 0, 2)
    moving += movers(rng, outdoors.car, yard.walks(3.0), 0, 3)
    light = daylight(rng.uniform(0, 2 * math.pi), 0.7, 0.714)
    reach = max(12.0, math.hypot(*bays.size) / 2)
    return Scene("site", seed, b.mesh(), moving, light, _stands(yard, decks), reach)


class _Ground:
    """Uneven ground: a slope, an embankment, ruts and bumps; linear between grid points, as the mesh is."""

    step = 0.8

    def __init__(self, rng: Rng, half: float) -> None:
        outer = half + 40.0
        self.axis = np.arange(-outer, outer + self.step, self.step)
        xx, yy = np.meshgrid(self.axis, self.axis)
        turn, grade = rng.uniform(0, 2 * math.pi), rng.uniform(0.0, 0.07)
        along = xx * math.cos(turn) + yy * math.sin(turn)
        z = grade * along
        u, v = xx.ravel().astype(np.float32), yy.ravel().astype(np.float32)
        seed = np.full(u.size, int(rng.integers(1 << 32)), np.uint32)
        for wave, height in (
            (28.0, rng.uniform(0.2, 0.9)),
            (8.0, rng.uniform(0.08, 0.3)),
            (2.6, rng.uniform(0.02, 0.07)),
        ):
            z += height * value_noise(u, v, wave, seed + np.uint32(int(wave * 10))).reshape(z.shape)
        if rng.random() < 0.6:
            # An embankment across the site: a smooth step.
            side = rng.uniform(0, 2 * math.pi)
            t = xx * math.cos(side) + yy * math.sin(side) - rng.uniform(0.25, 0.7) * half
            t = np.clip(t / rng.uniform(3, 7), 0.0, 1.0)
            z += rng.uniform(-2.0, 2.5) * t * t * (3 - 2 * t)
        self.z = z

    def height(self, x: float, y: float) -> float:
        """Height of the mesh's surface at a place."""
        gx, gy = (x - self.axis[0]) / self.step, (y - self.axis[0]) / self.step
        i, j = int(gx), int(gy)
        a, c = gx - i, gy - j
        z00, z10, z01, z11 = self.z[j, i], self.z[j, i + 1], self.z[j + 1, i], self.z[j + 1, i + 1]
        # The quad is split along its rising diagonal.
        if a >= c:
            return float(z00 + a * (z10 - z00) + c * (z11 - z10))
        return float(z00 + a * (z11 - z01) + c * (z01 - z00))

    def mesh(self, rng: Rng) -> Mesh:
        """Make the ground."""
        b = MeshBuilder.drawn(rng)
        b.heights(self.axis, self.axis, self.z, M[str(rng.choice(["earth", "gravel", "earth"]))])
        return b.mesh()


def _bays(rng: Rng, ground: _Ground, half: float) -> Bays:
    """Choose where the structure stands: its raft lies above the ground everywhere."""
    count = (int(rng.integers(2, 6)), int(rng.integers(2, 4)))
    pitch = (rng.uniform(4.2, 7.0), rng.uniform(4.2, 6.5))
    width, depth = count[0] * pitch[0], count[1] * pitch[1]
    x = rng.uniform(-half * 0.5, half * 0.5 - width * 0.7)
    y = rng.uniform(-half * 0.5, half * 0.4 - depth * 0.7)
    places = [(x + u * width, y + v * depth) for u in (0, 0.5, 1) for v in (0, 0.5, 1)]
    return Bays((x, y), count, pitch, max(ground.height(*p) for p in places) + rng.uniform(0.05, 0.3))


@dataclass(frozen=True)
class _Yard:
    """The site around the structure; `taken` holds the places and radii of what stands there."""

    ground: _Ground
    half: float
    bays: Bays
    taken: list[tuple[Place, float]]

    def free_spot(self, rng: Rng, radius: float) -> Place | None:
        """Take a place for a thing of this radius, if one is found."""
        for _ in range(40):
            x, y = rng.uniform(-self.half * 0.92, self.half * 0.92, 2)
            clear = (math.hypot(x - tx, y - ty) > radius + tr + 0.6 for (tx, ty), tr in self.taken)
            if not self.bays.around(x, y, radius + 1.5) and all(clear):
                self.taken.append(((x, y), radius))
                return float(x), float(y)
        return None

    def put(self, rng: Rng, b: MeshBuilder, mesh: Mesh, radius: float, sink: float = 0.03) -> None:
        """Stand a thing on a free place, turned any way."""
        spot = self.free_spot(rng, radius)
        if spot is not None:
            z = self.ground.height(*spot) - sink
            b.put(mesh, *spot, z, rng.uniform(0, 2 * math.pi))

    def walks(self, margin: float) -> Callable[[Rng], Float64 | None]:
        """Draw places outside the structure."""

        def place(rng: Rng) -> Float64 | None:
            for _ in range(10):
                x, y = rng.uniform(-self.half * 0.8, self.half * 0.8, 2)
                if not self.bays.around(x, y, margin):
                    return placement(x, y, self.ground.height(x, y), rng.uniform(0, 2 * math.pi))
            return None

        return place


def _machines(rng: Rng, b: MeshBuilder, yard: _Yard) -> None:
    """Crane, cabins, excavators, heaps, materials, cars."""
    if rng.random() < 0.6:
        yard.put(rng, b, outdoors.tower(rng, rng.uniform(14, 28)), 2.0, 0.2)
    _cabins(rng, b, yard)
    for _ in range(int(rng.integers(1, 4))):
        yard.put(rng, b, outdoors.excavator(rng), 3.5)
    for _ in range(int(rng.integers(1, 5))):
        spot = yard.free_spot(rng, 3.0)
        if spot is not None:
            b.add(_heap(rng, yard.ground, spot))
    for maker, least, most, radius in (
        (outdoors.pile_of_pipes, 1, 5, 2.5),
        (outdoors.pallet, 5, 18, 1.3),
        (outdoors.tank, 0, 3, 1.7),
        (outdoors.bush, 2, 10, 1.0),
        (outdoors.bin_or_box, 2, 6, 0.5),
        (outdoors.car, 1, 5, 2.4),
    ):
        for _ in range(int(rng.integers(least, most))):
            yard.put(rng, b, maker(rng), radius)


def _stands(yard: _Yard, decks: list[float]) -> Float64:
    """Places on the ground, most of them near the structure, and on the decks."""
    half, (x0, y0), (x1, y1) = yard.half, yard.bays.low, yard.bays.high
    stands: list[tuple[float, float, float]] = []
    for x in np.arange(-half * 0.85, half * 0.85, 2.0):
        for y in np.arange(-half * 0.85, half * 0.85, 2.0):
            near = yard.bays.around(x, y, 9.0) or (round(x / 2.0) + round(y / 2.0)) % 4 == 0
            if near and not yard.bays.around(x, y, 1.0):
                stands.append((x, y, yard.ground.height(x, y)))
    on_deck = [(x, y) for x in np.arange(x0 + 1.0, x1 - 0.5, 1.3) for y in np.arange(y0 + 1.0, y1 - 0.5, 1.3)]
    places = np.array(stands + [(x, y, deck) for deck in decks for x, y in on_deck])
    # Fewer on the upper decks, which see little of what is below.
    upper = places[:, 2] > yard.bays.level + 1.0
    return np.asarray(places[~upper | (np.arange(len(places)) % 4 == 0)])


def _cabins(rng: Rng, b: MeshBuilder, yard: _Yard) -> None:
    """One or two groups of containers, side by side and stacked."""
    for _ in range(int(rng.integers(1, 4))):
        spot = yard.free_spot(rng, 4.5)
        if spot is None:
            continue
        yaw = rng.uniform(0, 2 * math.pi)
        for k in range(int(rng.integers(1, 4))):
            for tier in range(1 if rng.random() < 0.65 else 2):
                dx, dy = -2.5 * k * math.sin(yaw), 2.5 * k * math.cos(yaw)
                x, y = spot[0] + dx, spot[1] + dy
                z = yard.ground.height(*spot) - 0.05 + tier * 2.62
                b.put(outdoors.container(rng), x, y, z, yaw)


def _heap(rng: Rng, ground: _Ground, spot: Place) -> Mesh:
    """Heap up a pile of earth, sand or rubble."""
    b = MeshBuilder.drawn(rng)
    radius, tall = rng.uniform(1.8, 3.6), rng.uniform(0.8, 2.4)
    stretch, turn = rng.uniform(0.6, 1.0), rng.uniform(0, math.pi)
    axis = np.linspace(-radius, radius, 41)
    xx, yy = np.meshgrid(axis, axis)
    u = (xx * math.cos(turn) + yy * math.sin(turn)) / radius
    v = (yy * math.cos(turn) - xx * math.sin(turn)) / (radius * stretch)
    seed = np.full(xx.size, int(rng.integers(1 << 32)), np.uint32)
    flat_x, flat_y = xx.ravel().astype(np.float32), yy.ravel().astype(np.float32)
    rough = value_noise(flat_x, flat_y, 0.5, seed).reshape(xx.shape)
    t = np.clip(1.0 - np.sqrt(u * u + v * v), 0.0, 1.0)
    base = np.array([[ground.height(spot[0] + x, spot[1] + y) for x in axis] for y in axis])
    z = base - 0.08 + tall * t * (1.0 + 0.12 * rough) + 0.05 * rough * (t > 0)
    b.heights(axis, axis, z, M[str(rng.choice(["earth", "gravel"]))])
    return b.mesh().placed(placement(*spot))


def _fences(rng: Rng, b: MeshBuilder, ground: _Ground, half: float) -> None:
    for side in range(4):
        if rng.random() < 0.3:
            continue
        yaw = side * math.pi / 2
        at = -half
        while at < half - 8:
            run = rng.uniform(7, 22)
            x, y = at * math.cos(yaw) + half * math.sin(yaw), at * math.sin(yaw) - half * math.cos(yaw)
            ex, ey = x + run * math.cos(yaw), y + run * math.sin(yaw)
            low = min(ground.height(x, y), ground.height(ex, ey))
            b.put(outdoors.fence(rng, min(run, half - at)), x, y, low, yaw + rng.normal(0, 0.02))
            at += run + rng.uniform(0.0, 5.0)


def _neighbours(rng: Rng, b: MeshBuilder, ground: _Ground, half: float) -> None:
    """Houses and trees around the site."""
    for side in range(4):
        if rng.random() < 0.45:
            continue
        yaw = side * math.pi / 2
        at = -half
        while at < half:
            width, off = rng.uniform(8, 18), half + rng.uniform(4, 14)
            if rng.random() < 0.6:
                # The front looks towards the site.
                x, y = at * math.cos(yaw) - off * math.sin(yaw), at * math.sin(yaw) + off * math.cos(yaw)
                b.put(house(rng, width), x, y, ground.height(x, y) - 0.6, yaw)
            at += width + rng.uniform(0, 8)
    for _ in range(int(rng.integers(2, 9))):
        a, far = rng.uniform(0, 2 * math.pi), half + rng.uniform(2, 12)
        x, y = far * math.cos(a), far * math.sin(a)
        b.put(outdoors.tree(rng), x, y, ground.height(x, y) - 0.1)
