"""What the user says about files that do not say it themselves."""

import math
from dataclasses import dataclass

from trihedral.errors import OptionError
from trihedral.scan.scan import METRES_PER_UNIT, Units


@dataclass(frozen=True)
class ReadOptions:
    """Facts that override what a file says or leaves out."""

    #: Unit of the coordinates in the files; None: what the file or its format says.
    units: Units | None = None
    #: Position of the scanner, metres, station coordinates; None: what the file says.
    scanner_origin: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.units is not None and self.units not in METRES_PER_UNIT:
            raise OptionError(f"units are one of {', '.join(METRES_PER_UNIT)}, not {self.units!r}")
        origin = self.scanner_origin
        if origin is not None and (len(origin) != 3 or not all(math.isfinite(value) for value in origin)):
            raise OptionError(f"a scanner origin is three finite numbers in metres, not {origin!r}")
