"""The job folder and the sequence of a job: nothing is done twice, nothing is lost, nothing damaged is trusted."""

import errno
import hashlib
import json
import os
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import trihedral.api
from support.job_fakes import FakePrepared, fake_stages, previewing, write_scans, write_site
from trihedral.errors import InputError, OptionError, OutputError, TrihedralError
from trihedral.job.inputs import SourceFile, unique_names
from trihedral.job.sqlite_store import SqliteStore
from trihedral.model.link import LinkVerdict, PairResult
from trihedral.model.pairs import PairRequest
from trihedral.model.storage import to_text
from trihedral.output_folder import OWN_FOLDER as JOB_FOLDER
from trihedral.output_folder import OutputFolder
from trihedral.progress import Silent


def register(paths, out, log=None, **options):
    steps = fake_stages([] if log is None else log, version=options.pop("version", "1"))
    return trihedral.api.register(paths, out, steps=steps, **options)


def stable(out: Path) -> str:
    """registration.json without what is time."""
    document = json.loads((out / "registration.json").read_text())
    del document["timing"]
    for link in document["links"]:
        del link["seconds"]
    return json.dumps(document)


def test_places_every_scan_and_writes_the_result(tmp_path):
    paths = write_site(tmp_path / "site", 4)
    result = register(paths, tmp_path / "out")
    assert result.exit_code == 0
    assert {n: s.pose[0, 3] for n, s in result.stations.items()} == {"s0": 0, "s1": 10, "s2": 20, "s3": 30}
    document = json.loads((tmp_path / "out/registration.json").read_text())
    assert [s["name"] for s in document["stations"]] == ["s0", "s1", "s2", "s3"]
    assert len((tmp_path / "out/poses.csv").read_text().splitlines()) == 5


def test_inputs_are_listed_with_the_hash_that_sha256sum_gives(tmp_path):
    paths = write_site(tmp_path, 2)
    result = register(paths, None)
    # printf of each file through coreutils' sha256sum.
    listed = {i["path"]: (i["sha256"], i["bytes"]) for i in result.document["inputs"]}
    for path in paths:
        with os.popen(f"sha256sum '{path}'") as pipe:
            assert listed[str(path)] == (pipe.read().split()[0], path.stat().st_size)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_neither_threads_nor_order_change_the_result(tmp_path, threads):
    paths = write_site(tmp_path / "site", 6)
    register(paths, tmp_path / "first", threads=2)
    register(list(reversed(paths)), tmp_path / "second", threads=threads)
    assert stable(tmp_path / "first") == stable(tmp_path / "second")


def test_a_second_run_does_nothing_twice(tmp_path):
    paths = write_site(tmp_path / "site", 4)
    register(paths, tmp_path / "out")
    before, log = stable(tmp_path / "out"), []
    register(paths, tmp_path / "out", log)
    assert log == []
    assert stable(tmp_path / "out") == before


def test_a_scan_added_later_costs_only_its_own_work(tmp_path):
    paths = write_site(tmp_path / "site", 4)
    register(paths[:3], tmp_path / "out")
    log = []
    register(paths, tmp_path / "out", log)
    assert sorted(log) == ["pair 10.0 30.0", "pair 20.0 30.0", "prepare s3.e57 0"]


def test_direction_and_seed_of_a_pair_come_from_the_scans_and_not_from_the_program(tmp_path):
    paths = write_site(tmp_path / "site", 5)
    register(paths, tmp_path / "first", version="1")
    for version in ("2", "3", "4"):
        register(paths, tmp_path / version, version=version)
        assert stable(tmp_path / version) == stable(tmp_path / "first")


def test_a_renamed_copy_is_known_by_its_content(tmp_path):
    paths = write_site(tmp_path / "site", 3)
    register(paths, tmp_path / "out")
    shutil.copytree(tmp_path / "site", tmp_path / "copy")
    for path in (tmp_path / "copy").iterdir():
        path.rename(path.with_name(f"new-{path.name}"))
    log = []
    result = register([tmp_path / "copy"], tmp_path / "out", log)
    assert log == []
    assert set(result.stations) == {"new-s0", "new-s1", "new-s2"}


