"""A street between houses: window reveals, balconies, cornices, kerbs, cars, trees, lamps, people."""

import math
from collections.abc import Callable

import numpy as np

from trihedral.simulate import outdoors, parts
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, placement
from trihedral.simulate.noise import value_noise
from trihedral.simulate.scene import Float, Light, Mover, Scene

Rng = np.random.Generator


def facade(seed: int) -> Scene:
    """Make a street."""
    rng = np.random.default_rng((seed, 0xFACADE))
    b = MeshBuilder(int(rng.integers(1 << 32)))
    length = rng.uniform(60, 110)
    road, pavement = rng.uniform(5.0, 9.0), (rng.uniform(1.8, 4.5), rng.uniform(1.8, 4.5))
    slope, crown = rng.normal(0, 0.012), rng.uniform(0.01, 0.025)
    sides = {-1: road / 2 + pavement[0], 1: road / 2 + pavement[1]}

    def rise(x: float) -> float:
        return slope * x

    _ground(rng, b, length, road, sides, slope, crown)
    for side, front in sides.items():
        one_sided = side == 1 and rng.random() < 0.25
        x = -length / 2 - rng.uniform(0, 4)
        while x < length / 2:
            width = rng.uniform(7, 19)
            if one_sided or rng.random() < 0.12:
                _garden(rng, b, x, x + width, side, front, rise)
                x += width
                continue
            back_off = 0.0 if rng.random() < 0.7 else rng.uniform(0.0, 2.5)
            front_house = house(rng, width)
            yaw = 0.0 if side == 1 else math.pi
            left = x if side == 1 else x + width
            turn = rng.normal(0, 0.012)
            low = min(rise(x), rise(x + width)) - 0.05
            b.add(front_house.placed(placement(left, side * (front + back_off), low, yaw + turn)))
            x += width + (0.0 if rng.random() < 0.6 else rng.uniform(0.5, 4.0))
    for end in (-1, 1):
        if rng.random() < 0.7:
            width = sides[1] + sides[-1] + rng.uniform(4, 10)
            far = end * (length / 2 + rng.uniform(9, 25))
            yaw = -end * math.pi / 2
            front_house = house(rng, width)
            b.add(front_house.placed(placement(far, end * width / 2, rise(far) - 0.1, yaw)))

    movers: list[Mover] = []
    for side, front in sides.items():
        edge = road / 2
        at = -length / 2 + rng.uniform(2, 8)
        step, kind = rng.uniform(6, 16), rng.random()
        while at < length / 2:
            spot = (at + rng.normal(0, 0.5), side * (edge + 0.55), rise(at) + 0.12)
            if kind < 0.6 and front - edge > 2.4:
                still, crown_mesh = outdoors.trunk_and_crown(rng)
                b.add(still.placed(placement(*spot)))
                movers.append(
                    Mover(crown_mesh, _swaying(spot, rng.uniform(0, 6.28), rng.uniform(0.001, 0.008)))
                )
            at += step * rng.uniform(0.7, 1.4)
        at = -length / 2 + rng.uniform(5, 15)
        while at < length / 2:
            yaw = -side * math.pi / 2 + rng.normal(0, 0.1)
            b.add(outdoors.lamp_post(rng).placed(placement(at, side * (edge + 0.4), rise(at) + 0.12, yaw)))
            at += rng.uniform(14, 30)
        for _ in range(int(rng.integers(3, 10))):
            x, y = rng.uniform(-length / 2, length / 2), side * (edge + rng.uniform(0.4, 0.9))
            thing = outdoors.traffic_sign(rng) if rng.random() < 0.5 else outdoors.bin_or_box(rng)
            b.add(thing.placed(placement(x, y, rise(x) + 0.12, rng.uniform(0, 6.3))))
        x = -length / 2
        parked = rng.uniform(0.2, 0.8)
        while x < length / 2:
            if rng.random() < parked:
                mesh = outdoors.car(rng)
                spot3 = (x + 2.5, side * (edge - 1.0), rise(x + 2.5) - 0.02, 0.0 if side < 0 else math.pi)
                if rng.random() < 0.8:
                    b.add(mesh.placed(placement(*spot3)))
                else:
                    movers.append(Mover(mesh, _sometimes(spot3)))
            x += rng.uniform(5.4, 8.5)

    def walking(r: Rng) -> Float:
        x = r.uniform(-length / 2, length / 2)
        side = 1 if r.random() < 0.5 else -1
        y = side * r.uniform(road / 2 + 0.5, sides[side] - 0.3)
        return placement(x, y, rise(x) + 0.12, r.uniform(0, 6.3))

    def driving(r: Rng) -> Float | None:
        if r.random() < 0.4:
            return None
        x = r.uniform(-length / 2, length / 2)
        return placement(x, r.normal(0, 0.3), rise(x), 0.0 if r.random() < 0.5 else math.pi)

    movers += [Mover(parts.person(rng), walking) for _ in range(int(rng.integers(3, 14)))]
    movers += [Mover(outdoors.car(rng), driving) for _ in range(int(rng.integers(1, 4)))]
    stands = []
    for x in np.arange(-length / 2 + 4, length / 2 - 4, 1.5):
        for side, front in sides.items():
            for y in (road / 2 + 0.9, (road / 2 + front) / 2, front - 0.8):
                stands.append((x, side * y, rise(float(x)) + 0.12))
        for y in (-road / 4, 0.0, road / 4):
            stands.append((x, y, rise(float(x)) + crown * (road / 2 - abs(y))))
    sun = rng.uniform(0, 2 * math.pi)
    light = Light(
        (0.50, 0.52, 0.56), 0.18, (0.55, 0.52, 0.45), (0.75 * math.cos(sun), 0.75 * math.sin(sun), 0.66)
    )
    return Scene("facade", seed, b.mesh(), tuple(movers), light, np.array(stands), 15.0)


