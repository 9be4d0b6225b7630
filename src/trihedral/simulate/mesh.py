"""Triangle meshes put together from parametric parts; faces have a material, a texture and a surface id."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trihedral.geometry.arrays import Float64
from trihedral.simulate.noise import hash32
from trihedral.simulate.wall import Course, Opening

Rng = np.random.Generator

OBJECT_BITS = 12


@dataclass(frozen=True)
class Mesh:
    """Triangles and what they are made of."""

    #: (V, 3) float32, metres. These rounded values *are* the scene: truth is computed from them in float64.
    vertices: NDArray[np.float32]
    #: (F, 3) int32.
    faces: NDArray[np.int32]
    #: (F, 3, 2) float32 texture coordinates of the corners, metres along the surface.
    uv: NDArray[np.float32]
    #: (F,) int16, index into `material.MATERIALS`.
    material: NDArray[np.int16]
    #: (F,) int32; faces of one smooth or planar surface share it, no two surfaces do.
    surface: NDArray[np.int32]
    #: (F,) uint32 seed of the surface's texture; its upper `OBJECT_BITS` are those of the whole object, so
    #: that all sides of one car have one colour.
    texture: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.faces)

    @property
    def surfaces(self) -> int:
        """One more than the largest surface id."""
        return int(self.surface.max()) + 1 if len(self.surface) else 0

    def placed(self, project_from_part: Float64, *, texture: int | None = None) -> "Mesh":
        """Move the mesh; `texture` mixes a new seed into every surface, None keeps the looks."""
        rotation, shift = project_from_part[:3, :3], project_from_part[:3, 3]
        vertices = rotated(rotation, self.vertices.astype(np.float64)) + shift
        seeds = self.texture
        if texture is not None:
            own = hash32(seeds >> np.uint32(32 - OBJECT_BITS), np.uint32(texture & 0xFFFFFFFF))
            seeds = texture_seeds(own, seeds)
        return Mesh(vertices.astype(np.float32), self.faces, self.uv, self.material, self.surface, seeds)

    def bounds(self) -> tuple[Float64, Float64]:
        """Lowest and highest corner, (3,) each."""
        return self.vertices.min(axis=0).astype(np.float64), self.vertices.max(axis=0).astype(np.float64)


def texture_seeds(of_object: NDArray[np.uint32], of_surface: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Join the seeds of objects (their upper bits) and of surfaces (their lower bits)."""
    low = np.uint32((1 << (32 - OBJECT_BITS)) - 1)
    return (of_object & ~low) | (of_surface & low)


def rotated(rotation: Float64, points: Float64) -> Float64:
    """Turn (N, 3) vectors by plain sums of products: a matrix product may be fused differently elsewhere."""
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    return np.stack([rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z for i in range(3)], axis=1)


def joined(meshes: Iterable[Mesh]) -> Mesh:
    """One mesh of many; surface ids are renumbered so that they stay distinct."""
    parts = [m for m in meshes if len(m)]
    if not parts:
        corners, none = np.zeros((0, 3), np.float32), np.zeros(0, np.int32)
        of_faces = np.zeros((0, 3, 2), np.float32), none.astype(np.int16), none, none.astype(np.uint32)
        return Mesh(corners, corners.astype(np.int32), *of_faces)
    vertex_offset = np.cumsum([0] + [len(m.vertices) for m in parts])
    surface_offset = np.cumsum([0] + [m.surfaces for m in parts])
    return Mesh(
        np.concatenate([m.vertices for m in parts]),
        np.concatenate([m.faces + np.int32(o) for m, o in zip(parts, vertex_offset, strict=False)]),
        np.concatenate([m.uv for m in parts]),
        np.concatenate([m.material for m in parts]),
        np.concatenate([m.surface + np.int32(o) for m, o in zip(parts, surface_offset, strict=False)]),
        np.concatenate([m.texture for m in parts]),
    )


