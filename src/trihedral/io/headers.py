"""Headers of formats that leave units and scanner origin open."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral.io.options import ReadOptions
from trihedral.scan import ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT, ORIGIN_ASSUMED, Units

_KNOWN = {
    *("x", "y", "z", "intensity", "i", "reflectance", "remission", "rgb", "rgba"),
    *("r", "g", "b", "red", "green", "blue"),
}


def loose_header(
    path: Path,
    kind: str,
    options: ReadOptions,
    *,
    points: int | None,
    has_color: bool,
    has_intensity: bool,
    grid: tuple[int, int] | None = None,
    scan_index: int = 0,
    scans: int = 1,
    file_pose: NDArray[np.float64] | None = None,
    origin: NDArray[np.float64] | None = None,
    units: Units | None = None,
    fields: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> ScanHeader:
    """Build a header, with notes on what had to be assumed.

    Parameters
    ----------
    scans
        Number of scans in the file; several are named after their place in it.
    origin
        Scanner position that the file states, (3,) in units of the file; None if it states none.
    units
        What the file or its format states; None if neither does.
    fields
        Names of all values stored with a point; those that are not used are named in a note.
    """
    chosen, said_of_units = _units(units, options)
    asked = options.origin_of(path, scan_index)
    scanner, said_of_origin = _scanner(origin, METRES_PER_UNIT[chosen], asked)
    ignored = [field for field in fields if not _used(field)]
    said_of_fields = ["fields not used: " + ", ".join(ignored)] if ignored else []
    return ScanHeader(
        source=path,
        scan_index=scan_index,
        name=path.stem if scans == 1 else f"{path.stem}-{scan_index + 1}",
        format=kind,
        points=points,
        grid=grid,
        has_color=has_color,
        has_intensity=has_intensity,
        photos=0,
        file_pose=file_pose,
        scanner_origin=scanner,
        origin_stated=asked is not None or origin is not None,
        units=chosen,
        units_stated=options.units is not None or units is not None,
        notes=(*notes, *said_of_units, *said_of_origin, *said_of_fields),
    )


def _units(stated: Units | None, options: ReadOptions) -> tuple[Units, list[str]]:
    """Choose the units, and note what is doubtful."""
    if options.units is None:
        return (stated, []) if stated is not None else ("m", ["units are not stated: metres assumed"])
    contradicted = stated not in (None, options.units)
    notes = [f"the file says units are {stated}; {options.units} was asked for"] if contradicted else []
    return options.units, notes


def _scanner(
    stated: NDArray[np.float64] | None, metres_per_unit: float, asked: tuple[float, float, float] | None
) -> tuple[NDArray[np.float64], list[str]]:
    """Choose the scanner's position (3,), metres, and note what is doubtful."""
    if asked is not None:
        said = "the file says where the scanner stood; another place was asked for"
        return np.array(asked, dtype=np.float64), [said] if stated is not None else []
    if stated is None:
        return np.zeros(3), [ORIGIN_ASSUMED]
    return np.asarray(stated, dtype=np.float64) * metres_per_unit, []


def _used(field: str) -> bool:
    return field.lower().removeprefix("scalar_").removeprefix("diffuse_") in _KNOWN