def _swaying(foot: tuple[float, float, float], yaw: float, amount: float) -> Callable[[Rng], Float]:
    """Bend about the foot by a fraction of a degree, another one at each scan."""

    def place(r: Rng) -> Float:
        pose = placement(*foot, yaw)
        lean = amount * r.standard_normal(2)
        shear = np.eye(4)
        shear[0, 2], shear[1, 2] = lean
        out = pose.copy()
        for i in range(3):
            out[i, 2] = pose[i, 0] * shear[0, 2] + pose[i, 1] * shear[1, 2] + pose[i, 2]
        return out

    return place


def _sometimes(spot: tuple[float, float, float, float]) -> Callable[[Rng], Float | None]:
    def place(r: Rng) -> Float | None:
        return placement(*spot) if r.random() < 0.5 else None

    return place


def _ground(
    rng: Rng, b: MeshBuilder, length: float, road: float, sides: dict[int, float], slope: float, crown: float
) -> None:
    """Road with a crown and small bumps, kerbs, pavements, all along a slope; earth beyond."""
    far = length / 2 + 45
    x = np.arange(-far, far + 0.01, 0.75)
    half = road / 2
    y = np.linspace(-half, half, 25)
    xx, yy = np.meshgrid(x, y)
    seed = np.full(xx.size, int(rng.integers(1 << 32)), np.uint32)
    u, v = xx.ravel().astype(np.float32), yy.ravel().astype(np.float32)
    bumps = 0.008 * value_noise(u, v, 2.3, seed) + 0.015 * value_noise(u, v, 9.0, seed)
    z = slope * xx + crown * (half - np.abs(yy)) + bumps.reshape(xx.shape).astype(float)
    b.heights(x, y, z, M["asphalt"])
    for side, front in sides.items():
        kerb0, kerb1 = half * side, (half + 0.15) * side
        b.quad((-far, kerb0, -slope * far - 0.05), (2 * far, 0, 2 * far * slope), (0, 0, 0.17), M["stone"])
        b.quad(
            (-far, kerb0, -slope * far + 0.12),
            (2 * far, 0, 2 * far * slope),
            (0, kerb1 - kerb0, 0),
            M["stone"],
        )
        y0, y1 = kerb1, (front + 3.0) * side
        b.quad((-far, y0, -slope * far + 0.12), (2 * far, 0, 2 * far * slope), (0, y1 - y0, 0), M["paving"])
        b.quad((-far, y1, -slope * far + 0.1), (2 * far, 0, 2 * far * slope), (0, 50.0 * side, 0), M["grass"])


