"""Things that scenes are furnished with; each function returns a mesh in its own frame, standing on z = 0."""

import math

import numpy as np

from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder, Rng
from trihedral.simulate.wall import Point


def desk(rng: Rng) -> Mesh:
    """Desk with screens and small things; the front is towards -y."""
    b = MeshBuilder.drawn(rng)
    w, d, h = rng.uniform(1.2, 2.0), rng.uniform(0.6, 0.85), rng.uniform(0.7, 0.78)
    b.box((-w / 2, -d / 2, h - 0.03), (w / 2, d / 2, h), M["wood"])
    for x in (-w / 2 + 0.04, w / 2 - 0.08):
        for y in (-d / 2 + 0.04, d / 2 - 0.08):
            b.box((x, y, 0), (x + 0.04, y + 0.04, h - 0.03), M["steel"])
    if rng.random() < 0.7:
        b.box((w / 2 - 0.5, -d / 2 + 0.05, 0.05), (w / 2 - 0.1, d / 2 - 0.05, h - 0.1), M["white-plastic"])
    for x in np.linspace(-w / 4, w / 4, int(rng.integers(1, 3))):
        turn = rng.uniform(-0.3, 0.3)
        s = MeshBuilder.drawn(rng)
        s.box((-0.28, -0.02, 0.1), (0.28, 0.02, 0.45), M["screen"])
        s.box((-0.03, 0.02, 0.0), (0.03, 0.06, 0.3), M["plastic"])
        s.box((-0.12, -0.08, 0.0), (0.12, 0.1, 0.015), M["plastic"])
        b.put(s.mesh(), float(x), d * 0.2, h, turn)
    for _ in range(int(rng.integers(1, 6))):
        x, y = rng.uniform(-w / 2 + 0.15, w / 2 - 0.15), rng.uniform(-d / 2 + 0.1, 0.0)
        s = MeshBuilder.drawn(rng)
        sx, sy, sz = rng.uniform(0.1, 0.3), rng.uniform(0.1, 0.25), rng.uniform(0.01, 0.2)
        skin = M[str(rng.choice(["cardboard", "sign", "plastic"]))]
        s.box((-sx / 2, -sy / 2, 0), (sx / 2, sy / 2, sz), skin)
        b.put(s.mesh(), x, y, h, rng.uniform(0, 3))
    return b.mesh()


def chair(rng: Rng) -> Mesh:
    """Office chair on a star foot."""
    b = MeshBuilder.drawn(rng)
    h = rng.uniform(0.42, 0.52)
    b.box((-0.24, -0.24, h), (0.24, 0.24, h + 0.07), M["cloth"])
    b.box((-0.22, 0.2, h + 0.15), (0.22, 0.26, h + 0.65), M["cloth"])
    b.tube([(0, 0, 0.08), (0, 0, h)], 0.03, M["steel"], sides=8)
    for k in range(5):
        a = 2 * math.pi * k / 5
        b.tube([(0, 0, 0.1), (0.3 * math.cos(a), 0.3 * math.sin(a), 0.05)], 0.02, M["plastic"], sides=6)
    return b.mesh()


def shelf(rng: Rng, width: float, height: float, depth: float = 0.35) -> Mesh:
    """Open shelf with rows of books and boxes; its back is at y = 0, the front towards -y."""
    b = MeshBuilder.drawn(rng)
    for x in (0.0, width - 0.02):
        b.box((x, -depth, 0), (x + 0.02, 0, height), M["wood"])
    b.quad((0, -0.005, 0), (width, 0, 0), (0, 0, height), M["wood"])
    levels = max(2, round(height / 0.38))
    for k in range(levels + 1):
        z = k * (height - 0.02) / levels
        b.box((0.02, -depth, z), (width - 0.02, -0.005, z + 0.02), M["wood"])
        if k < levels:
            x = 0.04
            while x < width - 0.15:
                run = min(rng.uniform(0.1, 0.6), width - 0.04 - x)
                if rng.random() < 0.6:
                    low = (x, -depth * rng.uniform(0.6, 0.9), z + 0.02)
                    b.box(low, (x + run, -0.02, z + rng.uniform(0.2, 0.33)), M["books"])
                elif rng.random() < 0.5:
                    low = (x, -depth * rng.uniform(0.5, 0.95), z + 0.02)
                    b.box(low, (x + run * 0.8, -0.03, z + rng.uniform(0.12, 0.3)), M["cardboard"])
                x += run + rng.uniform(0.0, 0.08)
    return b.mesh()


def cabinet(rng: Rng) -> Mesh:
    """Make a cupboard with doors and handles; back at y = 0."""
    b = MeshBuilder.drawn(rng)
    w, d, h = rng.uniform(0.6, 1.4), rng.uniform(0.4, 0.6), rng.uniform(0.7, 2.1)
    kind = M[str(rng.choice(["white-plastic", "wood", "paint-dark"]))]
    b.box((0, -d, 0), (w, 0, h), kind)
    for x in (w / 2 - 0.06, w / 2 + 0.04):
        b.box((x, -d - 0.03, h / 2 - 0.08), (x + 0.02, -d - 0.005, h / 2 + 0.08), M["steel"])
    for _ in range(int(rng.integers(0, 4))):
        x, s = rng.uniform(0.05, w - 0.35), rng.uniform(0.1, 0.3)
        b.box((x, -d * 0.8, h), (x + s, -d * 0.3, h + s * rng.uniform(0.4, 1.2)), M["cardboard"])
    return b.mesh()


