"""PCD, the Point Cloud Library's format: ASCII, binary and compressed, organised or not."""

from pathlib import Path

import numpy as np

from trihedral import _core
from trihedral.io.assemble import naming_file, scale_of, scan_from
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.scan import Photo, Scan, ScanHeader

#: Written by every program that does not know better, so it states nothing.
_DEFAULT_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read what a PCD file says of its one scan, without its points.

    VIEWPOINT's translation is the scanner's position in the points' own frame, as PCL uses it to orient
    normals; the default viewpoint states nothing.

    Raises
    ------
    InputError
        If the header is missing, damaged or contradicts the file's size.
    """
    with naming_file(path):
        raw = _core.pcd_header(path)
    viewpoint = raw["viewpoint"]
    stated = viewpoint is not None and tuple(viewpoint) != _DEFAULT_VIEWPOINT
    organised = raw["height"] > 1
    return [
        loose_header(
            path,
            "pcd",
            options,
            points=raw["points"],
            grid=(raw["height"], raw["width"]) if organised else None,
            has_color=raw["color"],
            has_intensity=raw["intensity"],
            origin=np.array(viewpoint[:3], dtype=np.float64) if stated else None,
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
        arrays = _core.pcd_read(path, scale_of(header))
    return scan_from(header, arrays, options)


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """PCD holds no pictures."""
    return []
