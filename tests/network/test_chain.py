from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from support import links
from trihedral.geometry.se3 import inverse, motion
from trihedral.model.link import Link, LinkVerdict
from trihedral.model.station import Station, StationStatus
from trihedral.network.chain import chain
from trihedral.scan import ScanHeader

RNG = np.random.default_rng(3)
TRUE = {name: motion(Rotation.random(rng=RNG).as_matrix(), RNG.normal(scale=20, size=3)) for name in "abcde"}


def member(name: str) -> Station:
    header = ScanHeader(
        Path(f"{name}.e57"), 0, name, "e57", 9, None, False, False, 0, None, np.zeros(3), True, "m", True
    )
    return Station(name, header, 9, name)


def link(a: str, b: str, score: float, off: float = 0.0, verdict: LinkVerdict = LinkVerdict.ACCEPTED) -> Link:
    pose = motion(translation=np.array([off, 0.0, 0.0])) @ inverse(TRUE[b]) @ TRUE[a]
    return links.link(a, b, pose, verdict=verdict, method="plane-matching", evidence=links.evidence(score))


def test_stations_hang_by_their_best_links_only() -> None:
    """The weak link a-c is half a metre off: nothing of it may be in the result, as nothing is adjusted."""
    given = [link("a", "b", 0.9), link("c", "b", 0.8), link("a", "c", 0.1, off=0.5), link("c", "d", 0.5)]
    found = chain([member(name) for name in "abcde"], given)
    poses = {s.name: s.pose for s in found.stations}
    for name in "abcd":
        expected = inverse(TRUE["b"]) @ TRUE[name]
        base = inverse(poses["b"]) @ poses[name]
        np.testing.assert_allclose(base, expected, atol=1e-9)
    assert found.loops == () and found.links == tuple(given)


def test_statuses_say_that_nothing_checks_a_chain() -> None:
    given = [link("a", "b", 0.9), link("b", "c", 0.8), link("d", "e", 0.7, verdict=LinkVerdict.REFUSED)]
    found = {s.name: s for s in chain([member(name) for name in "abcde"], given).stations}
    assert {name: s.status for name, s in found.items()} == {
        **dict.fromkeys("abc", StationStatus.SINGLE_LINKED),
        **dict.fromkeys("de", StationStatus.NOT_PLACED),
    }
    np.testing.assert_array_equal(found["b"].pose, np.eye(4))
    assert "b - a" in found["a"].reason and "no loop" in found["a"].reason
    assert found["d"].pose is None


def test_parts_without_a_link_between_them_keep_their_own_frames() -> None:
    given = [link("a", "b", 0.9), link("b", "c", 0.8), link("d", "e", 0.7)]
    found = {s.name: s for s in chain([member(name) for name in "abcde"], given).stations}
    assert {name: s.component for name, s in found.items()} == {"a": 0, "b": 0, "c": 0, "d": 1, "e": 1}
    assert "own frame" in found["d"].reason or "that part's frame" in found["d"].reason


def test_one_scan_defines_the_frame() -> None:
    (station,) = chain([member("a")], []).stations
    assert np.array_equal(station.pose, np.eye(4)) and station.reason == "the only scan: it defines the frame"
