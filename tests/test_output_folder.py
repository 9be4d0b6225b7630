"""Nothing that the program did not make is replaced, moved, followed or removed."""

import json
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import trihedral.api
from support.job_fakes import FakePrepared, fake_stages, write_scans, write_site
from trihedral.atomic import creating, write_new
from trihedral.cli import bug
from trihedral.errors import OutputError, TrihedralError
from trihedral.job.sqlite_store import SqliteStore
from trihedral.output_folder import OWN_FOLDER, OutputFolder

RESULTS = ("report.html", "poses.csv", "registration.json")
PART = f".trihedral-{32 * 'a'}.part"


def register(paths: list[Path], out: Path) -> trihedral.api.Result:
    return trihedral.api.register(paths, out, steps=fake_stages())


def state(folder: Path) -> dict[str, bytes | str]:
    """Everything below a folder: content of files, target of links."""
    return {
        str(path.relative_to(folder)): str(path.readlink()) if path.is_symlink() else path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_symlink() or path.is_file()
    }


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Make a folder of somebody else's."""
    folder = tmp_path / "foreign"
    (folder / "below").mkdir(parents=True)
    (folder / "survey.txt").write_text("of 2019")
    (folder / "below" / "survey.npz").write_text("of 2020")
    return folder


@pytest.mark.parametrize("name", RESULTS)
@pytest.mark.parametrize("kind", ["file", "link", "dangling", "folder", "fifo"])
def test_what_is_in_the_place_of_a_result_is_refused_before_the_work(
    tmp_path: Path, foreign: Path, name: str, kind: str
) -> None:
    paths = write_site(tmp_path / "site", 2)
    out = tmp_path / "out"
    out.mkdir()
    place = out / name
    {
        "file": lambda: place.write_text("mine"),
        "link": lambda: place.symlink_to(foreign / "survey.txt"),
        "dangling": lambda: place.symlink_to(foreign / "not there"),
        "folder": lambda: place.mkdir(),
        "fifo": lambda: os.mkfifo(place),
    }[kind]()
    before = state(foreign), place.lstat()
    with pytest.raises(OutputError, match=rf"out/{name}: .*Move it away"):
        register(paths, out)
    assert state(foreign) == before[0]
    assert (place.lstat().st_ino, place.lstat().st_mtime_ns) == (before[1].st_ino, before[1].st_mtime_ns)
    assert not list(out.rglob("*.npz")), "no scan was prepared"


def test_an_input_in_the_output_folder_is_not_overwritten(tmp_path: Path) -> None:
    write_scans(tmp_path / "poses.csv", 10.0)
    before = (tmp_path / "poses.csv").read_bytes()
    with pytest.raises(OutputError, match="trihedral did not write it"):
        register([tmp_path / "poses.csv"], tmp_path)
    assert (tmp_path / "poses.csv").read_bytes() == before


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_that_a_person_changed_is_not_replaced(tmp_path: Path, name: str) -> None:
    paths = write_site(tmp_path / "site", 2)
    out = tmp_path / "out"
    register(paths, out)
    register(paths, out)
    with (out / name).open("a") as file:
        file.write("my notes")
    before = (out / name).read_bytes()
    with pytest.raises(OutputError, match="changed since"):
        register(paths, out)
    assert (out / name).read_bytes() == before


def test_a_result_that_was_copied_elsewhere_goes_on(tmp_path: Path) -> None:
    """Owning a file depends on what is in it, not on times and places."""
    paths = write_site(tmp_path / "site", 2)
    register(paths, tmp_path / "out")
    (tmp_path / "copy").mkdir()
    for name, content in state(tmp_path / "out").items():
        (tmp_path / "copy" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "copy" / name).write_bytes(content)
    register(paths, tmp_path / "copy")


@pytest.mark.parametrize(
    "place",
    ["", "prepared", "prepared/1", "parts", "lock", "job.sqlite", "job.sqlite-wal", "job.sqlite-journal"],
)
def test_links_inside_the_own_folder_are_not_followed(tmp_path: Path, foreign: Path, place: str) -> None:
    paths = write_site(tmp_path / "site", 2)
    out = tmp_path / "out"
    with SqliteStore(out, FakePrepared.load, "1"):
        pass
    own = out / OWN_FOLDER / place
    if own.exists():
        own.rename(tmp_path / "was")
    own.symlink_to(foreign if own.suffix == "" and place != "lock" else foreign / "survey.txt")
    before = state(foreign)
    with pytest.raises(OutputError, match="Move it away"):
        register(paths, out)
    assert state(foreign) == before
    assert own.is_symlink()


def test_a_database_that_is_somebody_elses_too_is_not_written(tmp_path: Path, foreign: Path) -> None:
    with SqliteStore(tmp_path / "out", FakePrepared.load, "1"):
        pass
    (tmp_path / "out" / OWN_FOLDER / "job.sqlite").unlink()
    (tmp_path / "out" / OWN_FOLDER / "job.sqlite").hardlink_to(foreign / "survey.txt")
    with pytest.raises(OutputError, match="Move it away"):
        SqliteStore(tmp_path / "out", FakePrepared.load, "1")
    assert (foreign / "survey.txt").read_text() == "of 2019"


