"""PTS, Leica's plain text format: blocks of points, each behind its count."""

from functools import lru_cache
from pathlib import Path

from trihedral import _core
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import fingerprint, naming_file, scale_of, scan_from
from trihedral.scan import Photo, Scan, ScanHeader


@lru_cache(maxsize=16)
def _index(path: Path, _fingerprint: tuple[int, int]) -> tuple[_core.PtsBlock, ...]:
    with naming_file(path):
        return tuple(_core.pts_index(path))


def _blocks(path: Path) -> tuple[_core.PtsBlock, ...]:
    return _index(path, fingerprint(path))


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Find the blocks; each is a scan. Lines are counted, not parsed.

    Raises
    ------
    InputError
        If a count is wrong.
    """
    blocks = _blocks(path)
    return [
        loose_header(
            path,
            "pts",
            options,
            scan_index=index,
            name=path.stem if len(blocks) == 1 else f"{path.stem}-{index + 1}",
            points=block.points,
            has_color=block.color,
            has_intensity=block.intensity,
            notes=_miscount(block),
        )
        for index, block in enumerate(blocks)
    ]


def _miscount(block: _core.PtsBlock) -> list[str]:
    if block.declared == block.points:
        return []
    return [f"the count line says {block.declared} points, there are {block.points}: all are used"]


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points of one block.

    Raises
    ------
    InputError
        If a row is not a point, or units or scanner origin must be stated.
    """
    header = read_headers(path, options)[scan_index]
    with naming_file(path):
        arrays = _core.pts_read(path, _blocks(path)[scan_index], scale_of(header))
    return scan_from(header, arrays, options)


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """PTS holds no pictures."""
    return []
