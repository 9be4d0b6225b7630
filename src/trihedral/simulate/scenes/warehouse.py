"""A hall with rows of racks: bays that repeat, long aisles, a high roof, few other things."""

import numpy as np

from trihedral.simulate import outdoors, parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng
from trihedral.simulate.scene import Light, Scene, anywhere, movers


def warehouse(seed: int) -> Scene:
    """Make a warehouse."""
    rng = np.random.default_rng((seed, 0x3A3E))
    b = MeshBuilder.drawn(rng)
    length, width, height = rng.uniform(35, 75), rng.uniform(22, 42), rng.uniform(6.5, 11.0)
    x0, y0 = -length / 2, -width / 2
    _hall(rng, b, length, width, height)
    bay, aisle = rng.uniform(2.3, 2.9), rng.uniform(2.6, 3.8)
    levels, step = int(rng.integers(3, 6)), rng.uniform(1.3, 1.8)
    full, free = rng.uniform(0.3, 0.9), rng.uniform(6, 14)
    bays = int((length - free - 3.0) / bay)
    stands: list[tuple[float, float, float]] = []
    y = y0 + 2.0
    while y + 2.4 + aisle < -y0:
        for side in (0.0, 1.2):
            b.put(_rack(rng, bays, bay, levels, step, full), x0 + 2.0, y + side, 0)
        y += 2.4
        stands += [(x, y + aisle / 2, 0.0) for x in np.arange(x0 + 2.0, -x0 - 1.5, 1.3)]
        y += aisle
    stands += [(-x0 - free * u, v, 0.0) for u in (0.2, 0.5, 0.8) for v in np.arange(y0 + 1.5, -y0 - 1.0, 1.5)]
    places = np.array(stands)
    for _ in range(int(rng.integers(4, 14))):
        x, v = -x0 - rng.uniform(1.5, free - 1.0), rng.uniform(y0 + 1.5, -y0 - 1.5)
        b.put(outdoors.pallet(rng), x, v, 0, rng.uniform(0, 6.3))
    moving = movers(rng, parts.person, anywhere(places), 1, 5)
    moving += movers(rng, outdoors.pallet, anywhere(places), 2, 6)
    light = Light((0.6, 0.6, 0.58), 0.08, (0.2, 0.2, 0.2), (0.3, 0.2, 0.93))
    return Scene("warehouse", seed, b.mesh(), moving, light, places, 10.0)


def _hall(rng: Rng, b: MeshBuilder, length: float, width: float, height: float) -> None:
    x0, y0 = -length / 2, -width / 2
    skin = M[str(rng.choice(["painted-metal", "blocks", "concrete"]))]
    gates = []
    at = rng.uniform(2, 6)
    while at + 5 < width:
        gates.append((at, at + 3.6, 0.0, 4.2))
        at += rng.uniform(5.5, 12)
    b.wall((-x0, y0), (-x0, -y0), 0, height, 0.3, skin, openings=gates)
    for a, c, low, high in gates:
        if rng.random() < 0.8:
            b.quad((-x0 + 0.1, y0 + a, low), (0, c - a, 0), (0, 0, high - low), M["painted-metal"])
    b.wall((x0, y0), (x0, -y0), 0, height, 0.3, skin)
    for y in (y0, -y0):
        b.wall((x0, y), (-x0, y), 0, height, 0.3, skin)
    b.quad((x0, y0, 0), (length, 0, 0), (0, width, 0), M["concrete"])
    b.quad((x0, y0, height), (length, 0, 0), (0, width, 0), M["steel"])
    b.quad((x0 - 50, y0 - 50, -0.1), (length + 100, 0, 0), (0, width + 100, 0), M["asphalt"])
    frames = max(3, round(length / rng.uniform(5, 8)))
    for k in range(frames + 1):
        x = x0 + 0.3 + k * (length - 0.6) / frames
        for y in (y0 + 0.35, 0.0, -y0 - 0.35):
            b.box((x - 0.15, y - 0.15, 0), (x + 0.15, y + 0.15, height), M["steel"])
        b.box((x - 0.12, y0 + 0.2, height - 0.75), (x + 0.12, -y0 - 0.2, height - 0.6), M["steel"])
        panels = max(4, round(width / 2.5))
        for i in range(panels):
            ya, yb = y0 + 0.3 + i * (width - 0.6) / panels, y0 + 0.3 + (i + 1) * (width - 0.6) / panels
            low, high = (height - 0.65, height - 0.05) if i % 2 else (height - 0.05, height - 0.65)
            b.tube([(x, ya, low), (x, yb, high)], 0.04, M["steel"], sides=6, caps=False)
        if rng.random() < 0.5:
            b.box((x - 0.8, y0 + 0.16, 1.5), (x + 0.8, y0 + 0.2, 2.6), M["sign"])
    for y in np.arange(y0 + 2, -y0 - 1, rng.uniform(4, 7)):
        for x in np.arange(x0 + 3, -x0 - 2, rng.uniform(5, 9)):
            b.box((x - 0.75, y - 0.12, height - 1.0), (x + 0.75, y + 0.12, height - 0.9), M["lamp"])
    r = rng.uniform(0.15, 0.35)
    b.tube([(x0 + 0.5, y0 + 1.0, height - 1.4), (-x0 - 0.5, y0 + 1.0, height - 1.4)], r, M["steel"], sides=24)


def _rack(rng: Rng, bays: int, bay: float, levels: int, step: float, full: float) -> Mesh:
    """One row of rack along x, 1.1 m deep: frames, beams, and goods in some places."""
    b = MeshBuilder.drawn(rng)
    top = levels * step
    for k in range(bays + 1):
        for y in (0.0, 1.0):
            b.box((k * bay - 0.05, y, 0), (k * bay + 0.05, y + 0.08, top + 0.3), M["painted-metal"])
        for z in np.arange(0.3, top, 0.9):
            b.tube([(k * bay, 0.05, z), (k * bay, 1.05, z + 0.6)], 0.02, M["steel"], sides=6, caps=False)
    for k in range(bays):
        for level in range(levels):
            z = level * step
            if level:
                x0, x1 = k * bay + 0.05, (k + 1) * bay - 0.05
                for y in (0.0, 1.0):
                    b.box((x0, y, z - 0.12), (x1, y + 0.06, z), M["painted-metal"])
            for place in range(2):
                if rng.random() < full:
                    x = k * bay + 0.12 + place * (bay - 0.2) / 2
                    w, d = (bay - 0.5) / 2 * rng.uniform(0.75, 1.0), rng.uniform(0.75, 1.0)
                    h = rng.uniform(0.4, step - 0.35)
                    b.box((x, 0.05, z + 0.005), (x + w, 0.05 + d, z + 0.14), M["wood"])
                    goods = M[str(rng.choice(["cardboard", "cardboard", "white-plastic", "sign", "ply"]))]
                    b.box((x + 0.03, 0.08, z + 0.14), (x + w - 0.03, 0.02 + d, z + 0.14 + h), goods)
                    if rng.random() < 0.5:
                        b.box((x + 0.2, 0.07, z + 0.25), (x + 0.45, 0.078, z + 0.42), M["sign"])
    return b.mesh()