def test_a_changed_file_of_the_same_name_and_size_is_prepared_anew(tmp_path):
    paths = write_site(tmp_path / "site", 3)
    register(paths, tmp_path / "out")
    write_scans(paths[1], 70.0)
    os.utime(paths[1], ns=(1, 1))
    assert paths[1].stat().st_size == paths[2].stat().st_size
    result = register(paths, tmp_path / "out")
    assert result.stations["s1"].pose[0, 3] == 70.0


def test_what_another_program_stored_is_not_used_and_not_kept(tmp_path):
    paths = write_site(tmp_path / "site", 2)
    register(paths, tmp_path / "out")
    log = []
    register(paths, tmp_path / "out", log, version="2")
    assert sorted(log) == ["pair 0.0 10.0", "prepare s0.e57 0", "prepare s1.e57 0"]
    assert len(list((tmp_path / "out").rglob("*.npz"))) == 2, "what the other program prepared is gone"


@pytest.mark.parametrize("damage", ["truncate", "flip", "empty", "garbage"])
def test_a_damaged_prepared_scan_is_made_anew(tmp_path, damage):
    paths = write_site(tmp_path / "site", 3)
    register(paths, tmp_path / "out")
    before = stable(tmp_path / "out")
    database = tmp_path / "out" / JOB_FOLDER / "job.sqlite"
    database.unlink()
    for stored in (tmp_path / "out" / JOB_FOLDER / "prepared/1").iterdir():
        data = bytearray(stored.read_bytes())
        if damage == "truncate":
            data = data[: len(data) // 2]
        elif damage == "flip":
            # Another place that reads well: only the hash can tell.
            assert data.startswith(b'{"x": ')
            data[6] = ord("9")
        elif damage == "empty":
            data = b""
        else:
            data = os.urandom(500)
        stored.write_bytes(data)
    log = []
    register(paths, tmp_path / "out", log)
    assert [entry for entry in sorted(log) if entry.startswith("prepare")] == [
        f"prepare s{k}.e57 0" for k in range(3)
    ]
    assert stable(tmp_path / "out") == before


@pytest.mark.parametrize("damage", ["truncate", "garbage", "empty", "other layout", "gone"])
def test_a_damaged_database_is_made_anew_and_prepared_scans_stay(tmp_path, damage):
    paths = write_site(tmp_path / "site", 3)
    register(paths, tmp_path / "out")
    before = stable(tmp_path / "out")
    database = tmp_path / "out" / JOB_FOLDER / "job.sqlite"
    if damage == "truncate":
        database.write_bytes(database.read_bytes()[:5000])
    elif damage == "garbage":
        database.write_bytes(os.urandom(9000))
    elif damage == "empty":
        database.write_bytes(b"")
    elif damage == "gone":
        database.unlink()
    else:
        connection = sqlite3.connect(database)
        connection.execute("PRAGMA user_version = 99")
        connection.close()
    log = []
    register(paths, tmp_path / "out", log)
    assert not [entry for entry in log if entry.startswith("prepare")]
    assert stable(tmp_path / "out") == before


def test_a_pair_outcome_that_was_tampered_with_is_not_used(tmp_path):
    paths = write_site(tmp_path / "site", 2)
    register(paths, tmp_path / "out")
    connection = sqlite3.connect(tmp_path / "out" / JOB_FOLDER / "job.sqlite")
    connection.execute("UPDATE pair SET outcome = replace(outcome, 'accepted', 'doubtful')")
    connection.commit()
    connection.close()
    log = []
    register(paths, tmp_path / "out", log)
    assert log == ["pair 0.0 10.0"]


def test_a_pair_outcome_of_another_layout_is_not_used(tmp_path):
    paths = write_site(tmp_path / "site", 2)
    register(paths, tmp_path / "out")
    before = stable(tmp_path / "out")
    for other in ("{}", '{"verdict": "believed"}', "[1]", "neither"):
        with sqlite3.connect(tmp_path / "out" / JOB_FOLDER / "job.sqlite") as connection:
            digest = hashlib.sha256(other.encode()).hexdigest()
            connection.execute("UPDATE pair SET outcome = ?, sha256 = ?", (other, digest))
        connection.close()
        log = []
        register(paths, tmp_path / "out", log)
        assert log == ["pair 0.0 10.0"]
        assert stable(tmp_path / "out") == before


def test_a_result_comes_back_from_the_database_as_it_was(tmp_path):
    result = fake_stages().register_pair(FakePrepared(1 / 3, 5), FakePrepared(0.1, 5), 77)
    bare = PairResult(verdict=LinkVerdict.REFUSED, reason="nothing fits")
    with SqliteStore(tmp_path, FakePrepared.load, "1") as job:
        job.save_result("k", result)
        job.save_result("bare", bare)
    with SqliteStore(tmp_path, FakePrepared.load, "1") as job:
        again, bare_again = job.result("k"), job.result("bare")
        assert job.result("another") is None
    assert bare_again == bare
    assert to_text(again) == to_text(result)
    assert again.transform.tobytes() == result.transform.tobytes()


def test_a_second_run_at_once_is_refused_with_a_reason(tmp_path):
    with (
        SqliteStore(tmp_path / "out", FakePrepared.load, "1"),
        pytest.raises(OutputError, match=r"out: another run of trihedral is using it\. Wait"),
    ):
        SqliteStore(tmp_path / "out", FakePrepared.load, "1")
    SqliteStore(tmp_path / "out", FakePrepared.load, "1").close()


def test_what_a_killed_run_left_half_written_is_removed_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    with SqliteStore(out, FakePrepared.load, "1") as store:
        prepared = store.shared
    name = f".trihedral-{32 * 'a'}.part"
    parts = [
        out / name,
        prepared / name,
        out / JOB_FOLDER / name,
        out / JOB_FOLDER / "parts" / f"{32 * 'b'}.html",
    ]
    others = [
        out / ".keep",
        out / ".registration.json.1-2.part",
        prepared / "notes.part",
        prepared / "mine.npz",
    ]
    for path in [*parts, *others]:
        path.write_bytes(b"half")
    with SqliteStore(out, FakePrepared.load, "1"):
        assert not any(part.exists() for part in parts)
    with SqliteStore(out, FakePrepared.load, "2"):
        assert all(path.read_bytes() == b"half" for path in others)


def test_a_bad_file_among_good_ones_loses_only_itself(tmp_path):
    paths = write_site(tmp_path / "site", 3)
    bad = tmp_path / "site" / "bad.e57"
    bad.write_bytes(b"[{")
    empty = tmp_path / "site" / "empty.e57"
    empty.touch()
    hollow = write_scans(tmp_path / "site" / "hollow.e57", 1.0, points=0)
    result = register([*paths, bad, empty, hollow, tmp_path / "absent.e57"], tmp_path / "out")
    assert result.exit_code == 3
    assert set(result.stations) == {"s0", "s1", "s2"}
    reasons = {Path(f.path).name: (f.scan_index, f.reason) for f in result.failures}
    assert reasons == {
        "bad.e57": (None, "byte 7: it is cut short. Copy it again"),
        "empty.e57": (None, "the file is empty"),
        "hollow.e57": (None, "the scan has no valid points"),
        "absent.e57": (None, "there is no such file"),
    }


def test_what_was_assumed_of_the_files_is_said_once(tmp_path):
    paths = write_site(tmp_path, 5)
    steps = fake_stages()

    def read_headers(path):
        return [replace(header, notes=("metres assumed",)) for header in steps.read_headers(path)]

    class Listener(Silent):
        def __init__(self):
            self.heard = []

        def note(self, text):
            self.heard.append(text)

    listener = Listener()
    trihedral.api.register(paths, steps=replace(steps, read_headers=read_headers), progress=listener)
    assert listener.heard == ["s0.e57, s1.e57, s2.e57 and 2 more: metres assumed"]


def test_when_nothing_is_left_every_input_is_named(tmp_path):
    bad = tmp_path / "bad.e57"
    bad.write_bytes(b"[{")
    with pytest.raises(TrihedralError, match=r"no scan to register.\n.*absent.e57: .*\n.*bad.e57: byte 7"):
        register([bad, tmp_path / "absent.e57"], tmp_path / "out")
    assert not (tmp_path / "out" / "registration.json").exists()


def test_one_scan_alone_is_a_job(tmp_path):
    result = register(write_site(tmp_path, 1), tmp_path / "out")
    assert result.exit_code == 0
    assert np.array_equal(result.stations["s0"].pose, np.eye(4))


def test_the_same_content_twice_is_registered_once_and_named(tmp_path):
    paths = write_site(tmp_path / "site", 3)
    again = shutil.copy(paths[0], tmp_path / "site" / "z-copy.e57")
    result = register([again, *paths], tmp_path / "out")
    assert set(result.stations) == {"s0", "s1", "s2"}
    (failure,) = result.failures
    assert Path(failure.path).name == "z-copy.e57"
    assert failure.reason == f"the same content as {paths[0]}, which is used"


def test_files_that_differ_in_one_byte_are_both_used(tmp_path):
    one, other = write_site(tmp_path, 2)
    blank = b" " * 200_000
    one.write_bytes(one.read_bytes() + blank)
    other.write_bytes(one.read_bytes()[:-70_001] + b"\n" + one.read_bytes()[-70_000:])
    result = register([one, other], tmp_path / "out")
    assert set(result.stations) == {"s0", "s1"}


def test_the_same_file_named_twice_is_one_file(tmp_path):
    paths = write_site(tmp_path / "site", 3)
    (tmp_path / "link.e57").symlink_to(paths[1])
    result = register([*paths, paths[0], tmp_path / "site", tmp_path / "link.e57"], None)
    assert len(result.stations) == 3
    assert result.failures == ()


def test_what_jobs_wrote_is_not_taken_for_scans(tmp_path):
    site = tmp_path / "site"
    for k in range(2):
        write_scans(site / f"setup{k}" / "scan.e57", 10.0 * k)
    register([site], site / "out")
    with OutputFolder(site / "out") as folder, folder.replacing("written.e57") as part:
        write_scans(part, 500.0)
    result = register([site], site / "out")
    assert set(result.stations) == {"setup0/scan.e57", "setup1/scan.e57"}


def test_scans_beside_what_jobs_wrote_are_taken(tmp_path):
    site = tmp_path / "site"
    write_scans(site / "setup0" / "scan.e57", 10.0)
    register([site / "setup0"], site / "setup0")
    write_scans(site / "setup0" / "later.e57", 500.0)
    assert set(register([site], None).stations) == {"later", "scan"}


def test_names_are_the_files_own_and_never_the_same(tmp_path):
    headers = []
    for path, count in {"a/s.e57": 1, "b/s.e57": 1, "b/s.ptx": 1, "b/t.e57": 2, "u.e57": 1}.items():
        headers += fake_stages().read_headers(write_scans(tmp_path / path, *map(float, range(count))))
    headers += [
        replace(h, name="twin") for h in fake_stages().read_headers(write_scans(tmp_path / "w.e57", 1, 2))
    ]
    contents = [f"{k}" for k in range(len(headers))]
    names = unique_names(headers, contents)
    assert names == [
        *("a/s.e57", "b/s.e57", "s.ptx", "t/setup 0", "t/setup 1", "u", "w/1", "w/2"),
    ]
    order = np.random.default_rng(0).permutation(len(headers))
    assert unique_names([headers[k] for k in order], [contents[k] for k in order]) == [
        names[k] for k in order
    ]


def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path):
    path = write_scans(tmp_path / "s.e57", 1.0)
    file = SourceFile.of(path)
    path.write_bytes(b"more" * 100)
    with pytest.raises(InputError, match="changed while it was read"):
        file.sha256()


