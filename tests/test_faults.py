"""Every step of writing a job's output fails once: nothing is half-written or lost, and one line says it."""

import errno
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import trihedral.api
from support.job_fakes import fake_stages, write_site
from trihedral.errors import OutputError, TrihedralError
from trihedral.output_folder import OWN_FOLDER

RESULTS = {"report.html", "poses.csv", "registration.json"}


class Faults:
    """Counts calls of the system that write, and has one of them fail."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.count, self.fatal = 0, -1
        for name in ("fsync", "link", "replace", "rename", "mkdir"):
            patch.setattr(os, name, self._counted(getattr(os, name)))
        patch.setattr(os, "open", self._counted(os.open, lambda *a: bool(a[1] & os.O_CREAT)))
        for name in ("write_bytes", "write_text"):
            patch.setattr(Path, name, self._counted(getattr(Path, name)))

    def _counted(
        self, call: Callable[..., Any], counts: Callable[..., bool] = lambda *_: True
    ) -> Callable[..., Any]:
        def counted(*arguments: Any, **named: Any) -> Any:
            if counts(*arguments):
                self.count += 1
                if self.count == self.fatal:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return call(*arguments, **named)

        return counted

    def begin(self, fatal: int) -> None:
        self.count, self.fatal = 0, fatal


def content(out: Path) -> dict[str, Any]:
    """What a result says, times apart."""
    document = json.loads((out / "registration.json").read_text(encoding="utf-8"))
    del document["timing"]
    return {"document": document, "poses": (out / "poses.csv").read_bytes()}


@pytest.mark.parametrize("again", [False, True], ids=["first", "again"])
def test_each_failure_of_writing_is_one_line_and_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, again: bool
) -> None:
    paths = write_site(tmp_path / "site", 2)

    def register(out: Path) -> None:
        trihedral.api.register(paths, out, steps=fake_stages(), threads=1)

    register(tmp_path / "true")
    truth = content(tmp_path / "true")
    faults = Faults(monkeypatch)
    fatal, failed = 0, 0
    while True:
        # A later run takes the same steps but for the cache: every third will do.
        fatal += 3 if again else 1
        out = tmp_path / f"out{fatal}"
        shutil.copytree(tmp_path / "true", out) if again else out.mkdir()
        (out / "mine.part").write_text("mine")
        faults.begin(fatal)
        try:
            register(out)
        except TrihedralError as error:
            assert isinstance(error, OutputError)
            assert "the disk is full" in str(error)
            assert "\n" not in str(error)
            failed += 1
        done = faults.count < fatal
        faults.begin(-1)
        assert (out / "mine.part").read_text() == "mine"
        there = {path.name for path in out.iterdir()} - {"mine.part", OWN_FOLDER}
        assert there <= RESULTS, "nothing half-written lies about"
        if "report.html" in there:
            assert (out / "report.html").read_bytes().rstrip().endswith(b"</html>")
        if "poses.csv" in there:
            assert (out / "poses.csv").read_bytes() == truth["poses"]
        if "registration.json" in there:
            assert content(out) == truth
        register(out)
        assert content(out) == truth
        assert not [path for path in out.rglob("*.part") if path.name != "mine.part"]
        if done:
            break
    assert failed > (5 if again else 15)