def _garden(
    rng: Rng, b: MeshBuilder, x0: float, x1: float, side: int, front: float, rise: Callable[[float], float]
) -> None:
    """Leave a gap in the row: a low wall, bushes, trees."""
    y = side * (front + 0.3)
    if rng.random() < 0.7:
        h = rng.uniform(0.6, 1.9)
        low = min(rise(x0), rise(x1)) - 0.1
        b.wall((x0, y), (x1, y), low, low + 0.3 + h, 0.25, M[str(rng.choice(["brick", "stone", "plaster"]))])
    for _ in range(int(rng.integers(2, 7))):
        x, deep = rng.uniform(x0, x1), front + rng.uniform(0.9, 8.0)
        b.add(outdoors.bush(rng).placed(placement(x, side * deep, rise(x) + 0.1)))
    if rng.random() < 0.7:
        still, crown = outdoors.trunk_and_crown(rng)
        spot = placement((x0 + x1) / 2, side * (front + 4.5), rise((x0 + x1) / 2) + 0.1)
        b.add(still.placed(spot))
        b.add(crown.placed(spot))


def house(rng: Rng, width: float) -> Mesh:
    """Build a house whose front is the plane y = 0, seen from -y, from x = 0 to `width`."""
    b = MeshBuilder(int(rng.integers(1 << 32)))
    floors, storey = int(rng.integers(2, 6)), rng.uniform(2.8, 3.8)
    ground, depth = rng.uniform(3.2, 4.5), rng.uniform(7, 12)
    height, thick = ground + (floors - 1) * storey + rng.uniform(0.3, 0.9), rng.uniform(0.3, 0.5)
    skin = M[str(rng.choice(["plaster", "plaster", "brick", "stone", "concrete", "paint"]))]
    trim = M[str(rng.choice(["stone", "concrete", "paint", "plaster"]))]
    bays = max(1, round((width - 0.8) / rng.uniform(1.7, 3.4)))
    pitch = (width - 0.8) / bays
    ww, wh = pitch * rng.uniform(0.38, 0.62), storey * rng.uniform(0.45, 0.62)
    sill = rng.uniform(0.5, 0.95)
    openings: list[tuple[float, float, float, float]] = []
    panes: list[tuple[float, float, float, float, int]] = []
    shop = rng.random() < 0.4
    door_bay = int(rng.integers(0, bays))
    for i in range(bays):
        middle = 0.4 + (i + 0.5) * pitch
        if i == door_bay:
            w = min(1.3, pitch * 0.7)
            openings.append((middle - w / 2, middle + w / 2, 0.15, 2.5))
            b.box((middle - w / 2, thick * 0.3, 0.15), (middle + w / 2, thick * 0.3 + 0.06, 2.5), M["wood"])
        elif shop:
            w = pitch * 0.82
            panes.append((middle - w / 2, middle + w / 2, 0.5, ground - 0.8, 0))
        else:
            panes.append(
                (middle - ww / 2, middle + ww / 2, sill + 0.4, min(sill + 0.4 + wh, ground - 0.4), 0)
            )
        for f in range(1, floors):
            z = ground + (f - 1) * storey + sill
            if rng.random() < 0.96:
                panes.append((middle - ww / 2, middle + ww / 2, z, z + wh, f))
    openings += [p[:4] for p in panes]
    y = thick / 2
    b.wall((0, y), (width, y), 0, height, thick, skin, openings=sorted(openings), reveal=trim)
    deep = thick * rng.uniform(0.3, 0.7)
    balconies = rng.random() < 0.4
    balcony_bays = set(rng.choice(bays, size=max(1, bays // 2), replace=False).tolist())
    for x0, x1, z0, z1, f in panes:
        _pane(rng, b, x0, x1, z0, z1, deep)
        b.box((x0 - 0.06, -0.07, z0 - 0.07), (x1 + 0.06, 0.02, z0 - 0.005), trim)
        if f and rng.random() < 0.1:
            b.quad((x0 + 0.03, deep + 0.15, z0), (x1 - x0 - 0.06, 0, 0), (0, 0, z1 - z0), M["cloth"])
        bay = int((x0 - 0.4) / pitch)
        if f and balconies and bay in balcony_bays:
            _balcony(rng, b, x0 - 0.3, x1 + 0.3, ground + (f - 1) * storey)
    for k in range(floors):
        z = ground + (k - 1) * storey if k else 0.0
        b.quad((0, thick, z + 0.02), (width, 0, 0), (0, depth - thick, 0), M["wood"])
        b.quad((0, thick, z + storey * 0.88), (width, 0, 0), (0, depth - thick, 0), M["paint"])
        wall = rng.uniform(3.0, 5.0)
        b.quad((0, wall, z), (width, 0, 0), (0, 0, storey), M["paint"])
    for k in range(1, floors):
        if rng.random() < 0.6:
            z = ground + (k - 1) * storey
            b.box((0, -0.08, z - 0.1), (width, 0.02, z + 0.06), trim)
    out = rng.uniform(0.15, 0.5)
    b.box((-0.02, -out, height - 0.3), (width + 0.02, 0.05, height), trim)
    b.quad((0, depth, 0), (width, 0, 0), (0, 0, height), skin)
    for x in (0.0, width):
        b.quad((x, 0.01, 0), (0, depth, 0), (0, 0, height), skin)
    ridge = height + rng.uniform(0.3, 3.5)
    for y0 in (-out, depth + out):
        b.quad((-0.1, y0, height), (width + 0.2, 0, 0), (0, depth / 2 - y0, ridge - height), M["stone"])
    for x in rng.uniform(0.15, width - 0.15, int(rng.integers(1, 3))):
        b.tube([(x, -0.08, 0.1), (x, -0.08, height - 0.35)], 0.05, M["steel"], sides=12)
    if shop:
        x0 = rng.uniform(0.3, width * 0.3)
        b.box((x0, -0.12, ground - 0.7), (x0 + width * 0.5, -0.02, ground - 0.15), M["sign"])
    for _ in range(int(rng.integers(0, 3))):
        x, w = rng.uniform(0.2, width - 1.0), rng.uniform(0.3, 0.7)
        b.box((x, -0.03, 1.3), (x + w, -0.005, 1.3 + w * 1.3), M["sign"])
    return b.mesh()


def _pane(rng: Rng, b: MeshBuilder, x0: float, x1: float, z0: float, z1: float, deep: float) -> None:
    """Glass with a frame and bars, set back in its reveal."""
    bar = 0.07
    b.quad((x0, deep + 0.03, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), M["glass"])
    frame = M["white-plastic"] if rng.random() < 0.7 else M["wood"]
    for z in (z0, z1 - bar):
        b.box((x0, deep, z), (x1, deep + 0.06, z + bar), frame)
    middle = (x0 + x1) / 2
    for x in (x0, middle - bar / 2, x1 - bar):
        b.box((x, deep, z0 + bar), (x + bar, deep + 0.06, z1 - bar), frame)
    if rng.random() < 0.35:
        share = rng.uniform(0.2, 0.9)
        b.quad((x0, deep + 0.08, z1), (x1 - x0, 0, 0), (0, 0, -(z1 - z0) * share), M["white-plastic"])


def _balcony(rng: Rng, b: MeshBuilder, x0: float, x1: float, z: float) -> None:
    out = rng.uniform(0.8, 1.4)
    b.box((x0, -out, z - 0.08), (x1, 0.0, z + 0.08), M["concrete"])
    for zz in (z + 0.25, z + 1.05):
        b.tube([(x0, -out + 0.03, zz), (x1, -out + 0.03, zz)], 0.02, M["steel"], sides=6)
    for x in np.arange(x0 + 0.06, x1, 0.12):
        b.tube(
            [(x, -out + 0.03, z + 0.08), (x, -out + 0.03, z + 1.05)], 0.008, M["steel"], sides=4, caps=False
        )
    for x in (x0, x1):
        b.quad((x, -out, z + 0.1), (0, out, 0), (0, 0, 0.9), M["glass"] if rng.random() < 0.4 else M["steel"])
