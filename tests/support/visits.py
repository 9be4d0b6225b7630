"""Scans of small places as a job has them: prepared, with or without what surfaces look like, and linked."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from trihedral.geometry.se3 import inverse
from trihedral.model.link import Link
from trihedral.model.registration import Registration
from trihedral.model.station import Station
from trihedral.network.solve import solve
from trihedral.pair.auto import AutoOptions, register_pair
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.preparation import PrepareOptions, prepare
from trihedral.scan.prepared import Prepared
from trihedral.simulate import ScannerOptions, SimulatedScan
from trihedral.simulate.mesh import Mesh, placement
from trihedral.simulate.scanner import scan
from trihedral.simulate.scene import Light
from trihedral.simulate.snapshot import Snapshot
from trihedral.simulate.tracer import Tracer

Appearance = Literal["color", "intensity"]
SCANNER = ScannerOptions().with_beams(80_000)
# As many points an element as scans of a million have with the default.
OPTIONS = PrepareOptions(surfels=8_000)
LIGHT = Light((0.62, 0.60, 0.56), 0.05, (0.18, 0.18, 0.18), (0.2, 0.45, 0.87))


@dataclass(frozen=True)
class Visit:
    """One scan of a place; `measured` has all that the scanner can note, `prepared` what it did note."""

    name: str
    header: ScanHeader
    measured: SimulatedScan
    prepared: Prepared

    @property
    def pose(self) -> np.ndarray:
        """place_from_station."""
        return self.measured.project_from_station


def visit(
    name: str, place: Mesh, x: float, y: float, heading_deg: float, appearance: tuple[Appearance, ...] = ()
) -> Visit:
    """Scan a place from 1.6 m above its floor; `appearance` is what the scanner notes beside points."""
    pose = placement(x, y, 1.6, math.radians(heading_deg))
    measured = scan(Snapshot(Tracer(place), len(place), LIGHT), pose, SCANNER, tuple(name.encode()), name)
    header = ScanHeader(
        Path(f"{name}.e57"), 0, name, "e57", len(measured), None, "color" in appearance, "intensity" in appearance, 0,
        None, np.zeros(3), True, "m", True,
    )  # fmt: skip
    found = Scan(
        header,
        measured.xyz,
        np.zeros(3),
        intensity=measured.intensity if "intensity" in appearance else None,
        color=measured.color if "color" in appearance else None,
        row=measured.row,
        column=measured.column,
    )
    return Visit(name, header, measured, prepare(found, OPTIONS))


def truth(a: Visit, b: Visit) -> np.ndarray:
    """`b_from_a`."""
    return inverse(b.pose) @ a.pose


def linked(a: Visit, b: Visit) -> Link:
    """The whole method for a pair, with the names that a job gives."""
    return Link.named(register_pair(a.prepared, b.prepared, AutoOptions()), a.name, b.name)


def solved(visits: Iterable[Visit], links: Iterable[Link]) -> Registration:
    """What a job makes of the links."""
    members = [Station(v.name, v.header, len(v.measured), v.name) for v in visits]
    return solve(members, list(links))
