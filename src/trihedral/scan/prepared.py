"""A scan reduced, once and alone, to what pairs and networks work on."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.scan.stored_arrays import stored_arrays, write_arrays
from trihedral.scan.texture import Texture

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# A normal with less than this along the instrument's axis is of a ceiling.
LOOKS_DOWN = -0.8
# Metres: no element is truer than this.
LEAST_SIGMA = 0.0003
# Nor truer than this share of the scan's surface noise (docs/method.md has what it and the next were chosen by).
LEAST_SHARE = 0.15
# Points that the scan's surface noise counts for in an element's own: eight points may by chance lie on their plane.
TYPICAL_POINTS = 10.0
# Parameters of a plane, which its points have to tell before they tell its noise.
PLANE_UNKNOWNS = 3.0
# Cosine of the incidence below which surface is not taken for larger: at a grazing angle normals do not tell it.
# A wall of a simulated passage, seen at 5 to 9 degrees, comes out within a fifth of its area; with 0.05 it is 1.8 times
# that, with 0.2 half.
LEAST_COSINE = 0.1


@dataclass(frozen=True)
class Prepared:
    """Surface elements, planar patches and free space of one station.

    Coordinates are centred on the scanner: ``station = prepared + scanner_origin``.

    Attributes
    ----------
    scanner_origin
        (3,) metres, station coordinates.
    scanned_points
        Valid points that the scan had.
    spacing
        Edge of the voxels that the elements are drawn from, metres.
    range_noise
        Standard deviation of a range, metres, from neighbours on the scanner's grid; NaN for a scan without one.
    angular_step
        Angle between neighbours on the scanner's grid, radians; NaN for a scan without one.
    surface_noise
        Median standard deviation of the points across their local plane, metres.
    edge_points
        Points left out because ranges jump there.
    points, normals
        (N, 3) an even sampling of the surface and unit normals towards the scanner; (0, 0, 0) where there is no plane.
    thickness
        (N,) standard deviation of the points across the local plane, of one row of beams that of its ranges, metres.
    support, count
        (N,) points that the local plane rests on; points in the element's own voxel.
    intensity, color
        (N,) and (N, 3) means in 0..1; NaN where the scan tells none.
    patch
        (N,) index of the planar patch that the element belongs to, -1 for none.
    patch_normals, patch_distances, patch_centroids
        (P, 3), (P,), (P, 3) planes ``normal . x = distance``, normals towards the scanner; largest patch first.
    patch_along, patch_variances
        (P, 6) two in-plane axes, shorter spread first; (P, 3) variances of the rotations about them (rad^2) and of the
        distance at the centroid (m^2).
    patch_areas, patch_thickness
        (P,) square metres, metres.
    patch_looks
        (P, 4) mean intensity, red, green, blue in 0..1.
    outline_corners, outline_starts
        (C, 3) corners of the convex outlines and (P + 1,) where each patch's begin.
    solid
        (N,) whether an element is of a patch that no vehicle or furniture has (`scan.static_structure`).
    color_texture, intensity_texture
        (N,) grey value of the colour less its shading (`scan.photometry`); logarithm of the intensity less what
        distance and incidence make of it, and less its shading. NaN without colour, or intensity.
    wide_points, wide_normals
        (W, 3) thinly seen points that lie on a plane with their neighbours, (W, 3) its normal, towards the scanner
        (`scan.sparse_planes`).
    seen_nearest, seen_farthest
        Nearest and farthest range (m) per cell of a spherical grid, rows from the nadir; 0 where nothing was seen.
    """

    scanner_origin: Float64
    scanned_points: int
    spacing: float
    range_noise: float
    angular_step: float
    surface_noise: float
    edge_points: int
    points: Float32
    normals: Float32
    thickness: Float32
    support: Float32
    count: Float32
    intensity: Float32
    color: Float32
    patch: NDArray[np.int32]
    patch_normals: Float64
    patch_distances: Float64
    patch_centroids: Float64
    patch_along: Float64
    patch_variances: Float64
    patch_areas: Float64
    patch_thickness: Float64
    patch_looks: Float32
    outline_corners: Float32
    outline_starts: NDArray[np.int64]
    seen_nearest: Float32
    seen_farthest: Float32
    solid: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=np.bool_))
    color_texture: Float32 = field(default_factory=lambda: np.empty(0, dtype=np.float32))
    intensity_texture: Float32 = field(default_factory=lambda: np.empty(0, dtype=np.float32))
    wide_points: Float32 = field(default_factory=lambda: np.empty((0, 3), dtype=np.float32))
    wide_normals: Float32 = field(default_factory=lambda: np.empty((0, 3), dtype=np.float32))

    @cached_property
    def planar(self) -> NDArray[np.bool_]:
        """(N,) whether an element has a local plane."""
        planar: NDArray[np.bool_] = np.any(self.normals != 0, axis=1)
        return planar

    @cached_property
    def thin(self) -> NDArray[np.bool_]:
        """(N,) whether an element has no plane because the beams about it are farther apart than the voxels.

        Without a scanner's grid, whether it is of a single point.
        """
        if np.isfinite(self.angular_step):
            apart: NDArray[np.bool_] = np.linalg.norm(self.points, axis=1) * self.angular_step > self.spacing
        else:
            apart = self.count <= 1
        return ~self.planar & apart

    @cached_property
    def planar_normals(self) -> Float32:
        """(M, 3) normals of the planar elements."""
        return self.normals[self.planar]

    def areas(self, points: Float32, normals: Float32, beams: Float32 | float = 1.0) -> Float32:
        """Surface (N,), square metres, that points (N, 3) with their normals (0 for none) stand for.

        `beams` (N,) ended on each: what lies between one beam and the next counts for each of them, however it is
        slanted. Without a scanner's grid it is a face of a voxel.
        """
        if not np.isfinite(self.angular_step):
            return np.full(len(points), self.spacing**2, dtype=np.float32)
        square = np.einsum("ij,ij->i", points, points)
        cosine = np.abs(np.einsum("ij,ij->i", points, normals)) / np.sqrt(square)
        cosine[~normals.any(axis=1)] = 1.0
        areas: Float32 = beams * square * np.float32(self.angular_step**2) / np.maximum(cosine, LEAST_COSINE)
        return areas

    @cached_property
    def textures(self) -> tuple[Texture, Texture]:
        """Of its colour and of its intensity: the first tells more."""
        return Texture(self.points, self.color_texture), Texture(self.points, self.intensity_texture)

    @cached_property
    def station(self) -> _core.Station:
        """The planar elements and the thin ones in the form that the kernels search."""
        planar = self.planar
        rests = np.maximum(self.support[planar] - PLANE_UNKNOWNS, 0)
        variances = rests * self.thickness[planar] ** 2 + TYPICAL_POINTS * self.surface_noise**2
        variances /= rests + TYPICAL_POINTS
        # An element stands for its own points: neighbours that share in its plane have elements of their own.
        variances /= np.maximum(self.count[planar], 1)
        # Thousands of points near the scanner do not make an element true to a micrometre: what a plane leaves out of
        # the surface, and of the instrument, stays.
        variances += max(LEAST_SIGMA, LEAST_SHARE * self.surface_noise) ** 2
        # A single beam off a surface is off by the noise of its range at the most.
        noise = self.range_noise if np.isfinite(self.range_noise) else self.surface_noise
        thin = self.points[self.thin]
        areas = (
            self.areas(self.points[planar], self.planar_normals, self.count[planar]),
            self.areas(thin, np.zeros_like(thin)),
        )
        return _core.Station(
            self.points[planar],
            self.planar_normals,
            variances.astype(np.float32),
            np.where(self.solid, 2, self.patch >= 0).astype(np.uint8)[planar],
            self.spacing,
            thin,
            np.full(len(thin), max(LEAST_SIGMA, noise) ** 2, dtype=np.float32),
            np.concatenate(areas),
            self.wide_points,
            self.wide_normals,
            self.seen_nearest,
            self.seen_farthest,
        )

    def save(self, path: Path) -> None:
        """Write to an uncompressed .npz file."""
        write_arrays(path, self.arrays())

    def arrays(self) -> dict[str, Any]:
        """Every field as an array, by its name."""
        return {f.name: np.asarray(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_arrays(cls, values: dict[str, Any]) -> Self:
        """Undo `arrays`."""
        scalars = {name: value.item() for name, value in values.items() if value.ndim == 0}
        return cls(**(values | scalars))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what `save` wrote.

        Raises
        ------
        ValueError
            If the file is damaged or of another version.
        OSError
            If it cannot be read.
        """
        with stored_arrays(path) as stored:
            return cls.from_arrays({field.name: stored[field.name] for field in fields(cls)})
