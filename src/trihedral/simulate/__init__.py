"""Scans with known truth: scenes, a scanner, stations, files.

In: the name of a scene, a seed, a number of stations, `ScannerOptions`. Out: `Site`,
which yields a `SimulatedScan` a station, each with its true pose; `write_site` puts them into a folder with
`truth.json`.
"""

from trihedral.simulate.demo import demo_site
from trihedral.simulate.files import write_site
from trihedral.simulate.scanner import ReturnKind, ScannerOptions, SimulatedScan
from trihedral.simulate.scenes import SCENES
from trihedral.simulate.site import Site, make_site

__all__ = [
    "SCENES",
    "ReturnKind",
    "ScannerOptions",
    "SimulatedScan",
    "Site",
    "demo_site",
    "make_site",
    "write_site",
]
