"""PTX, Leica's text format for gridded scans, each with its pose; points are in the scanner's own frame."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.atomic import creating
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import indexed, read_points
from trihedral.io.writers import Content, PlacedScan
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT

# Rotations are printed with six decimals or so; what differs by more is no rotation.
_ROTATION_TOLERANCE = 1e-3
# A grid with more cells a point than this is not worth its empty lines: the points are listed instead.
_MOST_CELLS_A_POINT = 8
# Lines that are written at a time.
_BLOCK = 1 << 19


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read each scan's header. The lines of points are counted, not parsed.

    The 4x4 matrix is written for row vectors: its transpose is `file_pose`.
    """
    scans = indexed(_core.ptx_index, path)
    return [_header(path, index, len(scans), scan, options) for index, scan in enumerate(scans)]


def _header(path: Path, index: int, count: int, scan: _core.PtxScan, options: ReadOptions) -> ScanHeader:
    pose, notes = _pose(scan, METRES_PER_UNIT[options.units or "m"])
    if scan.decimal_comma:
        notes.append("commas are decimal signs")
    return loose_header(
        path,
        "ptx",
        options,
        scan_index=index,
        scans=count,
        points=scan.columns * scan.rows,
        grid=(scan.rows, scan.columns) if scan.structured else None,
        has_color=scan.color,
        has_intensity=scan.intensity,
        file_pose=pose,
        origin=np.zeros(3),
        units="m",
        notes=notes,
    )


def _pose(scan: _core.PtxScan, metres_per_unit: float) -> tuple[NDArray[np.float64] | None, list[str]]:
    """Read the rigid motion in the header, or None and a note where the matrix is none."""
    pose = np.array(scan.matrix, dtype=np.float64).T
    rotation = pose[:3, :3]
    rigid = (
        np.allclose(rotation @ rotation.T, np.eye(3), atol=_ROTATION_TOLERANCE)
        and np.linalg.det(rotation) > 0
        and np.allclose(pose[3], [0, 0, 0, 1], atol=1e-9)
        and np.isfinite(pose).all()
    )
    if not rigid:
        return None, ["the header's 4x4 matrix is no rigid motion: not used"]
    left, _, right = np.linalg.svd(rotation)
    pose[:3, :3] = left @ right
    pose[:3, 3] *= metres_per_unit
    return pose, []


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points of one scan that have a return."""
    scan = indexed(_core.ptx_index, path)[scan_index]
    return read_points(read_headers(path, options)[scan_index], scan.read)


def write(path: Path, scans: Iterable[PlacedScan], content: Content) -> None:
    """Write a PTX file: each scan in its scanner's frame, its pose in its header.

    Structured scans keep their grid, with `0 0 0` where there was no return; others are one column. `content` is
    not needed: each scan has a header of its own.
    """
    with creating(path) as temporary, temporary.open("wb") as stream:
        for placed in scans:
            scan = placed.scan
            columns, rows, order = _order(placed)
            pose = placed.pose.copy()
            pose[:3, 3] += pose[:3, :3] @ scan.header.scanner_origin
            lines = [
                str(columns),
                str(rows),
                *(_numbers(row) for row in (pose[:3, 3], *pose[:3, :3].T)),
                *(_numbers(row) for row in pose.T),
            ]
            stream.write(("\n".join(lines) + "\n").encode())
            for start in range(0, len(order), _BLOCK):
                stream.write(_rows(scan, order[start : start + _BLOCK]))


def _rows(scan: Scan, order: NDArray[np.int64]) -> bytes:
    """Format the points that `order` names; -1 is a cell without a return."""
    taken = order[order >= 0]
    local = np.full(len(order), -1, dtype=np.int64)
    local[order >= 0] = np.arange(len(taken))
    return _core.ptx_rows(
        scan.xyz[taken] + (scan.local_origin - scan.header.scanner_origin),
        None if scan.intensity is None else scan.intensity[taken],
        None if scan.color is None else scan.color[taken],
        local,
    )


def _numbers(values: NDArray[np.float64]) -> str:
    return " ".join(f"{value:.12g}" for value in values)


def _order(placed: PlacedScan) -> tuple[int, int, NDArray[np.int64]]:
    """Columns, rows and, column by column, the index of the point in each cell, -1 where there is none."""
    scan, grid = placed.scan, placed.scan.header.grid
    listed = (1, len(scan), np.arange(len(scan), dtype=np.int64))
    if grid is None or scan.row is None or scan.column is None:
        return listed
    rows, columns = grid
    cells = rows * columns
    if cells > _MOST_CELLS_A_POINT * len(scan):
        return listed
    inside = (scan.row >= 0) & (scan.row < rows) & (scan.column >= 0) & (scan.column < columns)
    if not inside.all():
        return listed
    order = np.full(cells, -1, dtype=np.int64)
    order[scan.column.astype(np.int64) * rows + scan.row] = np.arange(len(scan))
    # Several points in a cell (several returns of a pulse) would lose all but one.
    if np.count_nonzero(order >= 0) != len(scan):
        return listed
    return columns, rows, order
