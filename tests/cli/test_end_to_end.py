"""The whole way, as a person goes it: simulated scans in, poses out, compared with the truth."""

import re
import subprocess
import sys
from pathlib import Path

COMMAND = Path(sys.executable).with_name("trihedral")


def run(*arguments):
    return subprocess.run([COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=300)


def test_the_demo_shows_its_deviation_and_what_it_leaves_can_be_exported(tmp_path):
    out = tmp_path / "demo"
    done = run("demo", "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    millimetres = [float(mm) for mm in re.findall(r"^  \w+ +([\d.]+) mm", done.stdout, re.MULTILINE)]
    assert millimetres, "at least two scans hang together"
    assert millimetres == sorted(millimetres, reverse=True)
    assert millimetres[0] < 10.0, "a scan that is placed is placed rightly"
    missing = re.findall(r"^  \w+ +(?:not placed|placed apart)", done.stdout, re.MULTILINE)
    assert len(millimetres) + 1 + len(missing) == 5
    assert bool(missing) == (done.returncode == 3)
    assert (out / "picture.png").read_bytes().startswith(b"\x89PNG")
    for name in ("report.html", "registration.json", "poses.csv", "scans/truth.json"):
        assert (out / name).stat().st_size > 0

    again = run("demo", "--out", out)
    assert again.returncode == done.returncode, again.stderr
    assert again.stdout == done.stdout

    written = run("export", out, "--format", "ply", "-o", tmp_path / "ply")
    assert written.returncode == 0, written.stderr
    assert len(written.stdout.splitlines()) == len(millimetres) + 1
