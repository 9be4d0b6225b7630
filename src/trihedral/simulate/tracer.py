"""Where rays meet the scene: Embree finds the triangle in float32, its plane gives the range in float64."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float64
from trihedral.simulate.mesh import Mesh

try:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene
except ImportError:
    raise OptionError(
        "The simulator needs Embree: install it with pip install 'trihedral[simulate]'."
    ) from None


@dataclass(frozen=True)
class FacePlanes:
    """Per face, in float64 from the float32 vertices: what turns a face number into geometry."""

    #: (F, 3) first vertex.
    corner: Float64
    #: (F, 3) unit normal.
    normal: Float64
    #: (F, 2) texture coordinates at the corner.
    uv: Float64
    #: (F, 2, 3) with which texture coordinates of p are `uv + gradient @ (p - corner)`.
    gradient: Float64


def face_planes(mesh: Mesh) -> FacePlanes:
    """Planes and texture frames of all faces; faces without area get a zero gradient."""
    v = mesh.vertices.astype(np.float64)
    a, b, c = (v[mesh.faces[:, k]] for k in range(3))
    e1, e2 = b - a, c - a
    cross = np.cross(e1, e2)
    area2 = cross[:, 0] ** 2 + cross[:, 1] ** 2 + cross[:, 2] ** 2
    safe = np.where(area2 > 0, area2, 1.0)
    normal = cross / np.sqrt(safe)[:, None]
    # Dual vectors: their products with p - a are the barycentric coordinates of p.
    d1 = np.cross(e2, cross) / safe[:, None]
    d2 = np.cross(cross, e1) / safe[:, None]
    uv = mesh.uv.astype(np.float64)
    du, dv = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    gradient = du[:, :, None] * d1[:, None, :] + dv[:, :, None] * d2[:, None, :]
    return FacePlanes(a, normal, uv[:, 0], gradient)


def dot(a: Float64, b: Float64) -> Float64:
    """Row by row products of (N, 3) arrays, summed in a fixed order."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])


class Tracer:
    """A mesh ready for rays."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.planes = face_planes(mesh)
        self._scene = EmbreeScene(robust=True)
        # The geometry is owned by the Embree scene once it is made.
        TriangleMesh(self._scene, mesh.vertices, mesh.faces)

    def cast(self, origins: Float64, directions: Float64) -> tuple[NDArray[np.int32], Float64]:
        """First faces (N,) and ranges (N,), metres, that (N, 3) unit rays meet; -1 and infinite for nothing."""
        hits = self._scene.run(
            np.ascontiguousarray(origins, np.float32),
            np.ascontiguousarray(directions, np.float32),
            output=True,
        )
        face = np.where(hits["geomID"] >= 0, hits["primID"], -1).astype(np.int32)
        distance = np.full(len(face), np.inf)
        met = np.flatnonzero(face >= 0)
        distance[met] = self.range_to(face[met], origins[met], directions[met])
        # A face seen edge-on has no range of its own: then the plane's disagrees with Embree's.
        off = np.abs(distance[met] - hits["tfar"][met]) > 1e-3 + 1e-4 * np.abs(hits["tfar"][met])
        lost = met[off | (distance[met] <= 0)]
        face[lost], distance[lost] = -1, np.inf
        return face, distance

    def surface(self, face: NDArray[np.int32]) -> NDArray[np.int32]:
        """Give the surfaces of faces, -1 for none."""
        return np.where(face >= 0, self.mesh.surface[face], np.int32(-1))

    def facing(self, face: NDArray[np.int32], views: Float64) -> Float64:
        """(N, 3) unit normals of faces, turned against the (N, 3) directions that see them."""
        normal = self.planes.normal[face]
        return np.asarray(np.where(dot(normal, views) > 0, -1.0, 1.0)[:, None] * normal)

    def range_to(self, face: NDArray[np.int32], origins: Float64, directions: Float64) -> Float64:
        """Range along each ray to the plane of its face, float64."""
        normal = self.planes.normal[face]
        across = dot(directions, normal)
        return np.asarray(
            dot(self.planes.corner[face] - origins, normal) / np.where(across == 0, 1e-300, across)
        )