def sofa(rng: Rng) -> Mesh:
    """Sofa; back at y = 0."""
    b = MeshBuilder.drawn(rng)
    w = rng.uniform(1.4, 2.3)
    b.box((0, -0.85, 0.1), (w, 0, 0.42), M["cloth"])
    b.box((0, -0.2, 0.42), (w, 0, 0.85), M["cloth"])
    for x in (0.0, w - 0.16):
        b.box((x, -0.85, 0.42), (x + 0.16, -0.2, 0.62), M["cloth"])
    return b.mesh()


def table(rng: Rng) -> Mesh:
    """Round or square table."""
    b = MeshBuilder.drawn(rng)
    h, r = rng.uniform(0.7, 0.76), rng.uniform(0.4, 0.8)
    if rng.random() < 0.5:
        b.tube([(0, 0, h - 0.03), (0, 0, h)], r, M["wood"], sides=28)
        b.tube([(0, 0, 0), (0, 0, h - 0.03)], 0.05, M["steel"], sides=10)
    else:
        half = r * rng.uniform(1.0, 2.2)
        b.box((-half, -r * 0.7, h - 0.03), (half, r * 0.7, h), M["wood"])
        for x in (-half + 0.05, half - 0.1):
            for y in (-r * 0.7 + 0.05, r * 0.7 - 0.1):
                b.box((x, y, 0), (x + 0.05, y + 0.05, h - 0.03), M["wood"])
    return b.mesh()


def leaves(rng: Rng, b: MeshBuilder, centre: Point, radii: Point, count: int, size: float) -> None:
    """Leaves scattered in an ellipsoid, denser towards its skin."""
    direction = rng.standard_normal((count, 3))
    direction /= np.sqrt((direction**2).sum(axis=1))[:, None]
    depth = np.sqrt(rng.uniform(0.2, 1.0, count))[:, None]
    centres = np.array(centre) + direction * depth * np.array(radii) * rng.uniform(0.8, 1.1, (count, 1))
    a = rng.standard_normal((count, 3))
    a /= np.sqrt((a**2).sum(axis=1))[:, None]
    c = np.cross(a, rng.standard_normal((count, 3)))
    c /= np.sqrt((c**2).sum(axis=1))[:, None]
    scale = size * rng.uniform(0.6, 1.3, (count, 1))
    b.cards(centres, a * scale, c * scale * 0.5, M["leaf"])


def potted_plant(rng: Rng) -> Mesh:
    """Plant in a pot."""
    b = MeshBuilder.drawn(rng)
    h = rng.uniform(0.5, 1.6)
    b.tube([(0, 0, 0), (0, 0, 0.35)], [0.14, 0.2], M["plastic"], sides=14)
    b.tube([(0, 0, 0.35), (0.03, 0.02, 0.3 + h * 0.6)], 0.02, M["bark"], sides=6)
    leaves(rng, b, (0, 0, 0.35 + h * 0.6), (0.3, 0.3, h * 0.45), int(rng.integers(40, 110)), 0.1)
    return b.mesh()


def person(rng: Rng) -> Mesh:
    """Someone standing or in mid-step."""
    b = MeshBuilder.drawn(rng)
    s = rng.uniform(0.92, 1.08)
    step = rng.uniform(-0.2, 0.2)
    hip, shoulder = 0.92 * s, 1.42 * s
    for side, swing in ((-0.1, step), (0.1, -step)):
        leg = [(side, swing, 0.05), (side, swing * 0.5, hip / 2), (side, 0, hip)]
        b.tube(leg, [0.06, 0.065, 0.09], M["cloth"], sides=9)
        b.box((side - 0.05, swing - 0.16, 0), (side + 0.05, swing + 0.1, 0.08), M["rubber"])
    b.ball((0, 0, (hip + shoulder) / 2), (0.2, 0.13, (shoulder - hip) / 2 + 0.1), M["cloth"], sides=12)
    for side in (-0.25, 0.25):
        swing = rng.uniform(-0.3, 0.3)
        elbow = (side * 1.1, swing * 0.5, shoulder - 0.35)
        arm = [(side, 0, shoulder - 0.05), elbow, (side, swing, shoulder - 0.6)]
        b.tube(arm, [0.055, 0.05, 0.04], M["cloth"], sides=8)
    b.tube([(0, 0, shoulder), (0, 0, shoulder + 0.12)], 0.05, M["skin"], sides=8)
    b.ball((0, 0, shoulder + 0.22), (0.09, 0.11, 0.13), M["skin"], sides=12)
    return b.mesh()
