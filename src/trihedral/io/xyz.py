"""XYZ, CSV and other rows of numbers: separator, decimal sign and columns are told from rows all over the file."""

from pathlib import Path

from trihedral import _core
from trihedral.io.columns import columns_read, columns_unused
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import naming_file, read_points
from trihedral.scan import Scan, ScanHeader


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Tell what the columns are. The number of points is not known without reading them all, unless a line says it."""
    return [_header(path, _table(path), options)]


def _table(path: Path) -> _core.XyzTable:
    with naming_file(path):
        return _core.xyz_sniff(path)


def _header(path: Path, table: _core.XyzTable, options: ReadOptions) -> ScanHeader:
    said = "by the heading" if table.names else "columns are not named"
    notes = [f"{said}: taken as {columns_read(table)}"]
    # Columns behind the names, or all that are left where there are none.
    notes += columns_unused(table, from_column=len(table.names))
    if _x_after_y(table):
        notes.append(
            "y stands before x: where y is east and x is north, name them so, or the result is a mirror image"
        )
    if table.decimal_comma:
        notes.append("commas are decimal signs")
    if table.stray is not None:
        notes.append(f"line {table.stray} is left out: it has another number of columns than the rest")
    return loose_header(
        path,
        "xyz",
        options,
        points=table.declared,
        has_color=table.color,
        has_intensity=table.intensity,
        fields=[name for at, name in enumerate(table.names) if at not in table.used],
        notes=notes,
    )


def _x_after_y(table: _core.XyzTable) -> bool:
    x, y = table.used[:2]
    return table.names[x : x + 1] + table.names[y : y + 1] == ["x", "y"] and y < x


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points."""
    table = _table(path)
    return read_points(_header(path, table, options), table.read)
