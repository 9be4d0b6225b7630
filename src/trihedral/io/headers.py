"""Headers of formats that leave units and scanner origin open."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral.io.options import ReadOptions
from trihedral.scan import ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT, Units

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
    name: str | None = None,
    file_pose: NDArray[np.float64] | None = None,
    origin: NDArray[np.float64] | None = None,
    units: Units | None = None,
    fields: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> ScanHeader:
    """Build a header, with notes on what had to be assumed.

    Parameters
    ----------
    origin
        Scanner position that the file states, (3,) in units of the file; None if it states none.
    units
        What the file or its format states; None if neither does.
    fields
        Names of all values stored with a point; those that are not used are named in a note.
    """
    chosen: Units = options.units or units or "m"
    units_stated = options.units is not None or units is not None
    said = list(notes)
    if options.units is not None and units is not None and options.units != units:
        said.append(f"the file says units are {units}; {options.units} was asked for")
    if not units_stated:
        said.append("units are not stated: metres assumed")
    if options.scanner_origin is not None:
        scanner = np.array(options.scanner_origin, dtype=np.float64)
    elif origin is not None:
        scanner = np.asarray(origin, dtype=np.float64) * METRES_PER_UNIT[chosen]
    else:
        scanner = np.zeros(3)
        said.append("scanner origin is not stated: (0, 0, 0) assumed")
    if options.scanner_origin is not None and origin is not None:
        said.append("the file says where the scanner stood; another place was asked for")
    ignored = [field for field in fields if not _used(field)]
    if ignored:
        said.append("fields not used: " + ", ".join(ignored))
    return ScanHeader(
        source=path,
        scan_index=scan_index,
        name=name or path.stem,
        format=kind,
        points=points,
        grid=grid,
        has_color=has_color,
        has_intensity=has_intensity,
        photos=0,
        file_pose=file_pose,
        scanner_origin=scanner,
        origin_stated=options.scanner_origin is not None or origin is not None,
        units=chosen,
        units_stated=units_stated,
        notes=tuple(said),
    )


def _used(field: str) -> bool:
    return field.lower().removeprefix("scalar_").removeprefix("diffuse_") in _KNOWN
