"""A construction site: sloping ground, a structure half built, scaffolding, formwork, machines, fences."""

import math
from collections.abc import Callable

import numpy as np

from trihedral.simulate import outdoors, parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Float, Mesh, MeshBuilder, Rng, placement
from trihedral.simulate.noise import value_noise
from trihedral.simulate.scene import Light, Mover, Scene
from trihedral.simulate.scenes.house import house

Spot = tuple[float, float, float]  # x, y, radius


def site(seed: int) -> Scene:
    """Make a construction site."""
    rng = np.random.default_rng((seed, 0x517E))
    b = MeshBuilder.drawn(rng)
    half = rng.uniform(20, 34)
    ground = _Ground(rng, half)
    taken: list[Spot] = []

    bays = (int(rng.integers(2, 6)), int(rng.integers(2, 4)))
    pitch = (rng.uniform(4.2, 7.0), rng.uniform(4.2, 6.5))
    size = (bays[0] * pitch[0], bays[1] * pitch[1])
    low = (
        rng.uniform(-half * 0.5, half * 0.5 - size[0] * 0.7),
        rng.uniform(-half * 0.5, half * 0.4 - size[1] * 0.7),
    )
    level = max(
        ground.height(low[0] + u * size[0], low[1] + v * size[1]) for u in (0, 0.5, 1) for v in (0, 0.5, 1)
    ) + rng.uniform(0.05, 0.3)
    decks = _structure(rng, b, low, bays, pitch, level)
    reach = math.hypot(*size) / 2
    middle = (low[0] + size[0] / 2, low[1] + size[1] / 2)
    taken.append((*middle, 0.0))

    def inside(x: float, y: float, margin: float) -> bool:
        return (
            low[0] - margin < x < low[0] + size[0] + margin
            and low[1] - margin < y < low[1] + size[1] + margin
        )

    def free_spot(radius: float) -> tuple[float, float] | None:
        for _ in range(40):
            x, y = rng.uniform(-half * 0.92, half * 0.92, 2)
            if not inside(x, y, radius + 1.5) and all(
                math.hypot(x - tx, y - ty) > radius + tr + 0.6 for tx, ty, tr in taken
            ):
                taken.append((x, y, radius))
                return float(x), float(y)
        return None

    def put(mesh: Mesh, radius: float, sink: float = 0.03) -> None:
        spot = free_spot(radius)
        if spot is not None:
            z = ground.height(*spot) - sink
            b.add(mesh.placed(placement(*spot, z, rng.uniform(0, 2 * math.pi))))

    if rng.random() < 0.6:
        put(outdoors.tower(rng, rng.uniform(14, 28)), 2.0, 0.2)
    _cabins(rng, b, ground, free_spot)
    for _ in range(int(rng.integers(1, 4))):
        put(outdoors.excavator(rng), 3.5)
    for _ in range(int(rng.integers(1, 5))):
        spot = free_spot(3.0)
        if spot is not None:
            b.add(_heap(rng, ground, spot))
    for maker, least, most, radius in (
        (outdoors.pile_of_pipes, 1, 5, 2.5),
        (outdoors.pallet, 5, 18, 1.3),
        (outdoors.tank, 0, 3, 1.7),
        (outdoors.bush, 2, 10, 1.0),
        (outdoors.bin_or_box, 2, 6, 0.5),
        (outdoors.car, 1, 5, 2.4),
    ):
        for _ in range(int(rng.integers(least, most))):
            put(maker(rng), radius)
    _fences(rng, b, ground, half)
    _neighbours(rng, b, ground, half)
    b.add(ground.mesh(rng))

    movers = [Mover(parts.person(rng), _walks(ground, half, inside)) for _ in range(int(rng.integers(3, 10)))]
    movers += [
        Mover(outdoors.excavator(rng), _walks(ground, half, inside, 4.0))
        for _ in range(int(rng.integers(0, 2)))
    ]
    movers += [
        Mover(outdoors.car(rng), _walks(ground, half, inside, 3.0)) for _ in range(int(rng.integers(0, 3)))
    ]
    stands: list[tuple[float, float, float]] = []
    for x in np.arange(-half * 0.85, half * 0.85, 2.0):
        for y in np.arange(-half * 0.85, half * 0.85, 2.0):
            # Most stations stand near the structure.
            near = inside(x, y, 9.0) or (round(x / 2.0) + round(y / 2.0)) % 4 == 0
            if near and not inside(x, y, 1.0):
                stands.append((x, y, ground.height(x, y)))
    for deck in decks:
        for x in np.arange(low[0] + 1.0, low[0] + size[0] - 0.5, 1.3):
            for y in np.arange(low[1] + 1.0, low[1] + size[1] - 0.5, 1.3):
                stands.append((x, y, deck))
    places = np.array(stands)
    # Fewer on the upper decks, which see little of what is below.
    upper = places[:, 2] > level + 1.0
    keep = ~upper | (np.arange(len(places)) % 4 == 0)
    turn = rng.uniform(0, 2 * math.pi)
    light = Light(
        (0.50, 0.52, 0.56), 0.18, (0.55, 0.52, 0.45), (0.7 * math.cos(turn), 0.7 * math.sin(turn), 0.714)
    )
    return Scene("site", seed, b.mesh(), tuple(movers), light, places[keep], max(12.0, reach))


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
            t = (xx * math.cos(side) + yy * math.sin(side) - rng.uniform(0.25, 0.7) * half) / rng.uniform(
                3, 7
            )
            t = np.clip(t, 0.0, 1.0)
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


