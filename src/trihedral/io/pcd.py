"""PCD, the Point Cloud Library's format: ASCII, binary and compressed, organised or not; binary out."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from trihedral import _core
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import naming_file, read_points
from trihedral.io.writers import Content, PlacedScan, write_records
from trihedral.scan import Scan, ScanHeader

# Written by every program that does not know better, so it states nothing.
_DEFAULT_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

# Beyond this (metres) a 32-bit float is coarser than 0.1 mm; PCL itself reads no wider coordinates.
_SINGLE_REACH = 1000.0


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read what a PCD file says of its one scan, without its points.

    VIEWPOINT's translation is the scanner's position in the points' own frame, as PCL uses it to orient
    normals; the default viewpoint states nothing.
    """
    with naming_file(path):
        raw = _core.pcd_header(path)
    viewpoint = tuple(raw.viewpoint or _DEFAULT_VIEWPOINT)
    stated = viewpoint != _DEFAULT_VIEWPOINT
    return [
        loose_header(
            path,
            "pcd",
            options,
            points=raw.points,
            grid=raw.grid,
            has_color=raw.color,
            has_intensity=raw.intensity,
            origin=np.array(viewpoint[:3], dtype=np.float64) if stated else None,
            fields=raw.fields,
        )
    ]


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points."""
    return read_points(read_headers(path, options)[scan_index], _core.pcd_read)


def write(path: Path, scans: Iterable[PlacedScan], content: Content) -> None:
    """Write a binary PCD file of project coordinates.

    Coordinates are 32-bit floats, which is all that PCL reads, unless a station lies beyond 1 km: then 64-bit
    ones. The viewpoint is the scanner's position where the file holds one scan.
    """
    wide = content.reach > _SINGLE_REACH
    fields = [(name, "<f8" if wide else "<f4") for name in ("x", "y", "z")]
    if content.intensity:
        fields.append(("intensity", "<f4"))
    if content.color:
        fields.append(("rgb", "<u4"))
    layout = np.dtype(fields)
    viewpoint = _DEFAULT_VIEWPOINT
    if len(content.scanners) == 1:
        viewpoint = (*content.scanners[0].tolist(), *_DEFAULT_VIEWPOINT[3:])
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(layout.names or ()),
        "SIZE " + " ".join(kind[2] for _, kind in fields),
        # PCL takes packed colour as the bits of a float.
        "TYPE " + " ".join("F" for _ in fields),
        "COUNT " + " ".join("1" for _ in fields),
        f"WIDTH {content.points}",
        "HEIGHT 1",
        "VIEWPOINT " + " ".join(f"{value:.9g}" for value in viewpoint),
        f"POINTS {content.points}",
        "DATA binary",
    ]
    write_records(path, header, layout, scans)
