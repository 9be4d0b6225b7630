"""PLY: ASCII and both binary orders, any properties, other elements and lists passed over."""

from pathlib import Path

from trihedral import _core
from trihedral.io.assemble import naming_file, scale_of, scan_from
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.scan import Photo, Scan, ScanHeader


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read what a PLY file says of its points, without reading them. PLY has no agreed place for the scanner.

    Raises
    ------
    InputError
        If the header is damaged or contradicts the file's size.
    """
    with naming_file(path):
        raw = _core.ply_header(path)
    return [
        loose_header(
            path,
            "ply",
            options,
            points=raw["points"],
            has_color=raw["color"],
            has_intensity=raw["intensity"],
            fields=raw["fields"],
        )
    ]


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points.

    Raises
    ------
    InputError
        If the file is truncated or damaged, or units or scanner origin must be stated.
    """
    header = read_headers(path, options)[scan_index]
    with naming_file(path):
        arrays = _core.ply_read(path, scale_of(header))
    return scan_from(header, arrays, options)


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """PLY holds no pictures."""
    return []
