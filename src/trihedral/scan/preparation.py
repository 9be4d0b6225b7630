"""From a scan to its prepared form: one pass over the points, linear in their number."""

from dataclasses import dataclass, replace

import numpy as np

from trihedral import _core
from trihedral.errors import InputError, OptionError
from trihedral.scan.photometry import less_fall_off, less_shading
from trihedral.scan.prepared import Prepared
from trihedral.scan.scan import Scan
from trihedral.scan.sparse_planes import wide_planes
from trihedral.scan.static_structure import solid_elements


@dataclass(frozen=True)
class PrepareOptions:
    """How a scan is prepared."""

    elements: int = 120_000  # surface elements at the most
    least_patch_area: float = 0.25  # square metres; smaller planar patches are dropped
    shortest_range: float = 0.1  # metres; nearer points are of the instrument and its tripod

    def __post_init__(self) -> None:
        if self.elements < 1000:
            raise OptionError(f"elements is {self.elements}: at least 1000 are needed")
        if self.least_patch_area <= 0 or self.shortest_range < 0:
            raise OptionError("least_patch_area must be positive and shortest_range not negative")


def prepare(scan: Scan, options: PrepareOptions | None = None) -> Prepared:
    """Reduce a scan to elements, patches and free space.

    Depth edges are found on the scanner's grid and left out of the elements; a scan without a grid keeps all its
    points. Elements are the points of a voxel with the plane that they and their neighbours lie on; patches grow over
    elements; free space is kept as the extremes of range per direction.

    Raises
    ------
    InputError
        If the scan has no points beyond the shortest range.
    """
    options = options or PrepareOptions()
    centred = scan.xyz
    scanner = np.asarray(scan.header.scanner_origin, dtype=np.float64)
    offset = (scanner - scan.local_origin).astype(np.float32)
    if offset.any():
        centred = scan.xyz - offset
    # The shift is rounded to float32 with the points; what the shift lost goes back into the origin.
    origin = scan.local_origin + offset.astype(np.float64)
    kept = np.einsum("ij,ij->i", centred, centred) >= options.shortest_range**2

    if not kept.any():
        raise InputError(
            scan.header.source,
            f"no point is farther than {options.shortest_range} m from the scanner",
            place=scan.header.place,
            advice="State --units or --scanner-origin if the file does not say them rightly",
        )
    if kept.all():
        kept = np.s_[:]
    out = _core.prepare(
        np.ascontiguousarray(centred[kept]),
        None if scan.row is None else scan.row[kept],
        None if scan.column is None else scan.column[kept],
        None if scan.intensity is None else scan.intensity[kept],
        None if scan.color is None else np.ascontiguousarray(scan.color[kept]),
        None if scan.colored is None else scan.colored[kept],
        options.elements,
        options.least_patch_area,
    )
    surface_noise = out.pop("thickness_median")
    prepared = Prepared(scanner_origin=origin, scanned_points=len(scan), surface_noise=surface_noise, **out)
    points, normals = wide_planes(prepared.points[prepared.thin])
    return replace(
        prepared,
        solid=solid_elements(prepared),
        color_texture=less_shading(prepared, prepared.color.mean(axis=1, dtype=np.float64)),
        intensity_texture=less_shading(prepared, less_fall_off(prepared)),
        wide_points=points,
        wide_normals=normals,
    )
