"""What writes scans: points go out in project coordinates, a block at a time.

The `write` of a format's module takes a path, scans one at a time, and their `Content`. The file appears when it
is complete; `OutputError` says why it cannot be written, as where a file is already.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import creating
from trihedral.scan import Scan

# Points that are transformed and written at a time.
_BLOCK = 1 << 19


@dataclass(frozen=True)
class PlacedScan:
    """A scan and where it stands."""

    name: str
    scan: Scan
    #: Project_from_station, 4x4.
    pose: NDArray[np.float64]


@dataclass(frozen=True)
class Content:
    """What a file is to hold; its header says so before the first scan has been read."""

    points: int
    color: bool
    intensity: bool
    #: Position (3,) of each scanner, project coordinates, metres.
    scanners: tuple[NDArray[np.float64], ...]
    #: Coordinate reference system of the project, name or WKT.
    crs: str | None = None

    @property
    def reach(self) -> float:
        """The largest coordinate of a scanner, metres."""
        return max((float(np.abs(position).max()) for position in self.scanners), default=0.0)


@dataclass(frozen=True)
class Block:
    """Some points of one scan, in project coordinates."""

    #: Place of the scan in the file, from 0.
    station: int
    #: (N, 3) metres.
    xyz: NDArray[np.float64]
    #: (N,) 0..1.
    intensity: NDArray[np.float32] | None
    #: (N, 3).
    color: NDArray[np.uint8] | None

    def intensity_or_zero(self) -> NDArray[np.float32]:
        """(N,) 0..1; zero where the scan has none but another one of the file has."""
        return np.zeros(len(self.xyz), np.float32) if self.intensity is None else self.intensity

    def color_or_black(self) -> NDArray[np.uint8]:
        """(N, 3); black where the scan has none but another one of the file has."""
        return np.zeros((len(self.xyz), 3), np.uint8) if self.color is None else self.color


def blocks(scans: Iterable[PlacedScan]) -> Iterator[Block]:
    """Transform scan after scan; only one is held."""
    for station, placed in enumerate(scans):
        scan = placed.scan
        rotation = placed.pose[:3, :3]
        translation = placed.pose[:3, 3] + rotation @ scan.local_origin
        for start in range(0, len(scan), _BLOCK):
            part = slice(start, start + _BLOCK)
            yield Block(
                station,
                scan.xyz[part].astype(np.float64) @ rotation.T + translation,
                None if scan.intensity is None else scan.intensity[part],
                None if scan.color is None else scan.color[part],
            )


def write_records(
    path: Path, header: Sequence[str], layout: np.dtype[Any], scans: Iterable[PlacedScan]
) -> None:
    """Write lines of a header and one binary record a point.

    Records have `x`, `y`, `z` and what else `layout` names: `intensity`; colour as `red`, `green`, `blue`, or
    packed into `rgb`.
    """
    names = layout.names or ()
    with creating(path) as temporary, temporary.open("wb") as stream:
        stream.write(("\n".join(header) + "\n").encode())
        for block in blocks(scans):
            records = np.empty(len(block.xyz), layout)
            records["x"], records["y"], records["z"] = block.xyz.T
            if "intensity" in names:
                records["intensity"] = block.intensity_or_zero()
            if "red" in names:
                records["red"], records["green"], records["blue"] = block.color_or_black().T
            if "rgb" in names:
                red, green, blue = block.color_or_black().astype(np.uint32).T
                records["rgb"] = red << 16 | green << 8 | blue
            stream.write(records.tobytes())
