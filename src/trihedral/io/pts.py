"""PTS, Leica's plain text format: blocks of points, each behind its count."""

from pathlib import Path

from trihedral import _core
from trihedral.io.columns import columns_read, columns_unused
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import indexed, read_points
from trihedral.scan import Scan, ScanHeader


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Find the blocks; each is a scan. Lines are counted, not parsed."""
    blocks = indexed(_core.pts_index, path)
    return [
        loose_header(
            path,
            "pts",
            options,
            scan_index=index,
            scans=len(blocks),
            points=block.points,
            has_color=block.color,
            has_intensity=block.intensity,
            notes=_notes(block),
        )
        for index, block in enumerate(blocks)
    ]


def _notes(block: _core.PtsBlock) -> list[str]:
    notes = (
        [f"columns are taken as {columns_read(block)}", *columns_unused(block)] if block.columns > 3 else []
    )
    if block.declared != block.points:
        notes.append(f"the count line says {block.declared} points, there are {block.points}: all are used")
    if block.decimal_comma:
        notes.append("commas are decimal signs")
    if block.stray:
        notes.append("the first point is left out: it has another number of columns than the rest")
    return notes


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points of one block."""
    block = indexed(_core.pts_index, path)[scan_index]
    return read_points(read_headers(path, options)[scan_index], block.read)
