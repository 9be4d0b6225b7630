"""Things that stand outside; each function returns a mesh in its own frame, standing on z = 0."""

import math

import numpy as np

from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng, joined
from trihedral.simulate.parts import leaves


def trunk_and_crown(rng: Rng) -> tuple[Mesh, Mesh]:
    """Grow a tree in two parts: what stands still, and the crown that the wind moves."""
    still, crown = MeshBuilder.drawn(rng), MeshBuilder.drawn(rng)
    height, radius = rng.uniform(4.0, 11.0), rng.uniform(0.09, 0.28)
    fork = height * rng.uniform(0.3, 0.45)
    bend = rng.normal(0, 0.15, (4, 2))
    path = [(bend[k, 0] * k / 3, bend[k, 1] * k / 3, fork * k / 3) for k in range(4)]
    still.tube(path, [radius * 1.25, radius, radius * 0.9, radius * 0.8], M["bark"], sides=16)
    top = np.array(path[-1])
    for _ in range(int(rng.integers(4, 9))):
        turn, lift = rng.uniform(0, 2 * math.pi), rng.uniform(0.5, 1.3)
        reach = (height - fork) * rng.uniform(0.4, 0.75)
        tip = top + reach * np.array(
            [math.cos(turn) * math.cos(lift), math.sin(turn) * math.cos(lift), math.sin(lift)]
        )
        middle = (top + tip) / 2 + rng.normal(0, 0.12, 3)
        crown.tube([top, middle, tip], [radius * 0.6, radius * 0.35, 0.02], M["bark"], sides=7, caps=False)
        r = rng.uniform(0.8, 1.5) * (height - fork) / 4
        count = int(rng.integers(500, 1100))
        leaves(rng, crown, tuple(tip), (r, r, r * rng.uniform(0.6, 0.9)), count, rng.uniform(0.05, 0.10))
    return still.mesh(), crown.mesh()


def tree(rng: Rng) -> Mesh:
    """Grow a tree that stands still."""
    return joined(trunk_and_crown(rng))


def bush(rng: Rng) -> Mesh:
    """Shrub without a trunk to speak of."""
    b = MeshBuilder.drawn(rng)
    r, h = rng.uniform(0.4, 1.1), rng.uniform(0.5, 1.6)
    leaves(rng, b, (0, 0, h / 2), (r, r, h / 2), int(rng.integers(150, 450)), rng.uniform(0.03, 0.06))
    return b.mesh()


def car(rng: Rng) -> Mesh:
    """Car or van, its length along x."""
    b = MeshBuilder.drawn(rng)
    van = rng.random() < 0.25
    length, width = (rng.uniform(4.8, 5.6), 1.95) if van else (rng.uniform(3.7, 4.8), rng.uniform(1.65, 1.85))
    waist, roof = (1.1, rng.uniform(1.9, 2.4)) if van else (rng.uniform(0.8, 0.95), rng.uniform(1.4, 1.65))
    side = width / 2
    if van:
        lower = [(-0.5, 0.3), (0.5, 0.3), (0.5, 0.75), (0.38, 1.05), (-0.5, 1.1)]
        cabin = [(-0.5, waist), (0.38, waist), (0.24, roof), (-0.49, roof)]
    else:
        lower = [(-0.5, 0.32), (0.5, 0.32), (0.5, 0.62), (0.26, waist), (-0.36, waist), (-0.5, waist - 0.1)]
        cabin = [(-0.38, waist), (0.26, waist), (0.1, roof), (-0.26, roof)]
    for outline, inset, skin in ((lower, 0.0, "car-paint"), (cabin, 0.12, "car-paint")):
        points = [(x * length, z) for x, z in outline]
        w = side - inset
        for y, order in ((-w, 1), (w, -1)):
            ring = [(x, y, z) for x, z in points][::order]
            flat = [(x, z) for x, z in points][::order]
            fan = [[0, k, k + 1] for k in range(1, len(ring) - 1)]
            b.surface(ring, fan, flat, M[skin])
        for (x0, z0), (x1, z1) in zip(points, points[1:] + points[:1], strict=True):
            b.quad((x0, -w, z0), (x1 - x0, 0, z1 - z0), (0, 2 * w, 0), M[skin])
    # Windows lie a finger's breadth before the cabin's skin.
    w = side - 0.12 + 0.01
    x0, x1 = cabin[0][0] * length + 0.25, cabin[1][0] * length - 0.3
    z0, z1 = waist + 0.06, roof - 0.12
    for y in (-w, w):
        b.quad((x0, y, z0), (x1 - x0 - 0.1, 0, 0), (-0.05, 0, z1 - z0), M["screen"])
    for x in (-0.31 * length, 0.31 * length):
        for y in (-side + 0.02, side - 0.22):
            b.tube([(x, y, 0.31), (x, y + 0.2, 0.31)], 0.31, M["rubber"], sides=18)
    b.box((length / 2 - 0.02, -0.26, 0.42), (length / 2 + 0.02, 0.26, 0.53), M["sign"])
    return b.mesh()


