"""Planes through points that a scanner saw so far apart that no voxel has one: the walls of a far street on a plan."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Float32 = NDArray[np.float32]

# docs/method.md has what other values bring.
MOST = 10_000  # points that are looked at, evenly drawn
NEAREST = 12  # points of a plane: beams are farther apart one way than the other
FLATNESS = 0.2  # most that a plane's points scatter across it, of how far they scatter along its shorter side


def wide_planes(points: Float32) -> tuple[Float32, Float32]:
    """Points that lie on a plane with those next to them.

    Good to centimetres where beams are metres apart: enough to say where a wall may stand, not to measure from.

    Parameters
    ----------
    points
        (N, 3) thinly seen points, centred on the scanner, metres.

    Returns
    -------
    points, normals
        (W, 3) of the points, (W, 3) unit vectors towards the scanner.
    """
    drawn = points[:: max(1, -(-len(points) // MOST))]
    if len(drawn) < NEAREST:
        return np.empty((0, 3), dtype=np.float32), np.empty((0, 3), dtype=np.float32)
    _, nearest = KDTree(drawn).query(drawn, k=NEAREST)
    around = drawn[nearest].astype(np.float64)
    around -= around.mean(axis=1, keepdims=True)
    scatter, axes = np.linalg.eigh(np.swapaxes(around, 1, 2) @ around)
    flat = scatter[:, 0] < FLATNESS**2 * scatter[:, 1]
    on_planes, normals = drawn[flat], axes[flat, :, 0].astype(np.float32)
    normals *= -np.sign(np.einsum("ij,ij->i", normals, on_planes))[:, None]
    return on_planes, normals
