"""What the user says about files that do not say it themselves."""

import math
from dataclasses import dataclass
from pathlib import Path

from trihedral.errors import OptionError
from trihedral.scan.scan import METRES_PER_UNIT, Units

Place = tuple[float, float, float]


@dataclass(frozen=True)
class ReadOptions:
    """Facts that override what a file says or leaves out."""

    #: Unit of the coordinates in the files; None: what the file or its format says.
    units: Units | None = None
    #: Position of the scanner, metres, station coordinates; None: what the file says.
    scanner_origin: Place | None = None
    #: The same of single files, by their names, with or without suffix, and "/2" for the second scan in one.
    scanner_origins: tuple[tuple[str, Place], ...] = ()

    def __post_init__(self) -> None:
        if self.units is not None and self.units not in METRES_PER_UNIT:
            raise OptionError(f"units are one of {', '.join(METRES_PER_UNIT)}, not {self.units!r}")
        of_all = [] if self.scanner_origin is None else [self.scanner_origin]
        for origin in [*of_all, *(place for _, place in self.scanner_origins)]:
            if len(origin) != 3 or not all(math.isfinite(value) for value in origin):
                raise OptionError(f"a scanner origin is three finite numbers in metres, not {origin!r}")

    def origin_of(self, path: Path, scan_index: int) -> Place | None:
        """Tell what is stated of a scan in a file."""
        stated = dict(self.scanner_origins)
        for name in (path.name, path.stem):
            for key in (f"{name}/{scan_index + 1}", name):
                if key in stated:
                    return stated[key]
        return self.scanner_origin