def lamp_post(rng: Rng) -> Mesh:
    """Street lamp with an arm along +x."""
    b = MeshBuilder.drawn(rng)
    h, arm = rng.uniform(4.0, 8.0), rng.uniform(0.4, 1.6)
    b.tube([(0, 0, 0), (0, 0, 1.0), (0, 0, h)], [0.09, 0.08, 0.05], M["steel"], sides=14)
    b.tube([(0, 0, h - 0.05), (arm, 0, h + 0.1)], 0.035, M["steel"], sides=8)
    b.box((arm - 0.1, -0.13, h + 0.02), (arm + 0.45, 0.13, h + 0.14), M["lamp"])
    return b.mesh()


def traffic_sign(rng: Rng) -> Mesh:
    """Post with one or two boards that face -y."""
    b = MeshBuilder.drawn(rng)
    h = rng.uniform(2.2, 3.0)
    b.tube([(0, 0, 0), (0, 0, h)], 0.03, M["steel"], sides=10)
    w = rng.uniform(0.35, 0.6)
    b.box((-w / 2, -0.06, h - w), (w / 2, -0.04, h), M["sign"])
    if rng.random() < 0.5:
        b.box((-w / 2, -0.06, h - w - 0.35), (w / 2, -0.04, h - w - 0.05), M["sign"])
    return b.mesh()


def bin_or_box(rng: Rng) -> Mesh:
    """Bin, cable cabinet or bollard."""
    b = MeshBuilder.drawn(rng)
    kind = int(rng.integers(0, 3))
    if kind == 0:
        b.tube([(0, 0, 0), (0, 0, 0.9)], [0.2, 0.25], M["plastic"], sides=18)
    elif kind == 1:
        w, h = rng.uniform(0.6, 1.4), rng.uniform(0.9, 1.4)
        b.box((-w / 2, -0.2, 0), (w / 2, 0.2, h), M["painted-metal"])
        b.box((-w / 4, -0.215, h * 0.5), (w / 4, -0.205, h * 0.9), M["sign"])
    else:
        b.tube([(0, 0, 0), (0, 0, 0.8), (0, 0, 0.9)], [0.1, 0.1, 0.04], M["stone"], sides=16)
    return b.mesh()


def container(rng: Rng) -> Mesh:
    """Site cabin or freight container with ribs, a door and windows; its length along x."""
    b = MeshBuilder.drawn(rng)
    length = float(rng.choice([3.0, 6.06, 6.06]))
    width, height = 2.44, 2.6
    freight = rng.random() < 0.5
    wall = M["painted-metal"]
    b.box((0, 0, 0.12), (length, width, height), wall)
    if freight:
        # Ribs that stand out 3 cm, every 30 cm.
        for k in range(int(length / 0.3)):
            x = 0.1 + 0.3 * k
            for y0, y1 in ((-0.03, 0.0), (width, width + 0.03)):
                b.box((x, y0, 0.25), (x + 0.12, y1, height - 0.15), wall)
    else:
        b.box((0.4, -0.03, 0.15), (1.35, -0.005, 2.15), M["white-plastic"])
        x = 2.0
        while x + 1.0 < length:
            b.box((x, -0.05, 1.0), (x + 0.9, -0.01, 2.0), M["white-plastic"])
            b.quad((x + 0.07, -0.055, 1.07), (0.76, 0, 0), (0, 0, 0.86), M["screen"])
            x += 1.6
        b.box((length * 0.55, -0.025, 2.1), (length * 0.55 + 1.2, -0.005, 2.45), M["sign"])
    return b.mesh()