def _structure(
    rng: Rng,
    b: MeshBuilder,
    low: tuple[float, float],
    bays: tuple[int, int],
    pitch: tuple[float, float],
    level: float,
) -> list[float]:
    """Raft, columns, decks, walls, formwork, props, bars, a stair, scaffolding; returns deck heights."""
    x0, y0 = low
    x1, y1 = x0 + bays[0] * pitch[0], y0 + bays[1] * pitch[1]
    storey, thick = rng.uniform(2.9, 3.7), rng.uniform(0.2, 0.3)
    storeys = int(rng.integers(1, 4))
    over = rng.uniform(0.3, 1.0)
    b.box((x0 - over, y0 - over, level - 1.2), (x1 + over, y1 + over, level), M["concrete"])
    decks = [level]
    width, round_columns = rng.uniform(0.3, 0.5), rng.random() < 0.35
    stair = (int(rng.integers(0, bays[0])), int(rng.integers(0, bays[1])))
    for s in range(storeys):
        z0, z1 = level + s * storey, level + (s + 1) * storey - thick
        for i in range(bays[0] + 1):
            for j in range(bays[1] + 1):
                x, y = x0 + i * pitch[0], y0 + j * pitch[1]
                if s == storeys - 1 and rng.random() < 0.35:
                    _bars(rng, b, x, y, z0, width)
                elif round_columns:
                    b.tube([(x, y, z0), (x, y, z1)], width / 2, M["concrete"], sides=28, caps=False)
                else:
                    h = width / 2
                    skin = M["ply"] if rng.random() < 0.12 else M["concrete"]
                    b.box((x - h, y - h, z0), (x + h, y + h, z1), skin, bottom=False)
        # The last deck is not poured everywhere yet.
        for i in range(bays[0]):
            for j in range(bays[1]):
                xa, ya = x0 + i * pitch[0], y0 + j * pitch[1]
                xb, yb = xa + pitch[0], ya + pitch[1]
                if (i, j) == stair:
                    if s < storeys - 1:
                        _stair(b, xa + 0.6, ya + 0.6, z0, z1 + thick, min(pitch[0] - 1.2, 4.5))
                    continue
                missing = s == storeys - 1 and rng.random() < 0.45
                if not missing:
                    b.box((xa, ya, z1), (xb, yb, z1 + thick), M["concrete"])
                if missing or rng.random() < 0.25:
                    for px in np.arange(xa + 0.7, xb - 0.3, rng.uniform(1.0, 1.6)):
                        for py in np.arange(ya + 0.7, yb - 0.3, rng.uniform(1.0, 1.6)):
                            b.tube(
                                [(px, py, z0), (px, py, z1 - 0.25)],
                                [0.03, 0.024],
                                M["painted-metal"],
                                sides=7,
                            )
                    if missing:
                        for by in np.arange(ya + 0.7, yb - 0.2, 1.2):
                            b.box(
                                (xa + 0.3, by - 0.04, z1 - 0.25), (xb - 0.3, by + 0.04, z1 - 0.05), M["wood"]
                            )
                        b.box((xa + 0.3, ya + 0.3, z1 - 0.05), (xb - 0.3, yb - 0.3, z1 - 0.03), M["ply"])
        if s < storeys - 1 or rng.random() < 0.4:
            decks.append(z1 + thick)
        _walls(rng, b, low, bays, pitch, z0, z1)
    for _ in range(int(rng.integers(1, 3))):
        side = int(rng.integers(0, 4))
        run = (x1 - x0 if side < 2 else y1 - y0) * rng.uniform(0.5, 1.0)
        mesh = outdoors.scaffold(rng, run, storeys * storey + 1.0)
        gap = over + 0.3
        spot = {
            0: placement(x0 + run, y0 - gap, level - 0.3, math.pi),
            1: placement(x0, y1 + gap, level - 0.3, 0.0),
            2: placement(x0 - gap, y0, level - 0.3, math.pi / 2),
            3: placement(x1 + gap, y0 + run, level - 0.3, -math.pi / 2),
        }[side]
        b.add(mesh.placed(spot))
    for deck in decks:
        for _ in range(int(rng.integers(1, 6))):
            x, y = rng.uniform(x0 + 1, x1 - 1), rng.uniform(y0 + 1, y1 - 1)
            b.add(outdoors.pallet(rng).placed(placement(x, y, deck, rng.uniform(0, 6.3))))
    return decks


