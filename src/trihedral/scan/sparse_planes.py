"""Planes through points that a scanner saw so far apart that no voxel has one: the walls of a far street on a plan."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from trihedral.geometry.arrays import Float32

# Points that are looked at, evenly drawn.
MOST = 10_000
# Points of a plane: beams are farther apart one way than the other.
NEAREST = 12
# Most that a plane's points scatter across it, of how far they scatter along its shorter side.
FLATNESS = 0.2


@dataclass(frozen=True)
class SparsePlanes:
    """Thinly seen points that lie on a plane with those next to them.

    Good to centimetres where beams are metres apart: enough to say where a wall may stand, not to measure from.

    Attributes
    ----------
    points, normals
        (W, 3) places, centred on the scanner, metres; (W, 3) unit vectors towards the scanner.
    """

    points: Float32
    normals: Float32

    def __len__(self) -> int:
        return len(self.points)


def sparse_planes(points: Float32) -> SparsePlanes:
    """Find the planes of (N, 3) thinly seen points, centred on the scanner, metres."""
    drawn = points[:: max(1, -(-len(points) // MOST))]
    if len(drawn) < NEAREST:
        return SparsePlanes(np.empty((0, 3), dtype=np.float32), np.empty((0, 3), dtype=np.float32))
    _, nearest = KDTree(drawn).query(drawn, k=NEAREST)
    around = drawn[nearest].astype(np.float64)
    around -= around.mean(axis=1, keepdims=True)
    scatter, axes = np.linalg.eigh(np.swapaxes(around, 1, 2) @ around)
    flat = scatter[:, 0] < FLATNESS**2 * scatter[:, 1]
    on_planes, normals = drawn[flat], axes[flat, :, 0].astype(np.float32)
    normals *= -np.sign(np.einsum("ij,ij->i", normals, on_planes))[:, None]
    return SparsePlanes(on_planes, normals)
