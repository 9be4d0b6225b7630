"""Scans with known truth: scenes, a scanner, stations, files.

In: the name of a scene, a seed, a number of stations, `ScannerOptions`. Out: `Site`,
which yields a `SimulatedScan` a station, each with its true pose; `write_site` puts them into a folder with
`truth.json`.
"""

from trihedral.simulate.demo import demo_site
from trihedral.simulate.export_files import parse_variant, write_exports
from trihedral.simulate.files import write_site
from trihedral.simulate.returns import ReturnKind
from trihedral.simulate.rig import RigOptions
from trihedral.simulate.scanner import SimulatedScan
from trihedral.simulate.scanner_options import ScannerOptions
from trihedral.simulate.scenes import SCENES
from trihedral.simulate.site import Site, make_site
from trihedral.simulate.survey import make_testbed
from trihedral.simulate.testbed_files import write_testbed
from trihedral.simulate.testbeds import TESTBEDS

__all__ = [
    "SCENES",
    "TESTBEDS",
    "ReturnKind",
    "RigOptions",
    "ScannerOptions",
    "SimulatedScan",
    "Site",
    "demo_site",
    "make_site",
    "make_testbed",
    "parse_variant",
    "write_exports",
    "write_site",
    "write_testbed",
]
