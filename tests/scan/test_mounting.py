"""Which way is up in scans that stand, hang, lie, or have other axes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.room import room_scan
from trihedral import register
from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import distance
from trihedral.model.link import LinkVerdict
from trihedral.pair.auto import AutoOptions, register_pair
from trihedral.scan import Scan
from trihedral.scan.preparation import prepare
from trihedral.simulate import ScannerOptions, make_site

Z = np.array([0.0, 0.0, 1.0])
MOUNTED = {
    "standing": np.eye(3),
    "leaning": Rotation.from_euler("xy", [9.0, -12.0], degrees=True).as_matrix(),
    "y up": Rotation.from_euler("x", -90.0, degrees=True).as_matrix(),
    "hanging": np.diag([1.0, -1.0, -1.0]),
    "on its other side": Rotation.from_euler("zy", [70.0, -90.0], degrees=True).as_matrix(),
    "on its side": Rotation.from_euler("zy", [70.0, 90.0], degrees=True).as_matrix(),
    "on its side and leaning": Rotation.from_euler("zyx", [130.0, 80.0, 7.0], degrees=True).as_matrix(),
}


@pytest.fixture(scope="module")
def scans() -> tuple[list[Scan], Float64]:
    header = room_scan(step=10).header
    made = list(make_site("office", 11, 2, ScannerOptions().with_beams(300_000), overlap=(0.5, 0.9)))
    one, other = (Scan(header, scan.xyz, np.zeros(3), intensity=scan.intensity) for scan in made)
    return [one, other], np.linalg.inv(made[1].project_from_station) @ made[0].project_from_station


def mounted(scan: Scan, how: str) -> Scan:
    return replace(scan, xyz=(scan.xyz @ MOUNTED[how].T).astype(np.float32))


@pytest.mark.parametrize("how", MOUNTED)
def test_what_is_up_is_found_from_the_surface(scans: tuple[list[Scan], Float64], how: str) -> None:
    for scan in scans[0]:
        found = prepare(mounted(scan, how))
        assert found.mounting.standing == (how in ("standing", "leaning", "hanging"))
        assert found.mounting.either_way == (how not in ("standing", "leaning"))
        assert found.mounting.standing != any("up is" in note for note in found.notes)
        # A lean is left to the hypotheses, and the surface does not say whether up or down is up.
        off = np.degrees(np.arccos(np.abs(found.mounting.upright_from_scanner[:, 2] @ MOUNTED[how] @ Z)))
        assert off.min() < 2.0 or how == "leaning"


@pytest.mark.parametrize(
    ("of_one", "of_other"),
    [
        ("y up", "y up"),
        ("on its side", "standing"),
        ("on its other side", "hanging"),
        ("hanging", "standing"),
        ("standing", "hanging"),
    ],
)
def test_a_pair_is_registered_however_its_scanners_are_mounted(
    scans: tuple[list[Scan], Float64], of_one: str, of_other: str
) -> None:
    (one, other), truth = scans
    turned = np.eye(4)
    turned[:3, :3] = MOUNTED[of_other] @ truth[:3, :3] @ MOUNTED[of_one].T
    turned[:3, 3] = MOUNTED[of_other] @ truth[:3, 3]
    found = register_pair(prepare(mounted(one, of_one)), prepare(mounted(other, of_other)), AutoOptions())
    assert found.verdict is LinkVerdict.ACCEPTED, found.reason
    metres, radians = distance(found.estimate.transform, turned)
    assert metres < 0.002 and radians < np.radians(0.02)


def test_what_is_up_is_z_in_the_frame_of_a_job_whose_files_have_y_up(
    scans: tuple[list[Scan], Float64], tmp_path
) -> None:
    paths = [tmp_path / "one.xyz", tmp_path / "other.xyz"]
    for path, scan in zip(paths, scans[0], strict=True):
        np.savetxt(path, mounted(scan, "y up").xyz, fmt="%.4f")
    result = register(paths)
    assert "set upright" in result.registration.frame.text
    for station in result.stations.values():
        assert station.pose is not None
        up = station.pose[:3, :3] @ MOUNTED["y up"] @ Z
        assert up[2] > 0.9999


def test_a_job_has_z_up_beside_a_scanner_that_hangs(scans: tuple[list[Scan], Float64], tmp_path) -> None:
    one, other = scans[0]
    # The one with the most points and links carries the frame.
    half = np.arange(len(one.xyz)) % 2 == 0
    stood = {"b": one.xyz[half], "c": one.xyz[~half], "a": mounted(other, "hanging").xyz}
    for name, xyz in stood.items():
        np.savetxt(tmp_path / f"{name}.xyz", xyz, fmt="%.4f")
    result = register([tmp_path])
    for name, up in {"b": Z, "c": Z, "a": -Z}.items():
        pose = result.stations[name].pose
        assert pose is not None
        assert (pose[:3, :3] @ up)[2] > 0.999
