"""Seven real scans of a facade by the command: placed, killed in mid-work, one more that is damaged."""

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
def registered(facade, tmp_path_factory):
    out = tmp_path_factory.mktemp("facade") / "out"
    done = register(facade, "-o", out)
    assert done.returncode in (0, 4), done.stdout + done.stderr
    return out


def register(*arguments):
    command = [COMMAND, "register", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def stable(out: Path) -> dict:
    document = json.loads((out / "registration.json").read_text())
    del document["timing"]
    for link in document["links"]:
        del link["seconds"]
    return document


def assert_placed(out: Path, facade: Path) -> None:
    """Within 0.03 m and 0.1 degrees of the published poses, seen from s0."""
    published = json.loads((facade / "truth.json").read_text())["stations"]
    true = {Path(s["file"]).stem: np.array(s["project_from_station"]) for s in published}
    found = {s["name"]: np.array(s["pose"]) for s in stable(out)["stations"] if s["pose"] is not None}
    assert set(found) == set(true)
    for name, pose in found.items():
        difference = np.linalg.inv(true[name]) @ np.linalg.inv(found["s0"]) @ pose
        cosine = np.clip((np.trace(difference[:3, :3]) - 1) / 2, -1, 1)
        assert np.linalg.norm(difference[:3, 3]) < 0.03, name
        assert np.degrees(np.arccos(cosine)) < 0.1, name


def test_all_seven_are_placed(facade, registered):
    assert_placed(registered, facade)


def test_a_run_that_was_killed_goes_on_to_the_same_result(facade, registered, tmp_path):
    out = tmp_path / "out"
    first = subprocess.Popen(
        [COMMAND, "register", facade, "-o", out, "--json-progress"], stderr=subprocess.PIPE, text=True
    )
    for line in first.stderr:
        if "Registering pairs" in line:
            break
    time.sleep(0.5)
    first.kill()
    first.communicate()
    assert not (out / "registration.json").exists()
    prepared = {path: path.stat().st_mtime_ns for path in out.rglob("*.npz")}
    assert len(prepared) == 7
    register(facade, "-o", out)
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.npz")} == prepared
    assert stable(out) == stable(registered)


def test_one_file_cut_short_among_them_is_named_and_the_seven_are_placed(facade, tmp_path):
    whole = (facade / "s3.pcd").read_bytes()
    short = tmp_path / "short.pcd"
    short.write_bytes(whole[: len(whole) // 2])
    done = register(facade, short, "-o", tmp_path / "out")
    assert done.returncode == 3
    assert f"{short}: " in done.stderr
    assert_placed(tmp_path / "out", facade)
