"""PLY: ASCII and both binary orders, any properties, other elements and lists passed over; binary out."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from trihedral import _core
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import naming_file, read_points
from trihedral.io.writers import Content, PlacedScan, write_records
from trihedral.scan import Scan, ScanHeader


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read what a PLY file says of its points, without reading them. PLY has no agreed place for the scanner."""
    with naming_file(path):
        raw = _core.ply_header(path)
    return [
        loose_header(
            path,
            "ply",
            options,
            points=raw.points,
            has_color=raw.color,
            has_intensity=raw.intensity,
            fields=raw.fields,
        )
    ]


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points."""
    return read_points(read_headers(path, options)[scan_index], _core.ply_read)


def write(path: Path, scans: Iterable[PlacedScan], content: Content) -> None:
    """Write a binary PLY file of project coordinates, in float64 so that large ones stay exact."""
    fields = [("x", "<f8", "double"), ("y", "<f8", "double"), ("z", "<f8", "double")]
    if content.intensity:
        fields.append(("intensity", "<f4", "float"))
    if content.color:
        fields.extend((name, "u1", "uchar") for name in ("red", "green", "blue"))
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment written by trihedral: metres, project coordinates",
        f"element vertex {content.points}",
        *(f"property {kind} {name}" for name, _, kind in fields),
        "end_header",
    ]
    layout = np.dtype([(name, kind) for name, kind, _ in fields])
    write_records(path, header, layout, scans)