def scaffold(rng: Rng, length: float, height: float) -> Mesh:
    """Facade scaffolding: standards, ledgers, boards, diagonals, toe boards; along x, 0.75 m deep in y."""
    b = MeshBuilder.drawn(rng)
    bay = float(rng.choice([2.07, 2.57, 3.07]))
    bays, lifts = max(1, int(length / bay)), max(1, int(height / 2.0))
    for i in range(bays + 1):
        for y in (0.0, 0.75):
            b.tube([(i * bay, y, 0), (i * bay, y, lifts * 2.0 + 1.0)], 0.024, M["steel"], sides=8)
        for k in range(1, lifts + 1):
            b.tube([(i * bay, 0, 2.0 * k), (i * bay, 0.75, 2.0 * k)], 0.024, M["steel"], sides=6)
    for k in range(1, lifts + 1):
        z = 2.0 * k
        for i in range(bays):
            x0, x1 = i * bay, (i + 1) * bay
            if rng.random() < 0.92:
                b.box((x0 + 0.03, 0.05, z + 0.02), (x1 - 0.03, 0.36, z + 0.06), M["wood"])
                b.box((x0 + 0.03, 0.39, z + 0.02), (x1 - 0.03, 0.70, z + 0.06), M["wood"])
                b.box((x0 + 0.03, -0.01, z + 0.05), (x1 - 0.03, 0.02, z + 0.2), M["wood"])
            for up in (0.5, 1.0):
                b.tube([(x0, 0, z + up), (x1, 0, z + up)], 0.02, M["steel"], sides=6)
            if (i + k) % 3 == 0:
                b.tube([(x0, 0.02, z - 2.0), (x1, 0.02, z)], 0.024, M["steel"], sides=6)
    for i in range(bays):
        if rng.random() < 0.25:
            x0, k = i * bay, int(rng.integers(0, lifts))
            b.quad((x0, -0.04, 2.0 * k + 0.3), (bay, 0, 0), (0, 0, 1.6), M["cloth"])
    return b.mesh()


def excavator(rng: Rng) -> Mesh:
    """Tracked excavator with a bent arm along +x."""
    b = MeshBuilder.drawn(rng)
    for y in (-1.1, 0.6):
        b.box((-1.8, y, 0.15), (1.8, y + 0.5, 0.8), M["rubber"])
        for x in (-1.8, 1.8):
            b.tube([(x, y, 0.475), (x, y + 0.5, 0.475)], 0.33, M["rubber"], sides=16)
    top = MeshBuilder.drawn(rng)
    top.box((-1.9, -1.2, 0.95), (1.2, 1.2, 1.3), M["painted-metal"])
    top.box((-1.9, -1.2, 1.3), (-0.4, 1.2, 2.1), M["painted-metal"])
    top.box((0.0, 0.2, 1.3), (1.2, 1.15, 2.8), M["painted-metal"])
    top.quad((1.21, 0.3, 1.7), (0, 0.75, 0), (0, 0, 1.0), M["screen"])
    top.quad((0.1, 1.16, 1.7), (1.0, 0, 0), (0, 0, 1.0), M["screen"])
    top.tube([(-0.2, 0.0, 0.7), (-0.2, 0.0, 0.95)], 0.7, M["steel"], sides=24)
    lift = rng.uniform(1.0, 1.8)
    elbow, hand = (3.4, -0.35, 1.6 + lift), (rng.uniform(4.6, 5.6), -0.35, rng.uniform(0.8, 1.6))
    boom = [(0.8, -0.35, 1.5), (2.2, -0.35, 1.9 + lift), elbow]
    top.tube(boom, [0.22, 0.2, 0.16], M["painted-metal"], sides=8)
    top.tube([elbow, hand], [0.17, 0.12], M["painted-metal"], sides=8)
    top.ball((hand[0] - 0.2, -0.35, hand[2] - 0.3), (0.45, 0.5, 0.35), M["steel"], sides=10)
    b.put(top.mesh(), 0, 0, 0, rng.uniform(-1.5, 1.5))
    return b.mesh()


def fence(rng: Rng, length: float) -> Mesh:
    """Site fence along x: framed panels of bars on feet, some of them closed boards with signs."""
    b = MeshBuilder.drawn(rng)
    panel = 3.5
    for i in range(max(1, int(length / panel))):
        x0, x1 = i * panel + 0.03, (i + 1) * panel - 0.03
        b.box((x0 - 0.1, -0.3, 0), (x0 + 0.1, 0.3, 0.14), M["concrete"])
        for x in (x0, x1):
            b.tube([(x, 0, 0.1), (x, 0, 2.0)], 0.02, M["steel"], sides=6)
        for z in (0.2, 1.98):
            b.tube([(x0, 0, z), (x1, 0, z)], 0.02, M["steel"], sides=6)
        if rng.random() < 0.25:
            b.box((x0, -0.02, 0.2), (x1, 0.02, 1.98), M["ply"])
            b.box((x0 + 0.8, -0.035, 0.9), (x0 + 2.2, -0.025, 1.7), M["sign"])
        else:
            for x in np.arange(x0 + 0.15, x1, 0.15):
                b.tube([(x, 0, 0.2), (x, 0, 1.98)], 0.004, M["steel"], sides=3, caps=False)
    return b.mesh()


