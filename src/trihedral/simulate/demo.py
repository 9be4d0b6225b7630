"""The small site that `trihedral demo` makes."""

from collections.abc import Callable
from pathlib import Path

from trihedral.simulate.files import write_site
from trihedral.simulate.scanner_options import ScannerOptions
from trihedral.simulate.site import make_site

DEMO_STATIONS = 5
DEMO_BEAMS = 360_000


def demo_site(out_dir: Path | str, seed: int = 4, done: Callable[[str], None] = lambda name: None) -> Path:
    """Write a small office floor of five scans; returns the path of its `truth.json`.

    `done` is told the name of each scan that is written.

    Raises
    ------
    OutputError
        The folder holds something else, or cannot be written.
    """
    site = make_site(
        "office", seed, DEMO_STATIONS, ScannerOptions().with_beams(DEMO_BEAMS), overlap=(0.4, 0.8)
    )
    for scan in write_site(site, out_dir):
        done(scan.name)
    return Path(out_dir) / "truth.json"