def _walls(
    rng: Rng,
    b: MeshBuilder,
    low: tuple[float, float],
    bays: tuple[int, int],
    pitch: tuple[float, float],
    z0: float,
    z1: float,
) -> None:
    """Close some bays: concrete, block work half way up, or formwork panels with their stays."""
    x0, y0 = low
    sides = []
    for i in range(bays[0]):
        for j in (0, bays[1]):
            sides.append(
                (
                    (x0 + i * pitch[0] + 0.3, y0 + j * pitch[1]),
                    (x0 + (i + 1) * pitch[0] - 0.3, y0 + j * pitch[1]),
                )
            )
    for j in range(bays[1]):
        for i in (0, bays[0]):
            sides.append(
                (
                    (x0 + i * pitch[0], y0 + j * pitch[1] + 0.3),
                    (x0 + i * pitch[0], y0 + (j + 1) * pitch[1] - 0.3),
                )
            )
    for start, end in sides:
        kind = rng.random()
        length = math.hypot(end[0] - start[0], end[1] - start[1])
        if kind < 0.25:
            hole = (
                [(length * 0.3, length * 0.6, rng.uniform(0.0, 1.0), rng.uniform(2.0, 2.4))]
                if rng.random() < 0.6
                else []
            )
            b.wall(start, end, z0, z1, 0.25, M["concrete"], openings=hole)
        elif kind < 0.42:
            top = z0 + rng.uniform(0.6, z1 - z0 - 0.1)
            b.wall(start, end, z0, top, 0.24, M["blocks"])
        elif kind < 0.52:
            b.wall(start, end, z0, z1 - 0.4, 0.3, M["ply"])
            dx, dy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
            for along in np.arange(0.5, length - 0.3, 1.3):
                x, y = start[0] + dx * along, start[1] + dy * along
                for side in (-1, 1):
                    foot = (x + side * -dy * 1.6, y + side * dx * 1.6, z0)
                    b.tube(
                        [foot, (x + side * -dy * 0.16, y + side * dx * 0.16, z1 - 0.9)],
                        0.03,
                        M["painted-metal"],
                        sides=7,
                    )


