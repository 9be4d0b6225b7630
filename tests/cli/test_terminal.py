"""Names of files neither command the terminal nor make up lines; every locale gives the same bytes."""

import csv
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from trihedral.export.names import file_name
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.report.result import write_poses

ODD = ("esc\x1b[31mred\x07.xyz", "=cmd|A1\nPASSED: all is well.xyz", "\udcff\u202e[red].xyz")


def command(*arguments: object, **more: object) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [sys.executable, "-m", "trihedral", *map(os.fsencode, map(str, arguments))],
        capture_output=True,
        check=False,
        **more,
    )


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    (tmp_path / "odd").mkdir()
    for name in ODD:
        (tmp_path / "odd" / name).write_text("1 2 3\n-1 2 0.5\n3 1 1\n", encoding="utf-8")
    return tmp_path / "odd"


def test_names_do_not_reach_the_terminal_as_they_are(odd: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    said = [
        command("register", odd, "-o", out, "--scanner-origin", "0,0,0"),
        command("status", out),
        command("info", odd),
        command("info", odd / ODD[0], odd / "not\x1b[31mthere"),
        command("export", out, "-f", "ply"),
        command("export", out, "-f", "ply", "one\x1b[31mtoo many"),
        command("colorize", odd / ODD[1], "-o", tmp_path / "colored"),
        command("calibrate", odd / ODD[0]),
    ]
    for done in said:
        assert b"trihedral failed" not in done.stderr
        for stream in (done.stdout, done.stderr):
            lines = stream.decode("utf-8").split("\n")
            assert all(line.isprintable() for line in lines), lines
            assert not [line for line in lines if line.startswith("PASSED")]


@pytest.mark.parametrize("verb", ["info", "status"])
def test_json_is_utf8_whatever_the_names(odd: Path, tmp_path: Path, verb: str) -> None:
    command("register", odd, "-o", tmp_path / "out", "--scanner-origin", "0,0,0")
    done = command(verb, odd if verb == "info" else tmp_path / "out", "--json")
    found = json.loads(done.stdout.decode("utf-8"))
    if verb == "info":
        assert {Path(entry["path"]).name for entry in found} == set(ODD)


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@sum", "\tx", "\rx", "'x"])
def test_no_name_is_a_formula(tmp_path: Path, name: str) -> None:
    station = {"name": name, "pose": None, "sigma_translation_m": None, "sigma_rotation_deg": None}
    write_poses({"stations": [{**station, "status": "not-placed"}]}, tmp_path / "poses.csv")
    with (tmp_path / "poses.csv").open(newline="", encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    assert row["name"] == "'" + name


@pytest.mark.parametrize(
    "name",
    [
        "CON",
        "nul.txt",
        "Com1",
        "LPT9.a",
        "-rf",
        "--help",
        "..",
        "",
        "ä" * 300,
        "\U0001f5ff" * 300,
        "a/b\\c:d",
        "a\nb",
    ],
)
def test_every_system_takes_the_names_of_files(name: str) -> None:
    made = file_name(name, "ply", set())
    assert len(os.fsencode(made)) <= 130
    assert not made.startswith(("-", "."))
    assert not re.match(r"(con|nul|com1|lpt9)\.", made, re.IGNORECASE)
    assert not set(made) & set('/\\:*?"<>|\n')


def locale_folder(folder: Path) -> Path:
    """Compile locales that the machine may lack."""
    if shutil.which("localedef") is None:
        pytest.skip("there is no localedef")
    for name, charset in (("de_DE", "ISO-8859-1"), ("tr_TR", "ISO-8859-9"), ("tr_TR", "UTF-8")):
        made = ["localedef", "-f", charset, "-i", name, str(folder / f"{name}.{charset}")]
        if subprocess.run(made, capture_output=True, check=False).returncode > 1:
            pytest.skip("the sources of locales are not installed")
    return folder


def test_every_locale_gives_the_same_bytes(tmp_path: Path) -> None:
    locales = str(locale_folder(tmp_path))
    site = tmp_path / "Gebäude"
    site.mkdir()
    rows = [f"{x} {y} {z}" for x in range(-3, 4) for y in range(-3, 4) for z in (-1, 2)]
    (site / "Büro.xyz").write_text("\n".join(rows) + "\n", encoding="utf-8")
    found = set()
    for number, environment in enumerate(
        [
            {"LC_ALL": "C.UTF-8"},
            {"LC_ALL": "de_DE.ISO-8859-1", "LOCPATH": locales},
            {"LC_ALL": "tr_TR.ISO-8859-9", "LOCPATH": locales},
            {"LC_ALL": "tr_TR.UTF-8", "LOCPATH": locales},
            {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        ]
    ):
        out = tmp_path / f"out{number}"
        done = command(
            *("register", "Gebäude", "-o", out, "--scanner-origin", "0,0,0"),
            cwd=tmp_path,
            env={**os.environ, **environment},
        )
        assert done.returncode in (0, 3, 4), done.stderr
        result = json.loads((out / "registration.json").read_text(encoding="ascii"))
        del result["timing"]
        page = re.sub(r"[\d.]+ s\b", "", (out / "report.html").read_text(encoding="utf-8"))
        assert "Büro" in page
        found.add((json.dumps(result), page, (out / "poses.csv").read_bytes()))
    assert len(found) == 1


def test_names_of_scans_are_written_in_any_locale(tmp_path: Path) -> None:
    path = tmp_path / "two.e57"
    write_e57(path, [E57Scan("Büro", points()), E57Scan("Flur", points() + 9)])
    done = command(
        *("info", path, "--json"),
        env={**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    )
    assert [scan["name"] for scan in json.loads(done.stdout)[0]["scans"]] == ["Büro", "Flur"]


def points():
    import numpy as np

    return np.random.default_rng(1).normal(0, 3, (100, 3)).astype(np.float32)


@pytest.mark.parametrize("megabytes", [200, 300, 345, 400, 520, 600, 800])
def test_little_memory_is_one_line(tmp_path: Path, megabytes: int) -> None:
    (tmp_path / "a.xyz").write_text("1 2 3\n-1 2 0.5\n3 1 1\n", encoding="utf-8")
    limit = megabytes << 20

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))

    done = command(
        *("register", tmp_path / "a.xyz", "-o", tmp_path / "out", "--scanner-origin", "0,0,0", "-q"),
        preexec_fn=limited,
        timeout=100,
    )
    if done.returncode == 2:
        assert done.stderr.decode().startswith("There is not enough memory.")
        assert done.stderr.count(b"\n") == 1
    else:
        assert done.returncode in (0, 3, 4), done.stderr
        assert megabytes > 345


@pytest.mark.parametrize("end", ["os.abort()", "os.kill(os.getpid(), 9)", "[bytearray(1 << 62)]"])
def test_a_process_that_memory_ends_is_one_line(end: str) -> None:
    """As when the core, a library or the system ends it."""
    script = f"""
import os, sys
import trihedral.cli.app
app = sys.modules["trihedral.cli.app"]
def _run(arguments):
    os.write(2, b"memory allocation of 5 bytes failed\\n")
    {end}
app._run = _run
app.main()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(b"There is not enough memory.") or b"bytearray" in end.encode()
    assert done.stderr.count(b"There is not enough memory.") == 1


@pytest.mark.parametrize(("number", "left_with"), [(signal.SIGINT, 130), (signal.SIGTERM, -signal.SIGTERM)])
def test_a_signal_to_the_command_ends_its_work(number: signal.Signals, left_with: int) -> None:
    script = """
import os, sys, time
import trihedral.cli.app
app = sys.modules["trihedral.cli.app"]
def _run(arguments):
    os.write(1, b"at work")
    time.sleep(100)
app._run = _run
app.main()
"""
    started = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)
    assert started.stdout is not None and started.stdout.read(7) == b"at work"
    started.send_signal(number)
    # The pipe ends when nobody writes to it any more.
    started.communicate(timeout=50)
    assert started.returncode == left_with


def test_a_full_disk_behind_standard_output_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("1 2 3\n-1 2 0.5\n3 1 1\n", encoding="utf-8")
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "trihedral", "info", tmp_path / "a.xyz"],
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.startswith(b"Cannot write")
    assert done.stderr.count(b"\n") == 1
    assert b"the disk is full" in done.stderr


def test_a_scan_of_three_points_is_a_small_file(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("1 2 3\n-1 2 0.5\n3 1 1\n", encoding="utf-8")
    command("register", tmp_path / "a.xyz", "-o", tmp_path / "out", "--scanner-origin", "0,0,0", "-q")
    (stored,) = tmp_path.glob("out/.trihedral/prepared/*/*.npz")
    assert stored.stat().st_size < 20_000
