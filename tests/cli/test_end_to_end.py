"""The whole way, as a person goes it: simulated scans in, poses out, compared with the truth."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import trihedral
from trihedral.simulate import ScannerOptions, make_site, write_site

COMMAND = Path(sys.executable).with_name("trihedral")


def run(*arguments, **options):
    return subprocess.run(
        [COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=300, **options
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    scanner = ScannerOptions().with_beams(250_000)
    for _ in write_site(make_site("office", 5, 4, scanner, overlap=(0.4, 0.8)), folder):
        pass
    return folder


@pytest.fixture(scope="module")
def registered(site, tmp_path_factory):
    out = tmp_path_factory.mktemp("registered") / "out"
    done = run("register", site, "-o", out, "--threads", 2)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def truth(site: Path) -> dict[str, np.ndarray]:
    stations = json.loads((site / "truth.json").read_text())["stations"]
    return {s["name"]: np.array(s["project_from_station"]) for s in stations}


def deviations(found: dict[str, np.ndarray], true: dict[str, np.ndarray]) -> dict[str, tuple[float, float]]:
    """Metres and degrees from the truth, both seen from the first station."""
    base = next(iter(found))
    off = {}
    for name, pose in found.items():
        difference = np.linalg.inv(np.linalg.inv(true[base]) @ true[name]) @ np.linalg.inv(found[base]) @ pose
        cosine = np.clip((np.trace(difference[:3, :3]) - 1) / 2, -1, 1)
        off[name] = float(np.linalg.norm(difference[:3, 3])), float(np.degrees(np.arccos(cosine)))
    return off


def stable(out: Path) -> dict:
    document = json.loads((out / "registration.json").read_text())
    del document["timing"]
    for link in document["links"]:
        del link["seconds"]
    return document


def test_every_station_is_where_it_truly_stood(site, registered):
    stations = json.loads((registered / "registration.json").read_text())["stations"]
    found = {s["name"]: np.array(s["pose"]) for s in stations}
    assert len(found) == 4
    for name, (metres, degrees) in deviations(found, truth(site)).items():
        assert metres < 0.010 and degrees < 0.05, (name, metres, degrees)


def test_neither_the_order_of_the_files_nor_the_threads_change_a_bit(site, registered, tmp_path):
    files = sorted(site.glob("*.e57"), reverse=True)
    done = run("register", *files, "-o", tmp_path / "out", "--threads", 1)
    assert done.returncode == 0, done.stderr
    assert stable(tmp_path / "out") == stable(registered)
    assert (tmp_path / "out/poses.csv").read_bytes() == (registered / "poses.csv").read_bytes()


def test_names_carry_no_meaning(site, registered, tmp_path):
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    new = {}
    for file, name in zip(sorted(site.glob("*.e57")), ("t2", "t4", "t1", "t3"), strict=True):
        os.link(file, mixed / f"{name}.e57")
        new[file.stem] = name
    result = trihedral.register(mixed)
    before = {s["name"]: np.array(s["pose"]) for s in stable(registered)["stations"]}
    found = {old: result.stations[name].pose for old, name in new.items()}
    for name, (metres, degrees) in deviations(found, before).items():
        assert metres < 1e-4 and degrees < 1e-3, (name, metres, degrees)


def test_a_file_that_is_cut_short_loses_only_itself(site, tmp_path):
    files = sorted(site.glob("*.e57"))
    short = tmp_path / "short.e57"
    short.write_bytes(files[0].read_bytes()[: files[0].stat().st_size // 2])
    done = run("register", *files, short, "-o", tmp_path / "out", "--quiet")
    assert done.returncode == 3
    assert done.stdout.startswith("INCOMPLETE: 4 of 5 scans placed; missing: ")
    assert f"{short}: " in done.stderr


def test_what_is_exported_is_in_one_frame(site, registered, tmp_path):
    done = run("export", registered, "--format", "ply", "-o", tmp_path / "ply")
    assert done.returncode == 0, done.stderr
    for line in done.stdout.splitlines():
        assert Path(line).stat().st_size > 250_000


def test_the_demo_shows_its_deviation_and_leaves_report_and_picture(tmp_path):
    done = run("demo", "--out", tmp_path / "demo")
    assert done.returncode == 0, done.stdout + done.stderr
    millimetres = [float(mm) for mm in re.findall(r"^  \w+ +([\d.]+) mm", done.stdout, re.MULTILINE)]
    assert len(millimetres) == 4
    assert millimetres == sorted(millimetres, reverse=True)
    assert millimetres[0] < 10.0
    assert (tmp_path / "demo/picture.png").read_bytes().startswith(b"\x89PNG")
    for name in ("report.html", "registration.json", "poses.csv", "scans/truth.json"):
        assert (tmp_path / "demo" / name).stat().st_size > 0
