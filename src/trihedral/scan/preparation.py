"""From a scan to its prepared form: one pass over the points, linear in their number."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import InputError, OptionError
from trihedral.scan.appearance import telling
from trihedral.scan.beacons import beacons
from trihedral.scan.carrier import carrier_range
from trihedral.scan.free_space import FreeSpace
from trihedral.scan.mounting import mounting
from trihedral.scan.noise import NoiseModel
from trihedral.scan.patches import Patches
from trihedral.scan.photometry import photometry
from trihedral.scan.prepared import Prepared
from trihedral.scan.scan import Scan
from trihedral.scan.sparse_planes import sparse_planes
from trihedral.scan.static_structure import static_structure
from trihedral.scan.surfels import Surfels


@dataclass(frozen=True)
class PrepareOptions:
    """How a scan is prepared."""

    #: Surfels at the most, of the finest voxels.
    surfels: int = 120_000
    #: Voxels are widened until the normals of surfels are made of surface, not of noise; points alone need none.
    sound_normals: bool = True
    #: Square metres; smaller planar patches are dropped.
    least_patch_area: float = 0.25
    #: Metres; nearer points are of the instrument and its tripod.
    shortest_range: float = 0.1

    def __post_init__(self) -> None:
        if self.surfels < 1000:
            raise OptionError(f"surfels is {self.surfels}: at least 1000 are needed")
        if self.least_patch_area <= 0 or self.shortest_range < 0:
            raise OptionError("least_patch_area must be positive and shortest_range not negative")


def prepare(scan: Scan, options: PrepareOptions | None = None) -> Prepared:
    """Reduce a scan to surfels, patches and free space.

    Points of what carries the scanner are left out, and of the surfels those that mix two surfaces. Surfels are the
    points of a voxel with the plane that they and their neighbours lie on; patches grow over surfels; free space is
    kept as the extremes of range per direction.

    Raises
    ------
    InputError
        If the scan has no points beyond the shortest range.
    """
    options = options or PrepareOptions()
    scan = telling(scan)
    centred = scan.xyz
    scanner = np.asarray(scan.header.scanner_origin, dtype=np.float64)
    offset = (scanner - scan.local_origin).astype(np.float32)
    if offset.any():
        centred = scan.xyz - offset
    # The shift is rounded to float32 with the points; what the shift lost goes back into the origin.
    origin = scan.local_origin + offset.astype(np.float64)
    ranges = np.sqrt(np.einsum("ij,ij->i", centred, centred))
    carrier = carrier_range(ranges)
    kept = ranges >= max(options.shortest_range, carrier)
    del ranges
    if not kept.any():
        raise InputError(
            scan.header.source,
            f"no point is farther than {options.shortest_range} m from the scanner",
            place=scan.header.place,
            advice="State --units or --scanner-origin if the file does not say them rightly",
        )
    notes = [*scan.header.notes]
    if carrier > options.shortest_range:
        share = 1 - np.count_nonzero(kept) / len(scan)
        notes.append(
            f"{share:.1%} of the points, nearer than {carrier:.2f} m, are of what carries the scanner: not used"
        )
    if kept.all():
        kept = np.s_[:]
    centred = np.ascontiguousarray(centred[kept])
    found = _core.prepare(
        centred,
        row=None if scan.row is None else scan.row[kept],
        column=None if scan.column is None else scan.column[kept],
        intensity=None if scan.intensity is None else scan.intensity[kept],
        color=None if scan.color is None else np.ascontiguousarray(scan.color[kept]),
        colored=None if scan.colored is None else scan.colored[kept],
        surfels=options.surfels,
        sound_normals=options.sound_normals,
        least_patch_area=options.least_patch_area,
    )
    if scan.row is not None and not found.on_grid:
        notes.append("its rows and columns are not those of its directions: not used")
    patches = Patches(found.patches.normals, found.patches.areas)
    surfels = _surfels(found)
    noise = NoiseModel(found.range_noise, found.angular_step, found.surface_noise)
    mounted = mounting(surfels, patches.normals, noise)
    if not mounted.standing:
        notes.append(f"it hangs, lies or has other axes: up is {_axis(mounted.up)}, as its surfaces show")
    surfels = replace(surfels, static=static_structure(surfels, patches, mounted.up))
    return Prepared(
        scanner_origin=origin,
        origin_sigma=np.array(scan.header.origin_sigma or np.full(3, np.nan)),
        scanned_points=len(scan),
        notes=tuple(notes),
        beacons=beacons(centred),
        surfels=surfels,
        patches=patches,
        free_space=FreeSpace(found.nearest, found.farthest),
        noise=noise,
        mounting=mounted,
        photometry=photometry(surfels),
        sparse_planes=sparse_planes(surfels.points[surfels.thin(noise.angular_step)]),
    )


def _surfels(found: _core.PreparedScan) -> Surfels:
    made = found.surfels
    return Surfels(
        spacing=found.spacing,
        points=made.points,
        normals=made.normals,
        thickness=made.thickness,
        support=made.support,
        count=made.count,
        intensity=made.intensity,
        color=made.color,
        patch=made.patch,
        static=np.zeros(len(made.points), dtype=np.bool_),
    )


def _axis(up: NDArray[np.float64]) -> str:
    """Name a direction by the axis next to it, and how far it is off."""
    nearest = int(np.argmax(np.abs(up)))
    off = np.degrees(np.arccos(min(1.0, abs(up[nearest]))))
    return f"{'-' if up[nearest] < 0 else '+'}{'xyz'[nearest]}, {off:.1f} degrees off it"