def placement(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Float64:
    """4x4 matrix: turn about the vertical by `yaw` radians, then move to (x, y, z)."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


class MeshBuilder:
    """Collects parts; every part becomes one surface, or one for each flat side.

    Texture seeds begin at `seed`: parts added in the same order with the same seed look the same.
    """

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed & 0xFFFFFFFF
        self._vertices: list[Float64] = []
        self._faces: list[NDArray[np.int64]] = []
        self._uv: list[Float64] = []
        self._material: list[int] = []
        self._count: list[int] = []
        self._vertex_count = 0
        self._meshes: list[Mesh] = []

    @staticmethod
    def drawn(rng: Rng) -> "MeshBuilder":
        """Begin with the next seed of `rng`."""
        return MeshBuilder(int(rng.integers(1 << 32)))

    def _object(self) -> NDArray[np.uint32]:
        return hash32(np.array([self._seed], np.uint32), np.uint32(1))

    def add(self, mesh: Mesh) -> None:
        """Add a finished mesh."""
        self._meshes.append(mesh)

    def put(self, mesh: Mesh, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> None:
        """Add a finished mesh turned by `yaw` radians and moved to (x, y, z)."""
        self._meshes.append(mesh.placed(placement(x, y, z, yaw)))

    def surface(self, vertices: ArrayLike, faces: ArrayLike, uv: ArrayLike, material: int) -> None:
        """Add one surface: (V, 3) vertices, (F, 3) faces, (V, 2) texture coordinates in metres."""
        v, f, t = np.asarray(vertices, float), np.asarray(faces, np.int64), np.asarray(uv, float)
        self._vertices.append(v)
        self._faces.append(f + self._vertex_count)
        self._uv.append(t[f])
        self._material.append(material)
        self._count.append(len(f))
        self._vertex_count += len(v)

    def quad(self, corner: ArrayLike, along_u: ArrayLike, along_v: ArrayLike, material: int) -> None:
        """Add a parallelogram."""
        o, u, v = (np.asarray(a, float) for a in (corner, along_u, along_v))
        a, b = _length(u), _length(v)
        corners, uv = [o, o + u, o + u + v, o + v], [[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]]
        self.surface(corners, [[0, 1, 2], [0, 2, 3]], uv, material)

    def box(self, low: Sequence[float], high: Sequence[float], material: int, *, bottom: bool = True) -> None:
        """Add a box with sides along the axes."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
        self.quad((x0, y0, z0), (dx, 0, 0), (0, 0, dz), material)
        self.quad((x1, y1, z0), (-dx, 0, 0), (0, 0, dz), material)
        self.quad((x0, y1, z0), (0, -dy, 0), (0, 0, dz), material)
        self.quad((x1, y0, z0), (0, dy, 0), (0, 0, dz), material)
        self.quad((x0, y0, z1), (dx, 0, 0), (0, dy, 0), material)
        if bottom:
            self.quad((x0, y1, z0), (dx, 0, 0), (0, -dy, 0), material)

    def wall(
        self,
        start: tuple[float, float],
        end: tuple[float, float],
        z0: float,
        z1: float,
        thickness: float,
        material: int,
        *,
        openings: Sequence[Opening] = (),
        back: int | None = None,
        reveal: int | None = None,
    ) -> None:
        """Add a straight wall with two faces and rectangular openings through it.

        Parameters
        ----------
        start, end
            Ends of the centre line; the front face lies to the right when walking from start to end.
        openings
            (from, to, bottom, top): metres along the wall, and heights above `z0`; must not overlap.
        back, reveal
            Materials of the other face and of the openings' inner sides; None: as the front.
        """
        course = Course.between(start, end, z0, z1 - z0, thickness)
        for across, face in ((thickness / 2, material), (-thickness / 2, material if back is None else back)):
            self.surface(*course.face(across, openings), face)
        inner, behind, depth = material if reveal is None else reveal, -thickness / 2, course.depth
        for a0, a1, h0, h1 in openings:
            for a in (a0, a1):
                self.quad(course.at(a, behind, h0), depth, (0.0, 0.0, h1 - h0), inner)
            # An opening that begins at the wall's foot has no sill.
            for h in (h1, h0) if h0 > 0 else (h1,):
                self.quad(course.at(a0, behind, h), course.step(a1 - a0), depth, inner)
        for a in (0.0, course.length):
            self.quad(course.at(a, behind, 0.0), depth, (0, 0, course.height), material)
        if course.height > 0:
            self.quad(course.at(0.0, behind, course.height), course.step(course.length), depth, material)

    def tube(
        self, path: ArrayLike, radius: float | ArrayLike, material: int, *, sides: int = 12, caps: bool = True
    ) -> None:
        """Add a round tube along a polyline: (P, 3) points, one radius or one for each point."""
        p = np.asarray(path, float)
        r = np.broadcast_to(np.asarray(radius, float), (len(p),))
        angles = [2 * math.pi * k / sides for k in range(sides + 1)]
        cosine = np.array([math.cos(a) for a in angles])[None, :, None]
        sine = np.array([math.sin(a) for a in angles])[None, :, None]
        tangent = p[[*range(1, len(p)), -1]] - p[[0, *range(len(p) - 1)]]
        tangent /= np.sqrt(_sums(tangent * tangent))[:, None]
        axis = np.abs(p[-1] - p[0])
        # A helper away from the tube's direction: e1 and e2 span its cross section.
        e1 = _cross(tangent, np.eye(3)[0 if axis[0] <= axis[1:].max() else 1])
        e1 /= np.sqrt(_sums(e1 * e1))[:, None]
        e2 = _cross(tangent, e1)
        rings = p[:, None] + r[:, None, None] * (cosine * e1[:, None] + sine * e2[:, None])
        step = p[1:] - p[:-1]
        along = np.concatenate([[0.0], np.cumsum(np.sqrt(_sums(step * step)))])
        uv = np.empty((len(p), sides + 1, 2))
        uv[:, :, 0], uv[:, :, 1] = np.array(angles) * r.max(), along[:, None]
        n, rings = sides + 1, rings.reshape(-1, 3)
        self.surface(rings, _grid_faces(len(p), n), uv.reshape(-1, 2), material)
        if caps:
            for i in (0, len(p) - 1):
                if r[i] > 0:
                    ring = rings[i * n : i * n + sides]
                    flat = [(r[i] * math.cos(a), r[i] * math.sin(a)) for a in angles[:sides]]
                    self.surface(ring, [[0, k, k + 1] for k in range(1, sides - 1)], flat, material)

    def ball(
        self, centre: Sequence[float], radii: Sequence[float], material: int, *, sides: int = 12
    ) -> None:
        """Add an ellipsoid."""
        stacks = max(4, sides // 2)
        points, uv = [], []
        for i in range(stacks + 1):
            polar = math.pi * i / stacks
            for k in range(sides + 1):
                a = 2 * math.pi * k / sides
                unit = (math.sin(polar) * math.cos(a), math.sin(polar) * math.sin(a), math.cos(polar))
                points.append([c + r * e for c, r, e in zip(centre, radii, unit, strict=True)])
                uv.append((a * max(radii), polar * max(radii)))
        n = sides + 1
        faces = []
        for i in range(stacks):
            for k in range(sides):
                a, b = i * n + k, (i + 1) * n + k
                if i:
                    faces.append([a, b, a + 1])
                if i < stacks - 1:
                    faces.append([a + 1, b, b + 1])
        self.surface(points, faces, uv, material)

    def heights(self, x: ArrayLike, y: ArrayLike, z: ArrayLike, material: int) -> None:
        """Add a height field: grid lines x (nx,), y (ny,), heights (ny, nx)."""
        gx, gy, gz = np.asarray(x, float), np.asarray(y, float), np.asarray(z, float)
        xx, yy = np.meshgrid(gx, gy)
        points = np.stack([xx.ravel(), yy.ravel(), gz.ravel()], axis=1)
        self.surface(points, _grid_faces(len(gy), len(gx)), points[:, :2], material)

    def cards(self, centres: Float64, along: Float64, across: Float64, material: int) -> None:
        """Add many small free quads (leaves): (N, 3) centres and half edges; each is its own surface."""
        n = len(centres)
        corners = np.stack([centres - along, centres + across, centres + along, centres - across], axis=1)
        la, lb = np.sqrt((along**2).sum(axis=1)), np.sqrt((across**2).sum(axis=1))
        zero = np.zeros(n)
        uv = np.stack(
            [np.stack([-la, zero, la, zero], axis=1), np.stack([zero, lb, zero, -lb], axis=1)], axis=2
        )
        split = np.array([[0, 1, 2], [0, 2, 3]])
        numbers = np.arange(n, dtype=np.uint32)
        self._meshes.append(
            Mesh(
                corners.reshape(-1, 3).astype(np.float32),
                (np.arange(n)[:, None, None] * 4 + split).reshape(-1, 3).astype(np.int32),
                uv[:, split].reshape(-1, 3, 2).astype(np.float32),
                np.full(2 * n, material, np.int16),
                np.repeat(numbers.astype(np.int32), 2),
                np.repeat(texture_seeds(self._object(), hash32(numbers, np.uint32(self._seed ^ n))), 2),
            )
        )

    def mesh(self) -> Mesh:
        """Everything added so far."""
        if not self._faces:
            return joined(self._meshes)
        numbers = np.arange(len(self._count), dtype=np.uint32)
        seeds = texture_seeds(self._object(), hash32(numbers, np.uint32(self._seed)))
        own = Mesh(
            np.concatenate(self._vertices).astype(np.float32),
            np.concatenate(self._faces).astype(np.int32),
            np.concatenate(self._uv).astype(np.float32),
            np.repeat(np.array(self._material, np.int16), self._count),
            np.repeat(numbers.astype(np.int32), self._count),
            np.repeat(seeds, self._count),
        )
        return joined([own, *self._meshes])


def _grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Two triangles for each cell of a grid of vertices that are numbered row by row."""
    k = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([k, k + 1, k + columns + 1], axis=1)
    return np.concatenate([lower, np.stack([k, k + columns + 1, k + columns], axis=1)])


def _sums(products: Float64) -> Float64:
    return np.asarray(products[:, 0] + products[:, 1] + products[:, 2])


def _cross(a: Float64, b: Float64) -> Float64:
    """Vector products of (N, 3) with (N, 3) or (3,); NumPy's own is slow on few vectors."""
    x, y, z = a[:, 0], a[:, 1], a[:, 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


def _length(v: Float64) -> float:
    return math.sqrt(float(v[0]) ** 2 + float(v[1]) ** 2 + float(v[2]) ** 2)