def test_a_prepared_scan_that_vanishes_in_mid_run_is_said_so(tmp_path):
    paths = write_site(tmp_path / "site", 40)
    out = tmp_path / "out"
    steps = fake_stages()

    def pairs(stations, history):
        shutil.rmtree(out / JOB_FOLDER / "prepared")
        return [PairRequest(stations[0].name, stations[k].name, "a test") for k in range(1, 40)]

    with pytest.raises(OutputError, match="removed or damaged while the job ran"):
        trihedral.api.register(paths, out, steps=replace(steps, candidate_pairs=pairs))


def test_a_failing_stage_is_raised_as_it_is(tmp_path):
    def fail(a, b, seed):
        raise ZeroDivisionError("ours")

    with pytest.raises(ZeroDivisionError, match="ours"):
        trihedral.api.register(write_site(tmp_path, 3), steps=replace(fake_stages(), register_pair=fail))


def test_bad_numbers_of_threads_and_no_paths_are_refused(tmp_path):
    with pytest.raises(OptionError, match="at least 1, not 0"):
        register(write_site(tmp_path, 1), None, threads=0)
    with pytest.raises(TrihedralError, match="no scan"):
        register([], None)


def test_an_output_folder_that_is_a_file_is_refused(tmp_path):
    (scan,) = write_site(tmp_path, 1)
    with pytest.raises(OutputError, match="it is a file, not a folder"):
        register([scan], scan)
    with pytest.raises(OutputError, match="a part of the path is a file"):
        register([scan], scan / "out")
    assert scan.read_text().startswith("[")


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EACCES, errno.EROFS])
def test_errors_of_the_disk_are_said_and_leave_nothing_half_written(tmp_path, code, monkeypatch):
    def full(self, path):
        path.write_bytes(b"some")
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(FakePrepared, "save", full)
    reason = {errno.ENOSPC: "the disk is full", errno.EACCES: "no permission", errno.EROFS: "read-only"}[code]
    with pytest.raises(OutputError, match=reason):
        register(write_site(tmp_path / "site", 2), tmp_path / "out")
    assert list((tmp_path / "out" / JOB_FOLDER / "prepared/1").iterdir()) == []


