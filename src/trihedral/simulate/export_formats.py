"""One scan as a file of any format that is written here; what a format cannot hold is left out."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import creating
from trihedral.geometry.se3 import motion
from trihedral.io import las, pcd, ply, ptx
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.io.writers import Content, PlacedScan
from trihedral.scan import Scan, ScanHeader
from trihedral.simulate.exports import FileScan


def write_as_e57(path: Path, scan: FileScan) -> None:
    """Write E57 without a pose; a grid's cells without a return are left out."""
    write_e57(
        path,
        [E57Scan(scan.name, scan.xyz, None, scan.intensity, scan.color, row=scan.row, column=scan.column)],
    )


def write_as_laz(path: Path, scan: FileScan) -> None:
    """Write LAZ 1.4 in steps of 0.1 mm."""
    las.write(path, [_placed(path, scan)], _content(scan))


def write_as_las(path: Path, scan: FileScan) -> None:
    """Write the same without compression."""
    with creating(path) as partial, tempfile.TemporaryDirectory() as folder:
        packed = Path(folder) / "packed.laz"
        write_as_laz(packed, scan)
        laspy.read(packed).write(partial, do_compress=False)


def write_as_ply(path: Path, scan: FileScan) -> None:
    """Write binary PLY."""
    ply.write(path, [_placed(path, scan)], _content(scan))


def write_as_pcd(path: Path, scan: FileScan) -> None:
    """Write binary PCD, whose viewpoint says where one scanner stood."""
    pcd.write(path, [_placed(path, scan)], _content(scan))


def write_as_ptx(path: Path, scan: FileScan) -> None:
    """Write PTX, gridded if the scan is, with no motion in its header."""
    ptx.write(path, [_placed(path, scan)], _content(scan))


def write_as_pts(path: Path, scan: FileScan) -> None:
    """Write PTS: the count, then coordinates, intensity from -2048 to 2047, and colour."""
    intensity = None if scan.intensity is None else np.rint(scan.intensity * 4095.0) - 2048.0
    _write_lines(path, scan, intensity, "%d", head=f"{len(scan)}\n")


def write_as_xyz(path: Path, scan: FileScan) -> None:
    """Write lines of coordinates, intensity from 0 to 1, and colour, as far as there are any."""
    _write_lines(path, scan, scan.intensity, "%.4f", head="")


def _write_lines(path: Path, scan: FileScan, intensity: NDArray[Any] | None, kind: str, head: str) -> None:
    columns: list[NDArray[Any]] = [scan.xyz]
    formats = ["%.4f"] * 3
    if intensity is not None:
        columns.append(intensity[:, None])
        formats.append(kind)
    if scan.color is not None:
        columns.append(scan.color)
        formats += ["%d"] * 3
    with creating(path) as partial, partial.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(head)
        np.savetxt(stream, np.hstack(columns), fmt=formats)


def _content(scan: FileScan) -> Content:
    return Content(len(scan), scan.color is not None, scan.intensity is not None, tuple(scan.scanners))


def _placed(path: Path, scan: FileScan) -> PlacedScan:
    """Give a scan whose own frame is the file's."""
    origin = np.zeros(3)
    # Writers add it back: coordinates of a national grid are too large for float32.
    if scan.xyz.dtype == np.float64:
        origin = np.round(scan.xyz.mean(axis=0))
    header = ScanHeader(
        path, 0, scan.name, "e57", len(scan), scan.grid, scan.color is not None, scan.intensity is not None,
        0, None, np.zeros(3), True, "m", True,
    )  # fmt: skip
    xyz = (scan.xyz - origin).astype(np.float32)
    points = Scan(header, xyz, origin, scan.intensity, scan.color, scan.row, scan.column)
    return PlacedScan(scan.name, points, motion())


FORMATS: dict[str, Callable[[Path, FileScan], None]] = {
    "e57": write_as_e57,
    "las": write_as_las,
    "laz": write_as_laz,
    "pcd": write_as_pcd,
    "ply": write_as_ply,
    "pts": write_as_pts,
    "ptx": write_as_ptx,
    "xyz": write_as_xyz,
}
