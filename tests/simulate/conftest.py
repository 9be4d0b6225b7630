from functools import cache

import pytest

from trihedral.simulate import ScannerOptions, SimulatedScan, Site, make_site

BEAMS = 150_000


@cache
def small_site(scene: str) -> tuple[Site, tuple[SimulatedScan, ...]]:
    site = make_site(scene, 2, 3, ScannerOptions().with_beams(BEAMS), overlap=(0.5, 0.9))
    return site, tuple(site)


@pytest.fixture(params=["facade", "office", "site"])
def scanned(request: pytest.FixtureRequest) -> tuple[Site, tuple[SimulatedScan, ...]]:
    """Three scans of each of the three scenes that differ most, in turn."""
    return small_site(request.param)
