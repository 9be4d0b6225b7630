"""PCD, the Point Cloud Library's format: ASCII, binary and compressed, organised or not; binary out."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from trihedral import _core
from trihedral.atomic import replacing
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.io.placed import Content, PlacedScan, blocks
from trihedral.io.scan_builder import naming_file, scale_of, scan_from
from trihedral.scan import Photo, Scan, ScanHeader

#: Written by every program that does not know better, so it states nothing.
_DEFAULT_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

#: Beyond this (metres) a 32-bit float is coarser than 0.1 mm; PCL itself reads no wider coordinates.
_SINGLE_REACH = 1000.0


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


def write(path: Path, scans: Iterable[PlacedScan], content: Content) -> None:
    """Write a binary PCD file of project coordinates.

    Coordinates are 32-bit floats, which is all that PCL reads, unless a station lies beyond 1 km: then 64-bit
    ones. The viewpoint is the scanner's position where the file holds one scan.

    Parameters
    ----------
    path
        The file; it appears, or is replaced, when it is complete.
    scans
        Taken one at a time.
    content
        What they hold together; scans without colour or intensity get zeros where others have it.

    Raises
    ------
    OutputError
        If the file cannot be written; what was there before is untouched.
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
    with replacing(path) as temporary, temporary.open("wb") as stream:
        stream.write(("\n".join(header) + "\n").encode())
        for block in blocks(scans):
            records = np.empty(len(block.xyz), layout)
            records["x"], records["y"], records["z"] = block.xyz.T
            if content.intensity:
                records["intensity"] = block.intensity_or_zero()
            if content.color:
                red, green, blue = block.color_or_black().astype(np.uint32).T
                records["rgb"] = red << 16 | green << 8 | blue
            stream.write(records.tobytes())