def _bars(rng: Rng, b: MeshBuilder, x: float, y: float, z: float, width: float) -> None:
    """Set the starter bars of a column that is not there yet."""
    tall = rng.uniform(0.8, 2.6)
    for dx in (-0.4, 0.0, 0.4):
        for dy in (-0.4, 0.0, 0.4):
            if dx or dy:
                px, py = x + dx * width, y + dy * width
                b.tube(
                    [(px, py, z), (px + rng.normal(0, 0.02), py + rng.normal(0, 0.02), z + tall)],
                    0.01,
                    M["steel"],
                    sides=5,
                )
    for h in np.arange(0.2, tall, 0.25):
        r = 0.42 * width
        ring = [(x - r, y - r, z + h), (x + r, y - r, z + h), (x + r, y + r, z + h), (x - r, y + r, z + h)]
        for k in range(4):
            b.tube([ring[k], ring[(k + 1) % 4]], 0.006, M["steel"], sides=4, caps=False)


def _stair(b: MeshBuilder, x: float, y: float, z0: float, z1: float, run: float) -> None:
    steps = max(8, round((z1 - z0) / 0.17))
    rise, tread = (z1 - z0) / steps, run / steps
    for k in range(steps):
        b.box(
            (x + k * tread, y, z0 + k * rise - 0.05),
            (x + (k + 1) * tread, y + 1.2, z0 + (k + 1) * rise),
            M["concrete"],
        )


def _cabins(
    rng: Rng, b: MeshBuilder, ground: _Ground, free_spot: Callable[[float], tuple[float, float] | None]
) -> None:
    """One or two groups of containers, side by side and stacked."""
    for _ in range(int(rng.integers(1, 4))):
        spot = free_spot(4.5)
        if spot is None:
            continue
        yaw = rng.uniform(0, 2 * math.pi)
        for k in range(int(rng.integers(1, 4))):
            for tier in range(1 if rng.random() < 0.65 else 2):
                dx, dy = -2.5 * k * math.sin(yaw), 2.5 * k * math.cos(yaw)
                x, y = spot[0] + dx, spot[1] + dy
                z = ground.height(*spot) - 0.05 + tier * 2.62
                b.add(outdoors.container(rng).placed(placement(x, y, z, yaw)))


def _heap(rng: Rng, ground: _Ground, spot: tuple[float, float]) -> Mesh:
    """Heap up a pile of earth, sand or rubble."""
    b = MeshBuilder.drawn(rng)
    radius, tall = rng.uniform(1.8, 3.6), rng.uniform(0.8, 2.4)
    stretch, turn = rng.uniform(0.6, 1.0), rng.uniform(0, math.pi)
    axis = np.linspace(-radius, radius, 41)
    xx, yy = np.meshgrid(axis, axis)
    u = (xx * math.cos(turn) + yy * math.sin(turn)) / radius
    v = (yy * math.cos(turn) - xx * math.sin(turn)) / (radius * stretch)
    seed = np.full(xx.size, int(rng.integers(1 << 32)), np.uint32)
    rough = value_noise(xx.ravel().astype(np.float32), yy.ravel().astype(np.float32), 0.5, seed).reshape(
        xx.shape
    )
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
            b.add(
                outdoors.fence(rng, min(run, half - at)).placed(
                    placement(x, y, low, yaw + rng.normal(0, 0.02))
                )
            )
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
                b.add(house(rng, width).placed(placement(x, y, ground.height(x, y) - 0.6, yaw)))
            at += width + rng.uniform(0, 8)
    for _ in range(int(rng.integers(2, 9))):
        a, far = rng.uniform(0, 2 * math.pi), half + rng.uniform(2, 12)
        x, y = far * math.cos(a), far * math.sin(a)
        still, crown = outdoors.trunk_and_crown(rng)
        spot = placement(x, y, ground.height(x, y) - 0.1)
        b.add(still.placed(spot))
        b.add(crown.placed(spot))


def _walks(
    ground: _Ground, half: float, inside: Callable[[float, float, float], bool], margin: float = 0.8
) -> Callable[[Rng], Float | None]:
    def place(r: Rng) -> Float | None:
        for _ in range(10):
            x, y = r.uniform(-half * 0.8, half * 0.8, 2)
            if not inside(x, y, margin):
                return placement(x, y, ground.height(x, y), r.uniform(0, 2 * math.pi))
        return None

    return place
