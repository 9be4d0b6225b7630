"""Seeds, stations, movers: what a site is, apart from the exactness of its ranges."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from trihedral.errors import OptionError, TrihedralError
from trihedral.simulate import SCENES, ScannerOptions, SimulatedScan, Site, make_site
from trihedral.simulate.scenes import build

Scanned = tuple[Site, tuple[SimulatedScan, ...]]
SMALL = ScannerOptions().with_beams(15_000)

DIGEST = """
import hashlib, sys
from trihedral.simulate import ScannerOptions, make_site
for scene in sys.argv[1:]:
    digest = hashlib.sha256()
    for one in make_site(scene, 9, 2, ScannerOptions().with_beams(15_000)):
        for part in (one.xyz, one.row, one.column, one.intensity, one.color, one.project_from_station):
            digest.update(part.tobytes())
    print(digest.hexdigest())
"""


def digests(threads: str) -> list[str]:
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS", "MKL_NUM_THREADS")
    done = subprocess.run(
        [sys.executable, "-c", DIGEST, "facade", "office", "site"],
        env=dict.fromkeys(names, threads),
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    return done.stdout.split()


def test_same_seed_same_bits_in_another_process_with_other_threads() -> None:
    one, four = digests("1"), digests("4")
    assert one == four
    assert len(set(one)) == 3


def test_a_scan_does_not_depend_on_those_made_before_it() -> None:
    site = make_site("office", 4, 3, SMALL)
    last_first = site.scan(2)
    in_order = list(site)[2]
    assert last_first.xyz.tobytes() == in_order.xyz.tobytes()


@pytest.mark.parametrize("scene", list(SCENES))
def test_seeds_give_scenes_that_differ_strongly(scene: str) -> None:
    meshes = [build(scene, seed).mesh for seed in range(3)]
    sizes = [len(m) for m in meshes]
    assert len(set(sizes)) == 3
    prints = {hashlib.sha256(m.vertices.tobytes()).hexdigest() for m in meshes}
    assert len(prints) == 3
    # No scene is a small change of another: hardly any vertex is shared.
    corners = [set(map(bytes, np.ascontiguousarray(m.vertices))) for m in meshes]
    for k in range(1, 3):
        assert len(corners[0] & corners[k]) < 0.02 * len(corners[0])


def test_stations_stand_free_and_level_at_a_tripods_height(scanned: Scanned) -> None:
    site, scans = scanned
    for one, pose in zip(scans, site.poses, strict=True):
        assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) > 0
        assert np.degrees(np.arccos(pose[2, 2])) < 0.1
        assert one.true_range.min() >= site.scanner.min_range_m
        _, down = site.still.cast(pose[None, :3, 3], np.array([[0.0, 0.0, -1.0]]))
        assert 1.45 < down[0] < 1.95
        assert len(one) > 0.2 * np.prod(one.grid)


def test_tilt_is_as_asked_for() -> None:
    site = make_site("office", 4, 12, ScannerOptions(tilt_deg=20.0).with_beams(15_000))
    tilt = np.degrees(np.arccos(site.poses[:, 2, 2]))
    assert tilt.max() < 20.2
    assert tilt.max() > 8.0 and tilt.min() < 12.0
    yaw = np.arctan2(site.poses[:, 1, 0], site.poses[:, 0, 0])
    assert np.ptp(yaw) > 3.0


@pytest.mark.parametrize("scene", list(SCENES))
def test_stations_hang_together(scene: str) -> None:
    from trihedral.simulate.covisible import still_points
    from trihedral.simulate.files import pair_overlaps

    site = make_site(scene, 1, 5, SMALL)
    pairs = pair_overlaps(site, [still_points(one) for one in site])
    joined = {site.names[0]}
    for _ in site.names:
        joined |= {
            n for p in pairs if p["overlap"] > 0.2 for n in (p["a"], p["b"]) if joined & {p["a"], p["b"]}
        }
    assert joined == set(site.names)


@pytest.mark.parametrize("scene", ["facade", "site"])
def test_people_and_vehicles_are_elsewhere_in_the_next_scan(scene: str) -> None:
    site = make_site(scene, 2, 3, ScannerOptions().with_beams(60_000))
    places = []
    for one in site:
        moving = ~one.fixed
        xyz = one.xyz[moving].astype(float)
        places.append(xyz @ one.project_from_station[:3, :3].T + one.project_from_station[:3, 3])
    seen = [p for p in places if len(p) > 20]
    assert len(seen) >= 2
    cells = [set(map(tuple, np.floor(p / 0.5).astype(int))) for p in seen]
    assert len(cells[0] & cells[1]) < 0.5 * min(len(cells[0]), len(cells[1]))


def test_order_and_names_tell_nothing() -> None:
    site = make_site("office", 3, 8, SMALL)
    assert len(set(site.names)) == 8
    assert list(site.names) != sorted(site.names)
    # Neighbours in the list are not neighbours in the building.
    x = site.poses[:, 0, 3]
    assert not (np.all(np.diff(x) > 0) or np.all(np.diff(x) < 0))


def test_bad_requests_are_refused() -> None:
    with pytest.raises(OptionError, match="no scene 'moon'"):
        make_site("moon", 1, 2)
    with pytest.raises(OptionError, match="seed"):
        make_site("office", -1, 2)
    with pytest.raises(OptionError, match="stations"):
        make_site("office", 1, 0)
    with pytest.raises(OptionError, match="overlap"):
        make_site("office", 1, 2, overlap=(0.8, 0.2))
    with pytest.raises(TrihedralError, match="no room for 500"):
        make_site("corridor", 1, 500, SMALL)
