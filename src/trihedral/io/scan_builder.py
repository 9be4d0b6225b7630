"""From what a parser returns to a `Scan`: scaling of intensity and colour, checks that refuse to guess."""

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import InputError
from trihedral.io.options import ReadOptions
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT

T = TypeVar("T")

# A median range beyond this (metres) is no terrestrial scan: the coordinates are in other units, or the
# scanner is not where it is taken to be.
LARGEST_MEDIAN_RANGE = 1000.0
# Coordinates beyond this (metres) are kept relative to a local origin: a float32 at 2 km is good to 0.12 mm.
LARGE_COORDINATE = 2000.0
# So many points, evenly spaced in the file, tell the median range.
_SAMPLE = 100_000


@contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Raise the core's errors on this file as `InputError`."""
    try:
        yield
    except _core.FileFormatError as error:
        place, reason = error.args
        raise InputError(path, reason, place=place) from error


def file_stamp(path: Path) -> tuple[int, int]:
    """Size and time of a file: while they stay, what was learnt of it holds."""
    try:
        found = path.stat()
    except OSError as error:
        raise InputError(path, f"it cannot be read: {(error.strerror or '').lower()}") from error
    return found.st_size, found.st_mtime_ns


@lru_cache(maxsize=32)
def _indexed(index: Callable[[Path], list[T]], path: Path, _stamp: tuple[int, int]) -> tuple[T, ...]:
    with naming_file(path):
        return tuple(index(path))


def indexed(index: Callable[[Path], list[T]], path: Path) -> tuple[T, ...]:
    """Find the scans of a file with a function of the core, or remember them while the file stays."""
    return _indexed(index, path, file_stamp(path))


def read_points(
    header: ScanHeader, read: Callable[[Path, float], _core.PointBlock], options: ReadOptions
) -> Scan:
    """Read the points of a scan; `read` is the core's, of the file and the metres per unit."""
    with naming_file(header.source):
        points = read(header.source, METRES_PER_UNIT[header.units])
    return scan_from(header, points, options)


def scan_from(header: ScanHeader, points: _core.PointBlock, options: ReadOptions) -> Scan:
    """Build a `Scan` from the points as stored; `InputError` where `check_plausible` says so."""
    notes = list(header.notes)
    if points.not_finite:
        notes.append(f"{points.not_finite} points with NaN, infinite or absurd coordinates left out")
    if points.no_return:
        notes.append(f"{points.no_return} records at (0, 0, 0) left out: no return")
    if points.withheld:
        notes.append(f"{points.withheld} points flagged as withheld left out")
    intensity = points.intensity
    if intensity is not None and not intensity.any():
        intensity = None
        notes.append("intensity is zero everywhere: not used")
    color = points.color
    if color is not None and not color.any():
        color = None
        notes.append("colour is black everywhere: not used")
    scan = Scan(
        header=dataclasses.replace(
            header, notes=tuple(notes), has_color=color is not None, has_intensity=intensity is not None
        ),
        xyz=points.xyz,
        local_origin=np.array(points.local_origin),
        intensity=None if intensity is None else unit_intensity(intensity, header.format),
        color=None if color is None else eight_bit(color),
        row=points.row,
        column=points.column,
    )
    check_plausible(scan, options)
    return scan


def local_origin_for(first: NDArray[np.float64]) -> NDArray[np.float64]:
    """Choose the local origin (3,) of a scan by its first point, metres; as the core does it."""
    if (np.abs(first) <= LARGE_COORDINATE).all():
        return np.zeros(3)
    return np.asarray(np.round(first / 100.0) * 100.0, dtype=np.float64)


def unit_intensity(raw: NDArray[np.float32], kind: str) -> NDArray[np.float32]:
    """Scale intensities (N,) to 0..1: by the format's usual limits where they hold, else by the extremes."""
    if not len(raw):
        return raw
    if not np.isfinite(raw).all():
        raw = np.nan_to_num(raw, nan=0.0, posinf=0.0, neginf=0.0)
    low, high = float(raw.min()), float(raw.max())
    if low >= 0.0 and high <= 1.0:
        return raw
    if low >= 0.0 and high <= 255.0 and kind != "las" and kind != "laz":
        low, high = 0.0, 255.0
    elif kind == "pts" and low >= -2048.0 and high <= 2047.0:
        low, high = -2048.0, 2047.0
    span = high - low
    return np.asarray((raw - low) / (span if span > 0 else 1.0), dtype=np.float32)


def eight_bit(color: NDArray[Any]) -> NDArray[np.uint8]:
    """Bring colours (N, 3) to 8 bits; they are 16-bit ones where any exceeds 255."""
    if color.dtype != np.uint8 and len(color) and int(color.max()) > 255:
        color = color >> 8
    return color.astype(np.uint8, copy=False)


def check_plausible(scan: Scan, options: ReadOptions) -> None:
    """Refuse units and scanner origins that cannot be right, where the user has not stated them.

    An `InputError` says what to state where the median range is beyond `LARGEST_MEDIAN_RANGE`, or an assumed origin
    further outside the points' bounding box than the box's own diagonal.
    """
    header = scan.header
    if len(scan) == 0:
        return
    origin = header.scanner_origin - scan.local_origin
    step = -(-len(scan) // _SAMPLE)
    ranges = np.linalg.norm(scan.xyz[::step] - origin, axis=1)
    median = float(np.median(ranges))
    stated = options.scanner_origin is not None
    if median > LARGEST_MEDIAN_RANGE and not (stated and options.units is not None):
        missing = [
            "--units (mm, ft, us-ft, or m if they are metres)" if options.units is None else "",
            "" if stated else "--scanner-origin X,Y,Z (metres; 0,0,0 if it is there)",
        ]
        place = "the scanner" if header.origin_stated else "(0, 0, 0), where the scanner is taken to be"
        metres = "m" if header.units_stated else "assumed metres"
        raise InputError(
            header.source,
            f"half of the points are further than {median:,.0f} {metres} "
            f"from {place}: units or scanner origin are not what they seem",
            place=header.place,
            advice="State " + " and ".join(filter(None, missing)),
        )
    if header.origin_stated:
        return
    # Column by column: NumPy reduces (N, 3) along N ten times slower.
    low = np.array([scan.xyz[:, axis].min() for axis in range(3)])
    high = np.array([scan.xyz[:, axis].max() for axis in range(3)])
    outside = float(np.linalg.norm(np.maximum(np.maximum(low - origin, origin - high), 0.0)))
    diagonal = float(np.linalg.norm(high - low))
    if outside > diagonal:
        raise InputError(
            header.source,
            "the file does not say where the scanner stood, and it cannot be at (0, 0, 0): that is "
            f"{outside:,.1f} m outside points that span {diagonal:,.1f} m",
            place=header.place,
            advice="State it with --scanner-origin X,Y,Z (metres; 0,0,0 if it really is there)",
        )
