"""One station's points as a file stores them."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Units = Literal["m", "cm", "mm", "ft", "us-ft"]

METRES_PER_UNIT: dict[Units, float] = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "ft": 0.3048,
    "us-ft": 1200.0 / 3937.0,
}

# Said of a file that does not state the scanner's position.
ORIGIN_ASSUMED = "scanner origin is not stated: (0, 0, 0) assumed unless the points tell it"


@dataclass(frozen=True)
class ScanHeader:
    """What a file says of one of its scans, known without reading the points."""

    source: Path  # the file
    scan_index: int  # place of the scan in the file, from 0
    name: str  # the scan's own name, or the file's stem where it has none
    format: str  # "e57", "ptx", "pts", "las", "laz", "ply", "pcd", "xyz", "rig"
    points: int | None  # as declared by the file; None where it does not say
    grid: tuple[int, int] | None  # rows, columns of a structured scan
    has_color: bool
    has_intensity: bool
    photos: int  # pictures that belong to this scan
    file_pose: NDArray[np.float64] | None  # project_from_station stored in the file (4x4), if any
    scanner_origin: NDArray[np.float64]  # scanner position in station coordinates (3,), metres
    origin_stated: bool  # the file or the user said where the scanner is; False: (0, 0, 0) was assumed
    units: Units  # of the file; everything in memory is metres
    units_stated: bool  # the format, the file or the user says so; False: metres were assumed
    #: Of a scanner's position that was found from the points, metres; None where it is stated or assumed.
    origin_sigma: tuple[float, float, float] | None = None
    #: (3, 3) rotation that sets the scan upright, of a scanner that hung or lay; None where it stood.
    upright_from_scanner: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()  # what a person should know: assumptions made, ignored fields, extensions

    @property
    def place(self) -> str:
        """The scan in messages, counted from 1 as `trihedral info` does."""
        return f"scan {self.scan_index + 1}"


def seen_from(
    header: ScanHeader, place: NDArray[np.float64], sigma: tuple[float, float, float]
) -> ScanHeader:
    """Put the scanner where the points say that it stood, (3,) metres, with a note that it was found."""
    at = ", ".join(f"{value:.4f}" for value in place)
    worst = max(sigma) * 1e3
    note = f"scanner origin found from the points: ({at}) m, sigma {worst:.1f} mm"
    kept = [said for said in header.notes if said != ORIGIN_ASSUMED]
    return replace(header, scanner_origin=place, origin_sigma=sigma, notes=(*kept, note))


@dataclass(frozen=True)
class Scan:
    """The valid points of one station; points without a return are left out.

    Attributes
    ----------
    header
        Where it comes from.
    xyz
        (N, 3) float32, metres, station coordinates minus `local_origin`.
    local_origin
        (3,) float64, metres; zero unless station coordinates are too large for float32.
    intensity
        (N,) float32 scaled to 0..1 by the limits that the file states (or its extremes), or None.
    color
        (N, 3) uint8 red, green, blue, or None.
    row, column
        (N,) int32 grid indices of a structured scan, or None.
    colored
        (N,) points whose colour is known, others are black; None for all of them.
    """

    header: ScanHeader
    xyz: NDArray[np.float32]
    local_origin: NDArray[np.float64]
    intensity: NDArray[np.float32] | None = None
    color: NDArray[np.uint8] | None = None
    row: NDArray[np.int32] | None = None
    column: NDArray[np.int32] | None = None
    colored: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.xyz)
