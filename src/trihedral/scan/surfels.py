"""An even sampling of the surface that a station saw."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float32

# A normal with less than this along the vertical is of a ceiling.
FACES_DOWN = -0.8
# Cosine of the incidence below which surface is not taken for larger: at a grazing angle normals do not tell it.
# A wall of a simulated passage, seen at 5 to 9 degrees, comes out within a fifth of its area; with 0.05 it is 1.8 times
# that, with 0.2 half.
LEAST_COSINE = 0.1


def incidence(points: NDArray[np.floating], normals: NDArray[np.floating]) -> NDArray[np.floating]:
    """(N,) cosines between normals (N, 3) and the beams that met points (N, 3), centred on the scanner."""
    along = np.abs(np.einsum("ij,ij->i", points, normals))
    cosine: NDArray[np.floating] = along / np.sqrt(np.einsum("ij,ij->i", points, points))
    return cosine


def faces_down(
    points: NDArray[np.floating], normals: NDArray[np.floating], up: NDArray[np.floating]
) -> NDArray[np.bool_]:
    """(N,) whether surfels, given by their (N, 3) points and normals, are of a ceiling, where `up` (3,) is up.

    It is above the scanner, and seen at an angle at which normals are sound: far ground with normals of noise is not.
    """
    sound = incidence(points, normals) > LEAST_COSINE
    down: NDArray[np.bool_] = (normals @ up < FACES_DOWN) & (points @ up > 0) & sound
    return down


@dataclass(frozen=True)
class Surfels:
    """Points of the surface with the plane about each, centred on the scanner.

    Attributes
    ----------
    spacing
        Edge of the voxels that they are drawn from, metres.
    points, normals
        (N, 3) places and unit normals towards the scanner; (0, 0, 0) where there is no plane.
    thickness
        (N,) standard deviation of the points across the local plane, of one row of beams that of its ranges, metres.
    support, count
        (N,) points that the local plane rests on; points in the surfel's own voxel.
    intensity, color
        (N,) and (N, 3) means in 0..1; NaN where the scan tells none.
    patch
        (N,) index of the planar patch that the surfel belongs to, -1 for none.
    static
        (N,) whether it is of a patch that no vehicle or furniture has (`scan.static_structure`).
    """

    spacing: float
    points: Float32
    normals: Float32
    thickness: Float32
    support: Float32
    count: Float32
    intensity: Float32
    color: Float32
    patch: NDArray[np.int32]
    static: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def planar(self) -> NDArray[np.bool_]:
        """(N,) whether a surfel has a local plane."""
        planar: NDArray[np.bool_] = np.any(self.normals != 0, axis=1)
        return planar

    def thin(self, angular_step: float) -> NDArray[np.bool_]:
        """(N,) whether a surfel has no plane because the beams about it are farther apart than the voxels.

        In a scan that was thinned in space, where the step (rad) is NaN, whether it is of a single point.
        """
        if np.isfinite(angular_step):
            apart: NDArray[np.bool_] = np.linalg.norm(self.points, axis=1) * angular_step > self.spacing
        else:
            apart = self.count <= 1
        return ~self.planar & apart

    def areas(self, angular_step: float) -> Float32:
        """(N,) square metres of surface that each stands for.

        What lies between one beam and the next counts for each of a surfel's beams, however it is slanted; one without
        a plane has that of one beam. In a scan that was thinned in space, where the step (rad) is NaN, it is a face of
        a voxel.
        """
        if not np.isfinite(angular_step):
            return np.full(len(self), self.spacing**2, dtype=np.float32)
        square = np.einsum("ij,ij->i", self.points, self.points)
        cosine = np.where(self.planar, incidence(self.points, self.normals), 1.0)
        beams = np.where(self.planar, self.count, np.float32(1.0))
        areas: Float32 = beams * square * np.float32(angular_step**2) / np.maximum(cosine, LEAST_COSINE)
        return areas