def test_an_own_folder_without_the_mark_is_somebody_elses(tmp_path: Path) -> None:
    own = tmp_path / "out" / OWN_FOLDER
    (own / "prepared" / "holiday").mkdir(parents=True)
    (own / "prepared" / "holiday" / "a.npz").write_text("mine")
    before = state(tmp_path)
    with pytest.raises(OutputError, match="not made by this version"):
        register(write_site(tmp_path.with_name("site"), 2), tmp_path / "out")
    assert state(tmp_path) == before


def test_only_what_another_version_prepared_is_removed(tmp_path: Path, foreign: Path) -> None:
    paths = write_site(tmp_path / "site", 2)
    out = tmp_path / "out"
    register(paths, out)
    prepared = out / OWN_FOLDER / "prepared"
    (prepared / "holiday").mkdir()
    (prepared / "holiday" / "a.npz").write_text("mine")
    (prepared / "link").symlink_to(foreign)
    (prepared / "1" / "notes.txt").write_text("mine")
    with SqliteStore(out, FakePrepared.load, "2"):
        pass
    assert not list((prepared / "1").glob("*.npz"))
    assert (
        (prepared / "holiday" / "a.npz").read_text() == (prepared / "1" / "notes.txt").read_text() == "mine"
    )
    assert (foreign / "below" / "survey.npz").exists()


def test_a_new_file_takes_no_place_that_is_taken(tmp_path: Path, foreign: Path) -> None:
    (tmp_path / "link").symlink_to(foreign / "not there")
    for path in (foreign / "survey.txt", tmp_path / "link"):
        with pytest.raises(OutputError, match="exists already"):
            write_new(path, b"ours")
    with pytest.raises(OutputError, match="exists already"), creating(tmp_path / "new") as part:
        part.write_bytes(b"ours")
        (tmp_path / "new").write_bytes(b"somebody was quicker")
    assert (tmp_path / "new").read_bytes() == b"somebody was quicker"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["foreign", "link", "new"]


def test_unfinished_files_are_removed_unless_somebody_writes_them(tmp_path: Path) -> None:
    (tmp_path / PART).write_bytes(b"left by a kill")
    (tmp_path / ".x.part").write_bytes(b"mine")
    (tmp_path / PART.replace("a", "b")).symlink_to(tmp_path / ".x.part")
    with creating(tmp_path / "one") as one:
        one.write_bytes(b"1")
        assert not (tmp_path / PART).exists()
        write_new(tmp_path / "two", b"2")
        assert one.exists()
    assert (tmp_path / ".x.part").read_bytes() == b"mine"
    assert (tmp_path / PART.replace("a", "b")).is_symlink()


def test_a_second_run_waits_for_none(tmp_path: Path) -> None:
    with OutputFolder(tmp_path), pytest.raises(OutputError, match="another run of trihedral is using it"):
        OutputFolder(tmp_path)
    OutputFolder(tmp_path).close()


def test_a_kill_while_a_file_takes_its_place_leaves_it_ours(tmp_path: Path) -> None:
    """Killed just before and just after the rename: the next run may replace what is there."""
    with OutputFolder(tmp_path) as folder:
        folder.write("a.txt", b"first")
    for moved in (False, True):
        script = f"""
            import os, signal
            from pathlib import Path
            from trihedral.output_folder import OutputFolder
            replace = Path.replace
            def killed(self, target):
                if Path(target).name != "a.txt":
                    return replace(self, target)
                if {moved}:
                    replace(self, target)
                os.kill(os.getpid(), signal.SIGKILL)
            Path.replace = killed
            OutputFolder({str(tmp_path)!r}).write("a.txt", b"second")
        """
        done = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], check=False)
        assert done.returncode == -signal.SIGKILL
        assert (tmp_path / "a.txt").read_bytes() == (b"second" if moved else b"first")
        with OutputFolder(tmp_path) as folder:
            folder.check(["a.txt"])
            assert not list((tmp_path / OWN_FOLDER / "parts").iterdir())
            folder.write("a.txt", b"first")


def test_a_damaged_list_makes_nothing_ours(tmp_path: Path) -> None:
    with OutputFolder(tmp_path) as folder:
        folder.write("a.txt", b"first")
    for text in ("", "[]", "{", '{"a.txt": {}}', '{"a.txt": {"sha256": 1, "made_of": ""}}', "[" * 100_000):
        (tmp_path / OWN_FOLDER / "written.json").write_text(text)
        with OutputFolder(tmp_path) as folder, pytest.raises(TrihedralError, match="did not write it"):
            folder.write("a.txt", b"second")
    assert (tmp_path / "a.txt").read_bytes() == b"first"


def test_the_bug_report_follows_no_planted_link(
    tmp_path: Path, foreign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bug, "folder", tmp_path / "out")
    monkeypatch.setattr(bug.tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / OWN_FOLDER).symlink_to(foreign)
    before = state(foreign)
    names = {
        bug.keep_report(ValueError("x"), []).split("send us ")[1].split(": it holds")[0] for _ in range(3)
    }
    assert state(foreign) == before
    assert len(names) == 3
    assert {Path(name).parent for name in names} == {tmp_path / "temporary"}
    assert all(Path(name).stat().st_mode & 0o077 == 0 for name in names)


def test_the_list_says_what_was_written(tmp_path: Path) -> None:
    with OutputFolder(tmp_path) as folder:
        with folder.replacing("a.txt", "from b") as part:
            part.write_bytes(b"first")
        assert folder.holds("a.txt", "from b")
        assert not folder.holds("a.txt", "from c")
    assert list(json.loads((tmp_path / OWN_FOLDER / "written.json").read_text())) == ["a.txt"]
