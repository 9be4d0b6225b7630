"""What a result says was read is what was read: changes of any file of a scan, at any moment."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import trihedral.api
from support.job_fakes import FakePrepared, fake_stages, write_scans, write_site
from trihedral.errors import NothingToRegister
from trihedral.fusion.rig import LineScanner, Profiles
from trihedral.io.rig import write_rig
from trihedral.job.inputs import SourceFile, natural
from trihedral.job.sqlite_store import SqliteStore


def overwrite(path: Path, data: bytes) -> None:
    """Write other content of the same length and time."""
    times = path.stat()
    assert times.st_size == len(data)
    path.write_bytes(data)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def rig(folder: Path, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    turns, beams = np.radians(np.arange(0.0, 360.0, 10.0)), np.radians(np.linspace(-90, 90, 19))
    ranges = rng.uniform(1, 30, (len(turns), len(beams))).astype(np.float32)
    path = folder / "one.toml"
    write_rig(path, "one", [Profiles(LineScanner("line", 0.2, 1.3, np.eye(4)), turns, beams, ranges, None)])
    return path


def test_profiles_taken_again_under_the_same_name_are_another_scan(tmp_path: Path) -> None:
    first, other = tmp_path / "first", tmp_path / "other"
    first.mkdir(), other.mkdir()
    path = rig(first, 1)
    again = rig(other, 2).with_name("one-line.npz").read_bytes()
    before = SourceFile.of(path)
    with SqliteStore(tmp_path / "out", FakePrepared.load, "1") as store:
        store.remember_sha256(before, before.sha256())
        assert store.known_sha256(SourceFile.of(path)) == before.sha256()
        overwrite(path.with_name("one-line.npz"), again)
        after = SourceFile.of(path)
        assert store.known_sha256(after) is None
        assert after.sha256() not in (None, store.known_sha256(before))


@pytest.mark.parametrize("put_back", [False, True])
def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path: Path, put_back: bool) -> None:
    paths = write_site(tmp_path / "site", 2)
    moving = write_scans(tmp_path / "site" / "moving.e57", 50.0)
    old = moving.read_bytes()
    new = old.replace(b"50.0", b"70.0")
    steps = fake_stages()

    def read_scan(header):
        if header.source.name != "moving.e57":
            return steps.read_scan(header)
        overwrite(moving, new)
        scan = steps.read_scan(header)
        if put_back:
            overwrite(moving, old)
        return scan

    result = trihedral.api.register(
        [*paths, moving], tmp_path / "out", steps=replace(steps, read_scan=read_scan)
    )
    assert set(result.stations) == {"s0", "s1"}
    [failure] = result.failures
    assert "changed while it was read" in failure.reason
    if moving.read_bytes() != old:
        overwrite(moving, old)
    again = trihedral.api.register([*paths, moving], tmp_path / "out", steps=steps)
    assert again.stations["s0"].pose[0, 3] == -50.0


@pytest.mark.parametrize("error", [IndexError("list index out of range"), MemoryError(), RecursionError()])
@pytest.mark.parametrize("step", ["read_scan", "prepare"])
def test_any_exception_of_one_file_costs_that_file_alone(tmp_path: Path, error: Exception, step: str) -> None:
    paths = [*write_site(tmp_path / "site", 2), write_scans(tmp_path / "site" / "odd.e57", 99.0)]
    steps = fake_stages()
    good = getattr(steps, step)

    def failing(given):
        header = given if step == "read_scan" else given.header
        if header.source.name == "odd.e57":
            raise error
        return good(given)

    result = trihedral.api.register(paths, tmp_path / "out", steps=replace(steps, **{step: failing}))
    assert result.exit_code == 3
    assert set(result.stations) == {"s0", "s1"}
    assert [Path(failure.path).name for failure in result.failures] == ["odd.e57"]


def test_numbers_in_names_may_have_any_length() -> None:
    names = ["s2", "s10", "s" + "9" * 5000, "s1" + "0" * 5000, "s007", "s٣"]
    ordered = sorted(names, key=natural)
    assert [name[:4] for name in ordered] == ["s2", "s٣", "s007", "s10", "s999", "s100"]


def test_a_rig_that_lacks_a_part_says_so(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    folder.mkdir()
    path = rig(folder, 1)
    path.with_name("one-line.npz").unlink()
    assert SourceFile.of(path).parts == ()
    with pytest.raises(NothingToRegister, match=r"one-line\.npz"):
        trihedral.api.register([path], tmp_path / "out")
