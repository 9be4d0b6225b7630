"""How the command ends: help, exit codes, and sentences in place of tracebacks."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import support.job_fakes
from support.job_fakes import command, write_scans, write_site
from trihedral.cli import app

ENVIRONMENT = support.job_fakes.ENVIRONMENT | {"COLUMNS": "100"}
VERBS = sorted(command.callback.__name__ for command in app.registered_commands)


def trihedral(*arguments, **options):
    """The installed command."""
    executable = Path(sys.executable).with_name("trihedral")
    return subprocess.run(
        [executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        timeout=60,
        **options,
    )


def faked(*arguments, code=""):
    """The command with stages that know the truth; `code` runs before it."""
    line = command([str(a) for a in arguments])
    if code:
        line[2] = line[2].replace("from trihedral.cli", f"{code}; from trihedral.cli", 1)
    return subprocess.run(line, capture_output=True, text=True, env=ENVIRONMENT, timeout=60)


@pytest.mark.parametrize("verb", VERBS)
def test_each_verb_explains_itself(verb):
    run = trihedral(verb, "--help")
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith(f"Usage: trihedral {verb}")
    assert trihedral(verb, "-h").stdout == run.stdout


def test_help_lists_every_verb_and_waits_for_nothing_heavy():
    run = trihedral("--help")
    assert run.returncode == 0
    assert {"register", "demo", *VERBS} == set(
        re.findall(r"^  (\w+) ", run.stdout.partition("Commands:")[2], re.MULTILINE)
    )
    code = (
        "import sys, trihedral.cli; "
        "sys.exit(bool({'numpy', 'scipy', 'gtsam', 'matplotlib', 'trihedral._core'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_import_trihedral_is_light_and_offers_what_it_says():
    code = (
        "import sys, trihedral; assert 'numpy' not in sys.modules; "
        "[getattr(trihedral, name) for name in dir(trihedral)]; assert callable(trihedral.register)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        __import__("trihedral").nothing  # noqa: B018


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["register"], "Missing argument"),
        (["register", "x", "--threads", "0"], "--threads"),
        (["register", "x", "--units", "yards"], "--units"),
        (["register", "x", "--profile", "loose"], "there are exterior, interior"),
        (["register", "x", "--scanner-origin", "1,2"], "not three numbers like 0,0,1.7"),
        (["register", "x", "--scanner-origin", "1,2,inf"], "three finite numbers"),
        (["register", "x", "--shortest-range", "-1"], "--shortest-range"),
        (["regster", "x"], "No such command"),
        (["register", "nowhere.e57"], "nowhere.e57: there is no such file"),
    ],
)
def test_bad_usage_is_a_sentence_and_exit_2(arguments, says, tmp_path):
    run = trihedral(*arguments, cwd=tmp_path)
    assert (run.returncode, run.stdout) == (2, "")
    assert says in run.stderr
    assert "Traceback" not in run.stderr


def test_a_good_job_prints_its_verdict_first_and_its_worst_link_second(tmp_path):
    write_site(tmp_path / "site", 3)
    run = faked("register", tmp_path / "site", "-o", tmp_path / "out")
    assert run.returncode == 0
    first, second, *_ = run.stdout.splitlines()
    assert first.startswith("PASSED: all 3 scans placed")
    assert second.startswith("worst link")
    assert "Preparing scans: 3 scans" in run.stderr
    html = (tmp_path / "out/report.html").read_text()
    assert "PASSED" in html and "s2" in html


def test_quiet_says_only_what_a_person_must_know(tmp_path):
    write_site(tmp_path / "site", 2)
    (tmp_path / "site/bad.e57").write_bytes(b"[{")
    run = faked("register", tmp_path / "site", "-o", tmp_path / "out", "--quiet")
    assert run.returncode == 3
    assert run.stderr == f"{tmp_path}/site/bad.e57: byte 7: it is cut short. Copy it again\n"
    assert run.stdout.startswith("INCOMPLETE: 2 of 3 scans placed; missing: ")


def test_when_nothing_is_left_each_reason_is_said_once(tmp_path):
    (tmp_path / "bad.e57").write_bytes(b"[{")
    run = faked("register", tmp_path / "bad.e57", "-o", tmp_path / "out", "--quiet")
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == (
        f"{tmp_path}/bad.e57: byte 7: it is cut short. Copy it again\nThere is no scan to register.\n"
    )


def test_progress_as_json_is_json_and_adds_up(tmp_path):
    write_site(tmp_path / "site", 4)
    run = faked("register", tmp_path / "site", "-o", tmp_path / "out", "--json-progress")
    phases: dict[str, float] = {}
    for record in map(json.loads, run.stderr.splitlines()):
        if "phase" in record:
            name = record["phase"]
            phases[name] = phases.get(name, 0.0) - record["work"]
        else:
            phases[name] += record["work"]
    assert list(phases)[-2:] == ["Placing", "Writing the result"]
    assert all(work == 0.0 for work in phases.values())


def test_tolerance_that_is_not_met_is_exit_4(tmp_path):
    write_site(tmp_path / "site", 3)
    # The stand-in's links have a P95 of 2 mm.
    assert faked("register", tmp_path / "site", "-o", tmp_path / "a", "--profile", "loa40").returncode == 0
    assert faked("register", tmp_path / "site", "-o", tmp_path / "b", "--profile", "loa50").returncode == 4


def test_control_characters_in_names_do_not_reach_the_terminal(tmp_path):
    write_scans(tmp_path / "site" / "a\x1b[31mb.e57", 1.0)
    (tmp_path / "site" / "c\x1b[2Jd.e57").write_bytes(b"[{")
    run = faked("register", tmp_path / "site", "-o", tmp_path / "out")
    assert run.returncode == 3
    assert "\x1b" not in run.stdout + run.stderr
    alone = faked("register", tmp_path / "site" / "c\x1b[2Jd.e57", "-o", tmp_path / "out")
    assert alone.returncode == 2
    assert "\x1b" not in alone.stderr


@pytest.mark.parametrize("kind", ["ValueError", "BaseException"])
def test_a_bug_of_ours_leaves_a_report_and_no_traceback_on_the_terminal(tmp_path, kind):
    write_site(tmp_path / "site", 3)
    code = (
        "before = api.stages; "
        f"api.stages = lambda options: support.job_fakes.crashing(before(options), {kind}('of ours'))"
    )
    run = faked("register", tmp_path / "site", "-o", tmp_path / "out", code=code)
    assert (run.returncode, run.stdout) == (1, "")
    assert "Traceback" not in run.stderr
    assert f"{kind}: of ours" in run.stderr
    (report,) = (tmp_path / "out/.trihedral").glob("bug-*.txt")
    assert str(report) in run.stderr
    text = report.read_text()
    assert "Traceback" in text and "trihedral: 0." in text and "numpy: " in text and "register" in text


def test_too_little_memory_is_a_sentence(tmp_path):
    write_site(tmp_path / "site", 3)
    crash = "support.job_fakes.crashing(before(options), MemoryError())"
    code = f"before = api.stages; api.stages = lambda options: {crash}"
    run = faked("register", tmp_path / "site", "-o", tmp_path / "out", code=code)
    assert run.returncode == 2
    assert "not enough memory" in run.stderr


def test_a_reader_that_stops_reading_is_not_an_error():
    executable = Path(sys.executable).with_name("trihedral")
    run = subprocess.run(
        ["bash", "-c", f"{executable} --help | true; echo ${{PIPESTATUS[0]}}"], capture_output=True, text=True
    )
    assert run.stdout.strip() == "0"
    assert "Traceback" not in run.stderr
