"""A house as seen from the street: window reveals, shop, door, balconies, cornices, signs."""

from dataclasses import dataclass

import numpy as np

from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng
from trihedral.simulate.wall import Opening


def house(rng: Rng, width: float) -> Mesh:
    """Build a house whose front is the plane y = 0, seen from -y, from x = 0 to `width`."""
    b = MeshBuilder.drawn(rng)
    plan = _Plan.drawn(rng, width)
    panes = _front(rng, b, plan)
    _windows(rng, b, plan, panes)
    _storeys(rng, b, plan)
    _outline(rng, b, plan)
    _fittings(rng, b, plan)
    return b.mesh()


@dataclass(frozen=True)
class _Plan:
    """Sizes, metres, and materials; windows lie in bays, one every `pitch`, and are of one size."""

    width: float
    floors: int
    storey: float
    #: Height of the ground floor, `storey` is that of the others.
    ground: float
    depth: float
    height: float
    thick: float
    skin: int
    trim: int
    bays: int
    pitch: float
    #: Width and height.
    window: tuple[float, float]
    #: Height of windows above their floor.
    sill: float
    shop: bool

    @staticmethod
    def drawn(rng: Rng, width: float) -> "_Plan":
        floors, storey = int(rng.integers(2, 6)), rng.uniform(2.8, 3.8)
        ground, depth = rng.uniform(3.2, 4.5), rng.uniform(7, 12)
        height, thick = ground + (floors - 1) * storey + rng.uniform(0.3, 0.9), rng.uniform(0.3, 0.5)
        skin = M[str(rng.choice(["plaster", "plaster", "brick", "stone", "concrete", "paint"]))]
        trim = M[str(rng.choice(["stone", "concrete", "paint", "plaster"]))]
        bays = max(1, round((width - 0.8) / rng.uniform(1.7, 3.4)))
        pitch = (width - 0.8) / bays
        window = (pitch * rng.uniform(0.38, 0.62), storey * rng.uniform(0.45, 0.62))
        sill, shop = rng.uniform(0.5, 0.95), rng.random() < 0.4
        return _Plan(
            width, floors, storey, ground, depth, height, thick, skin, trim, bays, pitch, window, sill, shop
        )

    def floor(self, number: int) -> float:
        """Height of the floor of an upper storey, counted from 1."""
        return self.ground + (number - 1) * self.storey


def _front(rng: Rng, b: MeshBuilder, plan: _Plan) -> list[tuple[Opening, int]]:
    """Wall and door; returns the windows and the storeys they are in."""
    doors: list[Opening] = []
    panes: list[tuple[Opening, int]] = []
    (ww, wh), ground, sill = plan.window, plan.ground, plan.sill
    door_bay = int(rng.integers(0, plan.bays))
    for i in range(plan.bays):
        middle = 0.4 + (i + 0.5) * plan.pitch
        left, right = middle - ww / 2, middle + ww / 2
        if i == door_bay:
            w, y = min(1.3, plan.pitch * 0.7), plan.thick * 0.3
            doors.append((middle - w / 2, middle + w / 2, 0.15, 2.5))
            b.box((middle - w / 2, y, 0.15), (middle + w / 2, y + 0.06, 2.5), M["wood"])
        elif plan.shop:
            w = plan.pitch * 0.82
            panes.append(((middle - w / 2, middle + w / 2, 0.5, ground - 0.8), 0))
        else:
            panes.append(((left, right, sill + 0.4, min(sill + 0.4 + wh, ground - 0.4)), 0))
        for f in range(1, plan.floors):
            z = plan.floor(f) + sill
            if rng.random() < 0.96:
                panes.append(((left, right, z, z + wh), f))
    openings, y = sorted([*doors, *(opening for opening, _ in panes)]), plan.thick / 2
    b.wall(
        (0, y), (plan.width, y), 0, plan.height, plan.thick, plan.skin, openings=openings, reveal=plan.trim
    )
    return panes