def pile_of_pipes(rng: Rng) -> Mesh:
    """Pipes stacked in a triangle, along y."""
    b = MeshBuilder.drawn(rng)
    r, length, wide = rng.uniform(0.06, 0.35), rng.uniform(2.0, 6.0), int(rng.integers(2, 6))
    skin = M[str(rng.choice(["concrete", "plastic", "steel"]))]
    for row in range(wide):
        for k in range(wide - row):
            x, z = (2 * k + row) * r * 1.01, r + row * r * math.sqrt(3)
            b.tube([(x, 0, z), (x, length, z)], r, skin, sides=20, caps=False)
            b.tube([(x, 0, z), (x, length, z)], r * 0.88, skin, sides=20, caps=False)
    return b.mesh()


def pallet(rng: Rng) -> Mesh:
    """Pallet with bricks, bags, boards or nothing on it."""
    b = MeshBuilder.drawn(rng)
    for y in (0.0, 0.35, 0.7):
        b.box((0, y, 0), (1.2, y + 0.1, 0.1), M["wood"])
    for x in np.arange(0.0, 1.15, 0.19):
        b.box((x, 0, 0.1), (x + 0.14, 0.8, 0.13), M["wood"])
    load = int(rng.integers(0, 4))
    if load == 1:
        b.box((0.05, 0.03, 0.13), (1.15, 0.77, 0.13 + rng.uniform(0.4, 1.0)), M["brick"])
    elif load == 2:
        for k in range(int(rng.integers(3, 8))):
            x, y, z = rng.uniform(0.3, 0.9), rng.uniform(0.25, 0.55), 0.2 + 0.1 * k
            b.ball((x, y, z), (0.35, 0.22, 0.08), M["cardboard"], sides=12)
    elif load == 3:
        for k in range(int(rng.integers(3, 10))):
            off = rng.uniform(-0.1, 0.1)
            b.box((-0.8 + off, 0.05, 0.13 + 0.045 * k), (2.0 + off, 0.75, 0.17 + 0.045 * k), M["ply"])
    return b.mesh()


def tower(rng: Rng, height: float) -> Mesh:
    """Crane mast: four legs with lattice, on a block."""
    b = MeshBuilder.drawn(rng)
    w = rng.uniform(1.2, 2.0)
    b.box((-w, -w, -0.3), (w, w, 0.6), M["concrete"])
    corners = [(-w / 2, -w / 2), (w / 2, -w / 2), (w / 2, w / 2), (-w / 2, w / 2)]
    for x, y in corners:
        b.box((x - 0.07, y - 0.07, 0.6), (x + 0.07, y + 0.07, height), M["painted-metal"])
    z, side = 0.6, 0
    while z + w <= height:
        for k in range(4):
            (xa, ya), (xb, yb) = corners[k], corners[(k + 1) % 4]
            low, high = (z, z + w) if (side + k) % 2 else (z + w, z)
            b.tube([(xa, ya, low), (xb, yb, high)], 0.035, M["painted-metal"], sides=6, caps=False)
            b.tube([(xa, ya, z), (xb, yb, z)], 0.03, M["painted-metal"], sides=6, caps=False)
        z += w
        side += 1
    return b.mesh()


def tank(rng: Rng) -> Mesh:
    """Silo or tank on legs, with a domed top."""
    b = MeshBuilder.drawn(rng)
    r, h, leg = rng.uniform(0.7, 1.5), rng.uniform(1.8, 4.5), rng.uniform(0.3, 1.6)
    b.tube([(0, 0, leg), (0, 0, leg + h)], r, M["painted-metal"], sides=32)
    b.ball((0, 0, leg + h), (r, r, r * 0.4), M["painted-metal"], sides=28)
    for k in range(4):
        a = math.pi / 4 + k * math.pi / 2
        x, y = 0.85 * r * math.cos(a), 0.85 * r * math.sin(a)
        b.box((x - 0.06, y - 0.06, 0), (x + 0.06, y + 0.06, leg + 0.1), M["steel"])
    return b.mesh()
