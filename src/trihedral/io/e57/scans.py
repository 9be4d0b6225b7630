"""Reading the scans of an E57 file."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import InputError
from trihedral.io.e57.contents import Contents, contents, core_errors
from trihedral.io.e57.poses import motion_of
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import scan_from
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT

_FIELDS = {
    *("cartesianX", "cartesianY", "cartesianZ", "cartesianInvalidState"),
    *("sphericalRange", "sphericalAzimuth", "sphericalElevation", "sphericalInvalidState"),
    *("intensity", "isIntensityInvalid", "colorRed", "colorGreen", "colorBlue", "isColorInvalid"),
    *("rowIndex", "columnIndex"),
}
# Characters of a scan's name.
_LONGEST_NAME = 200
_LAST = np.iinfo(np.int32).max


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read what an E57 file says of its scans, in the file's order; one without scans is refused.

    A scan whose description is damaged has no points; a note says why.
    """
    found = contents(path)
    if not found.scans:
        raise InputError(path, "it holds no scans")
    return [_header(found, index, options) for index in range(len(found.scans))]


def _header(found: Contents, index: int, options: ReadOptions) -> ScanHeader:
    scan, stem = found.scan(index), found.path.stem
    notes = [*found.damaged_pictures, *found.said_of_pictures(index)]
    if options.units not in (None, "m"):
        notes.append(f"E57 is in metres; {options.units} was asked for")
    origin = options.origin_of(found.path, index) or (0.0, 0.0, 0.0)
    header = ScanHeader(
        source=found.path,
        scan_index=index,
        name=stem if len(found.scans) == 1 else f"{stem}-{index}",
        format="e57",
        points=None,
        grid=None,
        has_color=False,
        has_intensity=False,
        photos=len(found.images_of(index)),
        file_pose=None,
        scanner_origin=np.array(origin, dtype=np.float64),
        origin_stated=True,
        units=options.units or "m",
        units_stated=True,
    )
    if isinstance(scan, str):
        return dataclasses.replace(header, notes=(f"cannot be read: {scan}", *notes))
    file_pose, doubts = motion_of(scan.pose)
    if file_pose is not None:
        file_pose[:3, 3] *= METRES_PER_UNIT[header.units]
    said = [f"pose in the file: {doubt}" for doubt in doubts]
    ignored = [field for field in scan.fields if field not in _FIELDS]
    if ignored:
        said.append("fields not used: " + ", ".join(ignored))
    if scan.extras:
        said.append("extensions not used: " + ", ".join(scan.extras))
    fields = set(scan.fields)
    stated = options.scanner_origin is not None or _own_frame(file_pose, fields)
    if not stated:
        said.append("it has no pose: points may be in project coordinates; scanner at (0, 0, 0) assumed")
    return dataclasses.replace(
        header,
        origin_stated=stated,
        name=scan.name[:_LONGEST_NAME] or header.name,
        points=scan.points,
        grid=_grid_size(scan.index_bounds) if {"rowIndex", "columnIndex"} <= fields else None,
        has_color={"colorRed", "colorGreen", "colorBlue"} <= fields,
        has_intensity="intensity" in fields,
        file_pose=file_pose,
        notes=(*said, *notes),
    )


def _own_frame(file_pose: NDArray[np.float64] | None, fields: set[str]) -> bool:
    """Whether points are in the scanner's own frame: they are on its grid, angles, or are to be moved elsewhere."""
    moved = file_pose is not None and not np.allclose(file_pose, np.eye(4), rtol=0.0, atol=1e-9)
    return moved or "sphericalRange" in fields or {"rowIndex", "columnIndex"} <= fields


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the valid points of one scan."""
    found = contents(path)
    header = _header(found, scan_index, options)
    with core_errors(path, header.name):
        points = found.file.read_points(scan_index, METRES_PER_UNIT[header.units])
    if points.no_return and not len(points.xyz):
        raise InputError(
            path,
            f"none of its {header.points} points is a measurement: they lie at the scanner itself",
            place=header.name,
            advice="Export the scan again",
        )
    notes = list(header.notes)
    if points.intensity_by_extremes:
        notes.append("intensity scaled by its extremes: the file states no limits that hold")
    if points.color_by_extremes:
        notes.append("the file does not state the colours' depth: taken from the largest value")
    row, column, grid = points.row, points.column, header.grid
    scan = found.scans[scan_index]
    if row is not None and column is not None and not isinstance(scan, str):
        row, column, grid, contradictions = _grid(row, column, scan.index_bounds)
        notes.extend(contradictions)
    header = dataclasses.replace(header, grid=grid, notes=tuple(notes))
    read = scan_from(header, points)
    return dataclasses.replace(read, row=row, column=column)


def _grid_size(bounds: Sequence[int] | None) -> tuple[int, int] | None:
    """Rows and columns by the bounds of the indices; None where they say nothing."""
    if bounds is None:
        return None
    rows, columns = bounds[1] - bounds[0] + 1, bounds[3] - bounds[2] + 1
    return (rows, columns) if rows > 1 and columns > 1 else None


def _grid(
    row: NDArray[np.int32], column: NDArray[np.int32], bounds: Sequence[int] | None
) -> tuple[NDArray[np.int32], NDArray[np.int32], tuple[int, int] | None, list[str]]:
    """Count rows and columns from zero; where the bounds do not hold, the points' indices do."""
    if not len(row):
        return row, column, _grid_size(bounds), []
    actual = (int(row.min()), int(row.max()), int(column.min()), int(column.max()))
    holds = bounds is not None and (
        bounds[0] <= actual[0]
        and actual[1] <= bounds[1]
        and bounds[2] <= actual[2]
        and actual[3] <= bounds[3]
    )
    if bounds is not None and holds:
        first_row, _, first_column, _ = bounds
        size = _grid_size(bounds)
    else:
        first_row, first_column = min(actual[0], 0), min(actual[2], 0)
        size = _grid_size((first_row, actual[1], first_column, actual[3]))
    # Bounds and indices are of 32 bits; their differences need not be.
    row, column = (
        values if first == 0 else np.clip(values.astype(np.int64) - first, None, _LAST).astype(np.int32)
        for values, first in ((row, first_row), (column, first_column))
    )
    contradicted = bounds is not None and not holds
    notes = ["grid size taken from the points: the file's bounds do not hold"] if contradicted else []
    return row, column, size, notes