def _windows(rng: Rng, b: MeshBuilder, plan: _Plan, panes: list[tuple[Opening, int]]) -> None:
    """Glass, sills, curtains and balconies."""
    deep = plan.thick * rng.uniform(0.3, 0.7)
    balconies = rng.random() < 0.4
    bays = set(rng.choice(plan.bays, size=max(1, plan.bays // 2), replace=False).tolist())
    for (x0, x1, z0, z1), f in panes:
        _pane(rng, b, (x0, x1, z0, z1), deep)
        b.box((x0 - 0.06, -0.07, z0 - 0.07), (x1 + 0.06, 0.02, z0 - 0.005), plan.trim)
        if f and rng.random() < 0.1:
            b.quad((x0 + 0.03, deep + 0.15, z0), (x1 - x0 - 0.06, 0, 0), (0, 0, z1 - z0), M["cloth"])
        if f and balconies and int((x0 - 0.4) / plan.pitch) in bays:
            _balcony(rng, b, x0 - 0.3, x1 + 0.3, plan.floor(f))


def _storeys(rng: Rng, b: MeshBuilder, plan: _Plan) -> None:
    """What is seen inside through the windows, and cornices between storeys."""
    width, deep = plan.width, plan.depth - plan.thick
    for k in range(plan.floors):
        z = plan.floor(k) if k else 0.0
        b.quad((0, plan.thick, z + 0.02), (width, 0, 0), (0, deep, 0), M["wood"])
        b.quad((0, plan.thick, z + plan.storey * 0.88), (width, 0, 0), (0, deep, 0), M["paint"])
        b.quad((0, rng.uniform(3.0, 5.0), z), (width, 0, 0), (0, 0, plan.storey), M["paint"])
    for k in range(1, plan.floors):
        if rng.random() < 0.6:
            z = plan.floor(k)
            b.box((0, -0.08, z - 0.1), (width, 0.02, z + 0.06), plan.trim)


def _outline(rng: Rng, b: MeshBuilder, plan: _Plan) -> None:
    """Eaves, sides, back and roof."""
    width, depth, height = plan.width, plan.depth, plan.height
    out = rng.uniform(0.15, 0.5)
    b.box((-0.02, -out, height - 0.3), (width + 0.02, 0.05, height), plan.trim)
    b.quad((0, depth, 0), (width, 0, 0), (0, 0, height), plan.skin)
    for x in (0.0, width):
        b.quad((x, 0.01, 0), (0, depth, 0), (0, 0, height), plan.skin)
    ridge = height + rng.uniform(0.3, 3.5)
    for y in (-out, depth + out):
        b.quad((-0.1, y, height), (width + 0.2, 0, 0), (0, depth / 2 - y, ridge - height), M["stone"])


def _fittings(rng: Rng, b: MeshBuilder, plan: _Plan) -> None:
    """Downpipes and signs on the front."""
    width = plan.width
    for x in rng.uniform(0.15, width - 0.15, int(rng.integers(1, 3))):
        b.tube([(x, -0.08, 0.1), (x, -0.08, plan.height - 0.35)], 0.05, M["steel"], sides=12)
    if plan.shop:
        x = rng.uniform(0.3, width * 0.3)
        b.box((x, -0.12, plan.ground - 0.7), (x + width * 0.5, -0.02, plan.ground - 0.15), M["sign"])
    for _ in range(int(rng.integers(0, 3))):
        x, w = rng.uniform(0.2, width - 1.0), rng.uniform(0.3, 0.7)
        b.box((x, -0.03, 1.3), (x + w, -0.005, 1.3 + w * 1.3), M["sign"])


def _pane(rng: Rng, b: MeshBuilder, opening: Opening, deep: float) -> None:
    """Glass with a frame and bars, set back in its reveal."""
    x0, x1, z0, z1 = opening
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
        bar = [(x, -out + 0.03, z + 0.08), (x, -out + 0.03, z + 1.05)]
        b.tube(bar, 0.008, M["steel"], sides=4, caps=False)
    for x in (x0, x1):
        b.quad((x, -out, z + 0.1), (0, out, 0), (0, 0, 0.9), M["glass"] if rng.random() < 0.4 else M["steel"])
