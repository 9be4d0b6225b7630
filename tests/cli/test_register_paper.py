"""`register --method paper` as a command, from a rig's raw files to poses and report."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trihedral.geometry.se3 import distance, inverse
from trihedral.io import read_headers
from trihedral.simulate import RigOptions, make_testbed, write_testbed


def register(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "trihedral", "register", "-q", "--method", "paper", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two stations 3 m apart in a room."""
    folder = tmp_path_factory.mktemp("rigs")
    survey = make_testbed("testbed3", 1, RigOptions(points=80_000, picture_size=(640, 480)))
    for _ in write_testbed(survey, folder):
        pass
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job that several runs go on in: what they prepared is there for the next."""
    return tmp_path_factory.mktemp("job") / "out"


def link_of(out: Path) -> dict[str, Any]:
    (link,) = json.loads((out / "registration.json").read_text())["links"]
    return dict(link)


def off(link: dict[str, Any], rigs: Path, key: str = "transform") -> tuple[float, float]:
    """Metres and degrees between a link's pose and the true one."""
    stations = json.loads((rigs / "truth.json").read_text())["stations"]
    true = {station["name"]: np.array(station["project_from_station"]) for station in stations}
    metres, radians = distance(np.array(link[key]), inverse(true[link["to"]]) @ true[link["from"]])
    return metres, float(np.degrees(radians))


@pytest.mark.parametrize(
    "final, method, limit_m, limit_deg", [("planes", "plane-matching", 0.02, 0.1), ("icp", "icp", 0.1, 0.5)]
)
def test_two_rig_scans_to_poses_and_a_report(
    rigs: Path, out: Path, final: str, method: str, limit_m: float, limit_deg: float
) -> None:
    done = register(rigs, "-o", out, "--final", final, "--reference", rigs / "truth.json")
    assert done.returncode in (0, 4), done.stdout + done.stderr
    link = link_of(out)
    assert (link["verdict"], link["method"]) == ("accepted", method)
    metres, degrees = off(link, rigs)
    assert metres < limit_m and degrees < limit_deg
    start = off(link, rigs, "initial_transform")
    assert start[0] < 0.3 and start[1] < 3.0

    evidence = link["evidence"]
    visual = evidence["visual"]
    assert visual["rendered"] == {"from": False, "to": False}
    assert visual["agreeing"] >= 8 and 1 <= len(visual["pairs"]) <= 3
    assert visual["picture_pairs"] == 64
    assert 0.5 < evidence["overlap_initial"]["to"] <= 1.0
    if final == "planes":
        planes = evidence["planes"]
        normals = np.array([plane["normal"] for plane in planes["to"]])
        assert abs(np.linalg.det(normals)) > 0.3
        corner = np.array(link["transform"]) @ [*planes["corner_from"], 1.0]
        assert corner[:3] == pytest.approx(planes["corner_to"], abs=1e-6)
    else:
        assert evidence["icp"]["matched"] > 1000

    measured = link["against_reference"]
    assert measured["final_rmse_m"] < limit_m
    assert np.abs(measured["final_deg"]).max() < limit_deg
    assert measured["initial_rmse_m"] is not None
    poses = (out / "poses.csv").read_text().splitlines()
    assert len(poses) == 3

    html = (out / "report.html").read_text()
    assert len(re.findall(r"data:image/jpeg;base64,", html)) >= 2
    for name in (visual["pairs"][0]["from_picture"], visual["pairs"][0]["to_picture"]):
        assert name in html


def test_the_same_command_again_gives_the_same(rigs: Path, out: Path) -> None:
    first = register(rigs, "-o", out)
    before = (out / "poses.csv").read_bytes()
    again = register(rigs, "-o", out)
    assert (again.returncode, again.stdout) == (first.returncode, first.stdout)
    assert (out / "poses.csv").read_bytes() == before


def broken(rigs: Path, folder: Path, pattern: str, replacement: str) -> Path:
    """A rig file beside the others with one line changed; its profiles and pictures are those of scan-10."""
    text = (rigs / "scan-10.toml").read_text()
    text, count = re.subn(pattern, replacement, text, count=1, flags=re.MULTILINE)
    assert count == 1
    text = re.sub(r'"(scan-10-[^"]*)"', lambda found: f'"{rigs / found[1]}"', text)
    path = folder / "broken.toml"
    path.write_text(text)
    return path


def profiles_cut(rigs: Path, folder: Path) -> Path:
    with np.load(rigs / "scan-10-line-1.npz") as stored:
        arrays = dict(stored)
    arrays["body_angle_deg"] = arrays["body_angle_deg"][:-1]
    np.savez(folder / "cut.npz", **arrays)
    return broken(rigs, folder, r'^profiles = "scan-10-line-1.npz"', f'profiles = "{folder / "cut.npz"}"')


BAD = {
    "no focal length": (
        lambda rigs, folder: broken(rigs, folder, r"^focal_px = .*\n", ""),
        r"broken\.toml: camera 1, focal_px: it is missing",
    ),
    "another size": (
        lambda rigs, folder: broken(rigs, folder, r"^width = 640", "width = 320"),
        r"scan-10-00\.jpg, width, height: the picture has 640 x 480 pixels, its camera is calibrated for 320 x 480",
    ),
    "profiles and angles": (
        profiles_cut,
        r"cut\.npz, range_m, body_angle_deg: there are \d+ profiles and \d+ body angles",
    ),
    "nothing seen": (
        lambda rigs, folder: broken(
            rigs,
            folder,
            r"^body_from_camera = \[\n(.*\n){4}\]",
            "mounting = {position_m = [0, 0, 90], heading_deg = 0}",
        ),
        r"broken\.toml: picture, body_angle_deg; camera, body_from_camera or mounting: "
        r"no picture sees any point of the scan",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_rig_that_cannot_be_is_named_and_the_others_are_registered(
    rigs: Path, tmp_path: Path, case: str
) -> None:
    change, message = BAD[case]
    bad = change(rigs, tmp_path)
    alone = register(bad, "-o", tmp_path / "alone")
    assert alone.returncode == 2, alone.stdout
    assert re.search(message, alone.stderr), alone.stderr
    assert "Traceback" not in alone.stderr

    good = rigs / "scan-11.toml"
    done = register(bad, good, "-o", tmp_path / "out")
    assert done.returncode == 3, done.stdout + done.stderr
    document = json.loads((tmp_path / "out" / "registration.json").read_text())
    assert [station["name"] for station in document["stations"] if station["pose"]] == [
        read_headers(good)[0].name
    ]
    assert re.search(message, done.stdout + done.stderr)
