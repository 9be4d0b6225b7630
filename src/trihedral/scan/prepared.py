"""A scan reduced, once and alone, to what pairs and networks work on."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.scan.ceiling import may_be_enclosed
from trihedral.scan.free_space import FreeSpace
from trihedral.scan.mounting import Mounting
from trihedral.scan.noise import NoiseModel
from trihedral.scan.patches import Patches
from trihedral.scan.photometry import Photometry, SurfaceTexture
from trihedral.scan.scan import ScanHeader, seen_from
from trihedral.scan.sparse_planes import SparsePlanes
from trihedral.scan.static_structure import static_structure
from trihedral.scan.stored_arrays import (
    Arrays,
    StoredFeatures,
    arrays_of,
    part_of,
    stored_arrays,
    with_prefix,
    without_prefix,
    write_arrays,
)
from trihedral.scan.surfels import Surfels


@dataclass(frozen=True)
class Prepared:
    """What one station saw, in parts.

    Coordinates are centred on the scanner: ``station = prepared + scanner_origin``.

    Attributes
    ----------
    scanner_origin
        (3,) metres, station coordinates.
    origin_sigma
        (3,) metres, of an origin that was found from the points; NaN where it is stated or assumed.
    scanned_points
        Valid points that the scan had.
    beacons
        (M, 3) float32 points by which the scan is known again.
    surfels, patches, free_space, noise
        Its surface, the planes in it, what was empty, and how true that is.
    mounting
        Which way is up in it.
    photometry
        What the surface looks like less light and distance.
    sparse_planes
        Planes of what was seen too thinly for surfels with one.
    notes
        What a person should know of the scan as it was read and used.
    features
        What a source of features keeps with the scan.
    """

    scanner_origin: NDArray[np.float64]
    origin_sigma: NDArray[np.float64]
    scanned_points: int
    beacons: NDArray[np.float32]
    surfels: Surfels
    patches: Patches
    free_space: FreeSpace
    noise: NoiseModel
    mounting: Mounting
    photometry: Photometry
    sparse_planes: SparsePlanes
    notes: tuple[str, ...] = ()
    features: StoredFeatures | None = None

    @cached_property
    def thin(self) -> NDArray[np.bool_]:
        """(N,) which surfels have no plane because the beams about them are farther apart than the voxels."""
        return self.surfels.thin(self.noise.angular_step)

    @cached_property
    def may_be_enclosed(self) -> bool:
        """Whether the scanner may have stood under a ceiling."""
        return may_be_enclosed(self.surfels.points, self.surfels.normals, self.mounting.up)

    @cached_property
    def textures(self) -> tuple[SurfaceTexture, SurfaceTexture]:
        """Of its colour and of its intensity: the first tells more."""
        points, seen = self.surfels.points, self.photometry
        return SurfaceTexture(points, seen.color), SurfaceTexture(points, seen.intensity)

    @cached_property
    def surfel_map(self) -> _core.SurfelMap:
        """The planar surfels and the thin ones in the form that the kernels search."""
        surfels, planar = self.surfels, self.surfels.planar
        areas = surfels.areas(self.noise.angular_step)
        thin = surfels.points[self.thin]
        return _core.SurfelMap(
            points=surfels.points[planar],
            normals=surfels.normals[planar],
            variances=self.noise.plane_variances(surfels),
            kinds=np.where(surfels.static, 2, surfels.patch >= 0).astype(np.uint8)[planar],
            spacing=surfels.spacing,
            thin_points=thin,
            thin_variances=np.full(len(thin), self.noise.beam_variance, dtype=np.float32),
            areas=np.concatenate([areas[planar], areas[self.thin]]),
            sparse_points=self.sparse_planes.points,
            sparse_normals=self.sparse_planes.normals,
            seen_nearest=self.free_space.nearest,
            seen_farthest=self.free_space.farthest,
        )

    @cached_property
    def turned_over(self) -> Self:
        """The same scan with up and down exchanged."""
        mounting = self.mounting.turned_over
        static = static_structure(self.surfels, self.patches, mounting.up)
        return replace(self, mounting=mounting, surfels=replace(self.surfels, static=static))

    def placed(self, header: ScanHeader) -> ScanHeader:
        """Say in a header what the points told: where they were seen from, which way is up, and what is not used."""
        if not np.isnan(self.origin_sigma).any():
            x, y, z = self.origin_sigma.tolist()
            header = seen_from(header, self.scanner_origin, (x, y, z))
        upright = None if self.mounting.standing else self.mounting.rotation
        notes = tuple(dict.fromkeys([*header.notes, *self.notes]))
        return replace(header, upright_from_scanner=upright, notes=notes)

    def save(self, path: Path) -> None:
        """Write to an uncompressed .npz file."""
        own = {
            "scanner_origin": self.scanner_origin,
            "origin_sigma": self.origin_sigma,
            "scanned_points": np.asarray(self.scanned_points),
            "beacons": self.beacons,
            "notes": np.array(self.notes, dtype=np.str_),
        }
        parts = {name: arrays_of(getattr(self, name)) for name in _PARTS}
        parts["free_space"] = self.free_space.arrays()
        if self.features is not None:
            parts["features"] = self.features.arrays()
        arrays: dict[str, NDArray[np.generic]] = dict(own)
        for name, part in parts.items():
            arrays |= with_prefix(name, part)
        write_arrays(path, arrays)

    @classmethod
    def load(cls, path: Path, features: type[StoredFeatures] | None = None) -> Self:
        """Read what `save` wrote; the features, if they are asked for by their type.

        Raises
        ------
        ValueError
            If the file is damaged or of another version.
        OSError
            If it cannot be read.
        """
        with stored_arrays(path) as stored:

            def part(name: str) -> Arrays:
                return without_prefix(name, stored)

            return cls(
                scanner_origin=stored["scanner_origin"],
                origin_sigma=stored["origin_sigma"],
                scanned_points=int(stored["scanned_points"]),
                notes=tuple(stored["notes"].tolist()),
                beacons=stored["beacons"],
                free_space=FreeSpace.from_arrays(part("free_space")),
                **{name: part_of(kind, part(name)) for name, kind in _PARTS.items()},
                features=None if features is None else features.from_arrays(part("features")),
            )


_PARTS = {
    "surfels": Surfels,
    "patches": Patches,
    "noise": NoiseModel,
    "mounting": Mounting,
    "photometry": Photometry,
    "sparse_planes": SparsePlanes,
}
