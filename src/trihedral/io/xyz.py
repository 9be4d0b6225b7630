"""XYZ, CSV and other rows of numbers: separator, decimal sign and columns are told from the first rows."""

from pathlib import Path

from trihedral import _core
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import naming_file, read_points
from trihedral.scan import Scan, ScanHeader


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Tell what the columns are. The number of points is not known without reading them all."""
    return [_header(path, _table(path), options)]


def _table(path: Path) -> _core.XyzTable:
    with naming_file(path):
        return _core.xyz_sniff(path)


def _header(path: Path, table: _core.XyzTable, options: ReadOptions) -> ScanHeader:
    notes = []
    if not table.names:
        meaning = ["x y z", *["intensity"] * table.intensity, *["red green blue"] * table.color]
        notes.append(f"columns are not named: taken as {', '.join(meaning)}")
        unused = [str(at + 1) for at in range(table.columns) if at not in table.used]
        if unused:
            notes.append(f"columns not used: {', '.join(unused)} (a header line would name them)")
    if table.decimal_comma:
        notes.append("commas are decimal signs")
    return loose_header(
        path,
        "xyz",
        options,
        points=None,
        has_color=table.color,
        has_intensity=table.intensity,
        fields=[name for at, name in enumerate(table.names) if at not in table.used],
        notes=notes,
    )


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points."""
    table = _table(path)
    return read_points(_header(path, table, options), table.read, options)