def test_the_result_says_which_pairs_were_tried_and_why(tmp_path):
    write_site(tmp_path / "site", 5)
    for _ in range(2):  # the second run finds all done, and says the same
        document = trihedral.api.register(tmp_path / "site", tmp_path / "out", steps=fake_stages()).document
        assert document["pairs"] == {
            "looked_at": 0,
            "never_looked_at": [],
            "passed_over": 0,
            "possible": 10,
            "registered": 7,
            "rounds": [
                {"accepted": 4, "looked_at": 0, "registered": 4},
                {"accepted": 3, "looked_at": 0, "registered": 3},
            ],
        }
        assert {link["tried_because"] for link in document["links"]} == {"neighbours"}


def test_each_preview_is_in_the_result_with_what_was_decided_of_it(tmp_path):
    paths = write_site(tmp_path / "site", 6)
    steps = previewing(fake_stages())
    document = trihedral.api.register(paths, tmp_path / "out", steps=steps, threads=2).document
    assert document["schema"] == "trihedral.registration/1"
    # Stations stand 10 m apart: s0 at 0, s5 at 50.
    expected = {(j, k): 10 * (k - j) for j in range(6) for k in range(j + 1, 6) if k - j <= 3}
    rows = {
        tuple(sorted(int(preview[end][1:]) for end in ("from", "to"))): preview
        for preview in document["looks"]
    }
    assert rows.keys() == expected.keys() and len(document["looks"]) == 12
    for pair, metres in expected.items():
        preview = rows[pair]
        assert (preview["because"], preview["round"]) == ("within three steps", 1)
        assert preview["score"] == 1 / metres
        assert preview["likeness"] == (None if metres == 30 else 0.9)
        if metres == 10:
            assert (preview["decision"], preview["reason"]) == ("registered", None)
        else:
            assert (preview["decision"], preview["reason"]) == ("passed over", f"score {1 / metres:.2f}")
    linked = {(link["from"], link["to"]) for link in document["links"]}
    assert linked == {(k["from"], k["to"]) for k in document["looks"] if k["decision"] == "registered"}
    pairs = document["pairs"]
    assert (pairs["possible"], pairs["looked_at"], pairs["registered"], pairs["passed_over"]) == (
        15,
        12,
        5,
        7,
    )
    assert pairs["never_looked_at"] == [{"because": "farther than three steps", "pairs": 3}]
    # Another order, another number of threads, and a run that finds all done.
    again = trihedral.api.register(paths[::-1], tmp_path / "again", steps=steps, threads=1).document
    resumed = trihedral.api.register(paths, tmp_path / "out", steps=steps, threads=5).document
    assert again["looks"] == resumed["looks"] == document["looks"]
    assert again["pairs"] == resumed["pairs"] == pairs


def test_what_was_found_on_reading_the_points_is_in_the_result(tmp_path):
    """Also of a scan that is not prepared again."""
    paths = write_site(tmp_path / "site", 2)
    note = "12 points (40.0%) have no colour"
    steps = fake_stages()

    def prepare(scan):
        return replace(steps.prepare(scan), notes=(note,))

    def placed(prepared, header):
        return replace(header, notes=prepared.notes)

    told = replace(steps, prepare=prepare, placed=placed)
    for _ in range(2):
        result = trihedral.api.register(paths, tmp_path / "out", steps=told)
        assert [station["notes"] for station in result.document["stations"]] == [[note], [note]]
