"""Real scans of a facade by the command: placed, killed in mid-work, shuffled, with a damaged one among them."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

COMMAND = Path(sys.executable).with_name("trihedral")


@pytest.fixture(scope="module")
def facade(shared):
    return shared / "data" / "eth-facade"


@pytest.fixture(scope="module")
def four(facade):
    return [facade / f"s{k}.pcd" for k in range(4)]


@pytest.fixture(scope="module")
def registered(four, tmp_path_factory):
    """The first four scans, registered on two threads."""
    out = tmp_path_factory.mktemp("facade") / "out"
    done = register(*four, "-o", out, "--threads", 2)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def register(*arguments):
    command = [COMMAND, "register", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def stable(out: Path) -> dict:
    """registration.json without what is time."""
    document = json.loads((out / "registration.json").read_text())
    del document["timing"]
    for link in document["links"]:
        del link["seconds"]
    return document


def poses(out: Path) -> dict[str, np.ndarray]:
    return {s["name"]: np.array(s["pose"]) for s in stable(out)["stations"] if s["pose"] is not None}


def off(
    found: dict[str, np.ndarray], true: dict[str, np.ndarray], base: str
) -> dict[str, tuple[float, float]]:
    """Metres and degrees between two sets of poses, each seen from the same station."""
    result = {}
    for name, pose in found.items():
        difference = np.linalg.inv(np.linalg.inv(true[base]) @ true[name]) @ np.linalg.inv(found[base]) @ pose
        cosine = np.clip((np.trace(difference[:3, :3]) - 1) / 2, -1, 1)
        result[name] = float(np.linalg.norm(difference[:3, 3])), float(np.degrees(np.arccos(cosine)))
    return result


def published(facade: Path) -> dict[str, np.ndarray]:
    stations = json.loads((facade / "truth.json").read_text())["stations"]
    return {Path(s["file"]).stem: np.array(s["project_from_station"]) for s in stations}


def test_all_seven_are_placed_where_they_stood(facade, tmp_path):
    assert register(facade, "-o", tmp_path / "out").returncode == 0
    found = poses(tmp_path / "out")
    assert set(found) == {f"s{k}" for k in range(7)}
    for name, (metres, degrees) in off(found, published(facade), "s0").items():
        assert metres < 0.03 and degrees < 0.1, (name, metres, degrees)


def test_neither_the_order_of_the_files_nor_the_threads_change_a_bit(four, registered, tmp_path):
    assert register(*reversed(four), "-o", tmp_path / "out", "--threads", 1).returncode == 0
    assert stable(tmp_path / "out") == stable(registered)
    assert (tmp_path / "out/poses.csv").read_bytes() == (registered / "poses.csv").read_bytes()


def test_names_carry_no_meaning(four, registered, tmp_path):
    new = dict(zip(("s0", "s1", "s2", "s3"), ("t2", "t4", "t1", "t3"), strict=True))
    for file in four:
        (tmp_path / f"{new[file.stem]}.pcd").symlink_to(file.resolve())
    assert register(*tmp_path.glob("*.pcd"), "-o", tmp_path / "out").returncode == 0
    renamed = poses(tmp_path / "out")
    found = {old: renamed[name] for old, name in new.items()}
    for name, (metres, degrees) in off(found, poses(registered), "s0").items():
        assert metres < 1e-9 and degrees < 1e-4, (name, metres, degrees)


def test_a_run_that_was_killed_goes_on_to_the_same_result(four, registered, tmp_path):
    out = tmp_path / "out"
    first = subprocess.Popen(
        [COMMAND, "register", *four, "-o", out, "--json-progress"], stderr=subprocess.PIPE, text=True
    )
    for line in first.stderr:
        if "Registering pairs" in line:
            break
    time.sleep(0.3)
    first.kill()
    first.communicate()
    assert not (out / "registration.json").exists()
    prepared = {path: path.stat().st_mtime_ns for path in out.rglob("*.npz")}
    assert len(prepared) == 4
    assert register(*four, "-o", out).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.npz")} == prepared
    assert stable(out) == stable(registered)


def test_one_file_cut_short_among_them_is_named_and_the_others_are_placed(four, registered, tmp_path):
    whole = four[3].read_bytes()
    short = tmp_path / "short.pcd"
    short.write_bytes(whole[: len(whole) // 2])
    done = register(*four, short, "-o", tmp_path / "out")
    assert done.returncode == 3
    assert f"{short}: " in done.stderr
    assert all(
        np.array_equal(pose, poses(registered)[name]) for name, pose in poses(tmp_path / "out").items()
    )
    assert len(poses(tmp_path / "out")) == 4
