"""From what a parser returns to a `Scan`: scaling of intensity and colour."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import InputError
from trihedral.guarded import Stamp, stamp_of
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT

T = TypeVar("T")

# Coordinates beyond this (metres) are kept relative to a local origin: a float32 at 2 km is good to 0.12 mm.
LARGE_COORDINATE = 2000.0
# So many points decide the local origin.
_FIRST = 65_536


@contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Raise the core's errors on this file as `InputError`."""
    try:
        yield
    except _core.FileFormatError as error:
        place, reason = error.args
        raise InputError(path, reason, place=place) from error


@lru_cache(maxsize=32)
def _indexed(index: Callable[[Path], list[T]], path: Path, _stamp: Stamp) -> tuple[T, ...]:
    with naming_file(path):
        return tuple(index(path))


def indexed(index: Callable[[Path], list[T]], path: Path) -> tuple[T, ...]:
    """Find the scans of a file with a function of the core, or remember them while the file stays."""
    return _indexed(index, path, stamp_of(path))


def read_points(header: ScanHeader, read: Callable[[Path, float], _core.PointBlock]) -> Scan:
    """Read the points of a scan; `read` is the core's, of the file and the metres per unit."""
    with naming_file(header.source):
        points = read(header.source, METRES_PER_UNIT[header.units])
    return scan_from(header, points)


def scan_from(header: ScanHeader, points: _core.PointBlock) -> Scan:
    """Build a `Scan` from the points as stored."""
    notes = list(header.notes)
    if points.not_finite:
        notes.append(f"{points.not_finite} points with NaN, infinite or absurd coordinates left out")
    if points.no_return:
        notes.append(f"{points.no_return} records at (0, 0, 0) left out: no return")
    if points.withheld:
        notes.append(f"{points.withheld} points flagged as withheld left out")
    if points.invalid:
        notes.append(f"{points.invalid} points flagged as invalid left out")
    if points.surplus:
        notes.append(f"the file holds {points.surplus:,} points more than its header says: they are not read")
    if points.open_end:
        notes.append("its last line has no end: if the file was cut short there, points are missing")
    intensity = points.intensity
    if intensity is not None and not intensity.any():
        intensity = None
        notes.append("intensity is zero everywhere: not used")
    color = points.color
    colored = None if color is None else _colored(color)
    if colored is not None and not colored.any():
        color = None
        notes.append("colour is black everywhere: not used")
    elif colored is not None and not colored.all():
        bare = len(colored) - int(np.count_nonzero(colored))
        notes.append(
            f"{bare:,} points ({bare / len(colored):.1%}) have no colour: it is stored as black (0, 0, 0)"
        )
    return Scan(
        header=dataclasses.replace(
            header, notes=tuple(notes), has_color=color is not None, has_intensity=intensity is not None
        ),
        xyz=points.xyz,
        local_origin=np.array(points.local_origin),
        intensity=None if intensity is None else unit_intensity(intensity, header.format),
        color=None if color is None else eight_bit(color),
        row=points.row,
        column=points.column,
        colored=None if color is None or colored is None or colored.all() else colored,
    )


def _colored(color: NDArray[Any]) -> NDArray[np.bool_]:
    """(N,) whether a point has a colour: black is what formats store where no picture saw one (N, 3)."""
    red, green, blue = color.T
    return np.asarray((red | green | blue) != 0)


def local_origin_for(first: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Choose the local origin (3,) of a scan near the middle of its first points, by axes, metres; as the core does."""
    middle = np.array([np.median(axis[:_FIRST]) for axis in first])
    if (np.abs(middle) <= LARGE_COORDINATE).all():
        return np.zeros(3)
    return np.asarray(np.round(middle / 100.0) * 100.0, dtype=np.float64)


def unit_intensity(raw: NDArray[np.float32], kind: str) -> NDArray[np.float32]:
    """Scale intensities (N,) to 0..1: by the format's usual limits where they hold, else by the extremes."""
    if not len(raw):
        return raw
    if not np.isfinite(raw).all():
        raw = np.nan_to_num(raw, nan=0.0, posinf=0.0, neginf=0.0)
    low, high = float(raw.min()), float(raw.max())
    if low >= 0.0 and high <= 1.0 and kind not in ("las", "laz"):
        return raw
    # LAS has 16 bits of intensity; a scan is not stretched, so that all scans keep one scale.
    if kind in ("las", "laz"):
        low, high = 0.0, 65535.0
    elif low >= 0.0 and high <= 255.0:
        low, high = 0.0, 255.0
    elif kind in ("pts", "xyz") and low >= -2048.0 and high <= 2047.0 and _whole(raw):
        low, high = -2048.0, 2047.0
    span = high - low
    return np.asarray((raw - low) / (span if span > 0 else 1.0), dtype=np.float32)


def _whole(values: NDArray[np.float32]) -> bool:
    return bool((values == np.rint(values)).all())


def eight_bit(color: NDArray[Any]) -> NDArray[np.uint8]:
    """Bring colours (N, 3) to 8 bits; they are 16-bit ones where any exceeds 255."""
    if color.dtype != np.uint8 and len(color) and int(color.max()) > 255:
        color = color >> 8
    return color.astype(np.uint8, copy=False)
