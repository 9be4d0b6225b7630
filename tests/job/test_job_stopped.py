"""Runs that end in mid-work, in processes of their own: the next one goes on and ends with the same bytes."""

import json
import os
import random
import resource
import signal
import subprocess
import time
from pathlib import Path

import pytest

from support.job_fakes import ENVIRONMENT, command, write_site
from trihedral.output_folder import OWN_FOLDER as JOB_FOLDER


def start(arguments, prepare_seconds=0.0, pair_seconds=0.0, **options):
    return subprocess.Popen(
        command([str(a) for a in arguments], prepare_seconds, pair_seconds),
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def finish(arguments, **options):
    process = start(arguments, **options)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


def files(out: Path) -> dict[str, bytes]:
    """Everything that a person finds, timings aside."""
    document = json.loads((out / "registration.json").read_text())
    del document["timing"]
    for link in document["links"]:
        del link["seconds"]
    return {"json": json.dumps(document).encode(), "poses": (out / "poses.csv").read_bytes()}


def prepared(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (out / JOB_FOLDER / "prepared/1").iterdir()}


def test_killed_at_any_moment_the_next_run_goes_on_to_the_same_result(tmp_path):
    site = tmp_path / "site"
    write_site(site, 8)
    assert finish(["register", site, "-o", tmp_path / "whole"])[0] == 0
    moments = random.Random(4)
    kills = kept = 0
    for trial in range(4):
        out = tmp_path / f"out{trial}"
        process = start(
            ["register", site, "-o", out, "--threads", 2], prepare_seconds=0.05, pair_seconds=0.05
        )
        while not list(out.glob(f"{JOB_FOLDER}/prepared/1/*.npz")):
            assert process.poll() is None
            time.sleep(0.002)
        time.sleep(moments.uniform(0.0, 0.5))
        process.kill()
        process.communicate()
        kills += process.returncode == -signal.SIGKILL
        there = {path.name for path in out.iterdir()} - {JOB_FOLDER}
        if process.returncode == -signal.SIGKILL:
            assert not [name for name in there if not name.endswith(".part")]
        before = {path: path.stat().st_mtime_ns for path in out.glob(f"{JOB_FOLDER}/prepared/1/*.npz")}
        code, _, err = finish(["register", site, "-o", out])
        assert code == 0, err
        after = {path: path.stat().st_mtime_ns for path in before}
        assert before == after, "what was prepared is used, not made again"
        kept += len(before)
        assert files(out) == files(tmp_path / "whole")
        assert prepared(out) == prepared(tmp_path / "whole")
        assert not list(out.rglob("*.part"))
    assert kills >= 2
    assert kept > kills


@pytest.mark.parametrize("moment", ["preparing", "pairs"])
def test_ctrl_c_stops_quickly_and_says_that_the_next_run_goes_on(tmp_path, moment):
    site, out = tmp_path / "site", tmp_path / "out"
    write_site(site, 6)
    seconds = {"prepare_seconds": 20.0} if moment == "preparing" else {"pair_seconds": 20.0}
    first = start(["register", site, "-o", out, "--threads", 2, "--json-progress"], **seconds)
    wanted = "Preparing" if moment == "preparing" else "Registering"
    for line in first.stderr:
        if wanted in line:
            break
    time.sleep(0.2)
    began = time.monotonic()
    first.send_signal(signal.SIGINT)
    output, err = first.communicate(timeout=10)
    assert time.monotonic() - began < 5.0, "it does not wait for the steps of twenty seconds"
    assert first.returncode == 130
    assert output == ""
    assert "Stopped. Run the same command again: it goes on where it was." in err
    assert "Traceback" not in err
    assert {path.name for path in out.iterdir()} == {JOB_FOLDER}
    code, _, err = finish(["register", site, "-o", out])
    assert code == 0, err


def test_a_second_run_on_the_same_folder_says_so(tmp_path):
    site, out = tmp_path / "site", tmp_path / "out"
    write_site(site, 4)
    first = start(["register", site, "-o", out, "--json-progress"], prepare_seconds=20.0)
    for line in first.stderr:
        if "Preparing" in line:
            break
    code, _, err = finish(["register", site, "-o", out])
    assert (code, "another run of trihedral is using it" in err) == (2, True)
    first.kill()
    first.communicate()
    assert finish(["register", site, "-o", out])[0] == 0, "a kill leaves no lock"


def test_a_full_disk_is_said_and_the_old_result_stays(tmp_path):
    site, out = tmp_path / "site", tmp_path / "out"
    write_site(site, 3)
    assert finish(["register", site, "-o", out])[0] == 0
    before = files(out)
    write_site(site, 4)

    def small_files():
        # Python ignores SIGXFSZ, so that writing past the limit fails as it does on a full disk.
        resource.setrlimit(resource.RLIMIT_FSIZE, (90_000, 90_000))

    code, stdout, err = finish(["register", site, "-o", out], preexec_fn=small_files)
    assert (code, stdout) == (2, "")
    assert "Cannot write" in err and "larger than this system allows" in err
    assert "Traceback" not in err
    assert files(out) == before
    assert not list(out.rglob("*.part"))
    assert finish(["register", site, "-o", out])[0] == 0


def test_a_folder_that_may_not_be_written(tmp_path):
    site, out = tmp_path / "site", tmp_path / "locked"
    write_site(site, 2)
    out.mkdir()
    if os.geteuid() == 0:
        # Root may write anywhere but where the file system itself refuses.
        out = Path("/proc/trihedral-out")
    else:
        out.chmod(0o500)
    code, stdout, err = finish(["register", site, "-o", out])
    assert (code, stdout) == (2, "")
    assert f"Cannot write {out}: " in err
    assert "Traceback" not in err


def test_the_inputs_are_not_touched(tmp_path):
    site = tmp_path / "site"
    paths = write_site(site, 3)
    for path in paths:
        path.chmod(0o444)
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in paths}
    assert finish(["register", site, "-o", site])[0] == 0
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in paths} == before


def test_status_tells_where_a_run_is_and_was(tmp_path):
    site, out = tmp_path / "site", tmp_path / "out"
    write_site(site, 4)
    assert finish(["status", out])[0] == 2
    process = start(["register", site, "-o", out, "--json-progress"], prepare_seconds=0.1, pair_seconds=60.0)
    for line in process.stderr:
        if "Registering pairs" in line:
            break
    seen = json.loads(finish(["status", out, "--json"])[1])
    assert (seen["state"], seen["kept"]["prepared"], seen["verdict"]) == ("running", 4, None)
    phases = {phase["name"]: phase for phase in seen["run"]["phases"]}
    assert (phases["Preparing scans"]["done"], phases["Registering pairs"]["done"]) == (4, 0)
    assert phases["Registering pairs"]["total"] == 3
    process.kill()
    process.communicate()
    seen = json.loads(finish(["status", out, "--json"])[1])
    assert (seen["state"], seen["kept"]["prepared"], seen["kept"]["links"]) == ("stopped", 4, 0)
    assert finish(["register", site, "-o", out])[0] == 0
    seen = json.loads(finish(["status", out, "--json"])[1])
    assert (seen["state"], seen["kept"]["links"], seen["kept"]["accepted"]) == ("finished", 5, 5)
    assert seen["verdict"] == json.loads((out / "registration.json").read_text())["verdict"]["text"]
    text = finish(["status", out])[1]
    assert "Preparing scans: 4 of 4 scans" in text and "finished" in text
    assert "Placing: 4 of 4 scans" in text, "what solving the network says of itself"
