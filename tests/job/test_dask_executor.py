"""The same job on a Dask cluster: a scheduler and two workers on this machine, one of which is killed at work."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import trihedral
from support.job_fakes import ENVIRONMENT, fake_stages, looking, write_site
from trihedral.errors import OptionError
from trihedral.job.dask_executor import Cluster
from trihedral.simulate import ScannerOptions, make_site
from trihedral.simulate import write_site as write_simulated

WORKER_ENVIRONMENT = ENVIRONMENT | {"OMP_NUM_THREADS": "1"}


def dask(*arguments: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *map(str, arguments)],
        env=WORKER_ENVIRONMENT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


class Machines:
    def __init__(self, folder: Path) -> None:
        told = folder / "scheduler.json"
        self.scheduler = dask(
            "scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard", "--scheduler-file", told
        )
        self.workers = [
            dask("worker", "--scheduler-file", told, "--nthreads", 1, "--no-nanny", "--no-dashboard")
            for _ in range(2)
        ]
        for _ in range(600):
            if told.exists() and told.stat().st_size:
                break
            time.sleep(0.1)
        self.address = json.loads(told.read_text())["address"]

    def stop(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Machines]:
    found = Machines(tmp_path)
    yield found
    found.stop()


class Killer:
    """Watches a run, and kills a worker once so many steps of a phase are done."""

    def __init__(self, victim: subprocess.Popen[bytes], phase: str, after: int) -> None:
        self.victim, self.at, self.left = victim, phase, after
        self.now = ""

    def phase(self, name: str, *_: object) -> None:
        self.now = name

    def advance(self, *_: object) -> None:
        if self.now == self.at and self.left:
            self.left -= 1
            if not self.left:
                self.victim.kill()

    def note(self, text: str) -> None:
        raise AssertionError(text)


def result(out: Path) -> dict[str, object]:
    document = json.loads((out / "registration.json").read_text())
    del document["timing"]
    for link in document["links"]:
        del link["seconds"]
    return document


def test_real_scans_give_the_same_result_though_a_worker_dies(tmp_path: Path, machines: Machines):
    site = tmp_path / "site"
    for _ in write_simulated(make_site("office", 3, 4, ScannerOptions().with_beams(60_000)), site):
        pass
    (site / "bad.e57").write_bytes(b"ASTM-E57 and then nothing")
    trihedral.register(site, tmp_path / "local", threads=2)
    watcher = Killer(machines.workers[0], "Registering pairs", 2)
    watcher.note = lambda text: None
    trihedral.register(site, tmp_path / "there", dask=machines.address, progress=watcher)
    assert machines.workers[0].wait(10) != 0
    assert result(tmp_path / "there") == result(tmp_path / "local")
    assert any(link["accepted"] for link in result(tmp_path / "there")["links"])
    prepared = [
        {path.name: path.read_bytes() for path in (tmp_path / out / ".trihedral/prepared").rglob("*.npz")}
        for out in ("there", "local")
    ]
    assert prepared[0] == prepared[1]


def test_a_worker_dies_while_scans_are_prepared_and_the_next_run_finds_all_done(
    tmp_path: Path, machines: Machines
):
    site = tmp_path / "site"
    write_site(site, 12)
    steps = fake_stages(prepare_seconds=0.2)
    trihedral.register(site, tmp_path / "local", steps=steps)
    watcher = Killer(machines.workers[1], "Preparing scans", 3)
    trihedral.register(site, tmp_path / "there", steps=steps, dask=machines.address, progress=watcher)
    assert machines.workers[1].wait(10) != 0
    assert result(tmp_path / "there") == result(tmp_path / "local")
    # All that the workers found was kept here: nothing is done again, not even with no cluster.
    log: list[str] = []
    trihedral.register(site, tmp_path / "there", steps=fake_stages(log))
    assert log == []


def test_what_was_decided_of_previews_is_the_same(tmp_path: Path, machines: Machines):
    site = tmp_path / "site"
    write_site(site, 8)
    steps = looking(fake_stages())
    trihedral.register(site, tmp_path / "local", steps=steps)
    trihedral.register(site, tmp_path / "there", steps=steps, dask=machines.address)
    assert len(result(tmp_path / "local")["looks"]) == 18
    assert result(tmp_path / "there") == result(tmp_path / "local")


def test_no_scheduler_is_said(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("trihedral.job.dask_executor._CONNECTING", 1)
    with pytest.raises(OptionError, match=r"no Dask scheduler at tcp://127\.0\.0\.1:9"):
        Cluster("tcp://127.0.0.1:9")
