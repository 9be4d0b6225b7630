"""PTX, Leica's text format for gridded scans, each with its pose; points are in the scanner's own frame."""

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.io.assemble import fingerprint, naming_file, scale_of, scan_from
from trihedral.io.headers import loose_header
from trihedral.io.options import ReadOptions
from trihedral.scan import Photo, Scan, ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT

#: Rotations are printed with six decimals or so; what differs by more is no rotation.
_ROTATION_TOLERANCE = 1e-3


@lru_cache(maxsize=16)
def _index(path: Path, _fingerprint: tuple[int, int]) -> tuple[_core.PtxScan, ...]:
    with naming_file(path):
        return tuple(_core.ptx_index(path))


def _scans(path: Path) -> tuple[_core.PtxScan, ...]:
    return _index(path, fingerprint(path))


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read each scan's header. The lines of points are counted, not parsed.

    The 4x4 matrix is written for row vectors: its transpose is `file_pose`.

    Raises
    ------
    InputError
        If a header is damaged or promises more points than the file has.
    """
    scans = _scans(path)
    return [_header(path, index, len(scans), scan, options) for index, scan in enumerate(scans)]


def _header(path: Path, index: int, count: int, scan: _core.PtxScan, options: ReadOptions) -> ScanHeader:
    pose, notes = _pose(scan, METRES_PER_UNIT[options.units or "m"])
    return loose_header(
        path,
        "ptx",
        options,
        scan_index=index,
        name=path.stem if count == 1 else f"{path.stem}-{index + 1}",
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
    """Read the points of one scan that have a return.

    Raises
    ------
    InputError
        If a line is not a point, or the scanner cannot be at the origin of these coordinates.
    """
    header = read_headers(path, options)[scan_index]
    with naming_file(path):
        arrays = _core.ptx_read(path, _scans(path)[scan_index], scale_of(header))
    return scan_from(header, arrays, options)


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """PTX holds no pictures."""
    return []
