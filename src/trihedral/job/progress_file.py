"""Where a run is, for those who ask while it runs: one small file, replaced about every second."""

import contextlib
import json
import os
import socket
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from trihedral.atomic import part_in
from trihedral.errors import InputError
from trihedral.guarded import is_finite_number, read_bytes
from trihedral.progress import Pace, Progress

PROGRESS_FILE = "progress.json"
_EVERY = 1.0  # seconds


@dataclass
class Phase:
    """One phase of a run."""

    name: str
    unit: str
    total: int
    done: int = 0
    seconds: float = 0.0
    rate: float | None = None  # of `measure`, or of things where it has none, a second
    measure: str = ""
    remaining_s: float | None = None


@dataclass
class Record:
    """What the file holds; times are seconds since 1970."""

    process: int
    machine: str
    began: float
    now: float
    ended: bool = False
    phases: list[Phase] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


class ProgressFile:
    """Tells another watcher all it is told, and keeps it in a file of the job's folder.

    What cannot be written there is not, since nothing depends on it.
    """

    def __init__(self, watcher: Progress, folder: Path) -> None:
        self._watcher = watcher
        self._path = folder / PROGRESS_FILE
        now = time.time()
        self._record = Record(os.getpid(), socket.gethostname(), now, now)
        self._pace = Pace(0.0)
        self._written = 0.0

    def phase(self, name: str, total: int, unit: str, work: float, measure: str) -> None:
        """Begin a phase."""
        self._pace = Pace(work)
        self._record.phases.append(Phase(name, unit, total, measure=measure))
        self._write()
        self._watcher.phase(name, total, unit, work, measure)

    def advance(self, detail: str, work: float) -> None:
        """Count a step."""
        self._pace.advance(work)
        phase = self._record.phases[-1]
        phase.done += 1
        if phase.done == phase.total or time.monotonic() - self._written >= _EVERY:
            self._write()
        self._watcher.advance(detail, work)

    def note(self, text: str) -> None:
        """Keep a note."""
        self._record.notes.append(text)
        self._write()
        self._watcher.note(text)

    def end(self) -> None:
        """The run has come to its end."""
        self._record.ended = True
        self._write()

    def _write(self) -> None:
        record = self._record
        record.now = time.time()
        if record.phases:
            phase = record.phases[-1]
            phase.seconds, phase.rate = self._pace.seconds, self._pace.rate
            phase.remaining_s = self._pace.remaining
        self._written = time.monotonic()
        with contextlib.suppress(OSError), part_in(self._path.parent) as part:
            part.write_text(json.dumps(asdict(record)), encoding="ascii")
            part.replace(self._path)


def _number_or_none(value: object) -> bool:
    return value is None or is_finite_number(value)


def _count(value: object) -> bool:
    return isinstance(value, int) and 0 <= value < 1 << 31


def _text(value: object) -> bool:
    return isinstance(value, str)


#: Of what a record and its phases hold.
_KINDS: dict[str, Callable[[object], bool]] = {
    **dict.fromkeys(("process", "total", "done"), _count),
    **dict.fromkeys(("began", "now", "seconds"), is_finite_number),
    **dict.fromkeys(("rate", "remaining_s"), _number_or_none),
    **dict.fromkeys(("machine", "name", "unit", "measure"), _text),
    "notes": lambda value: isinstance(value, list) and all(map(_text, value)),
}


def read_progress(folder: Path) -> Record | None:
    """Read what the last run left, or the running one has to say; None where there was none.

    Raises
    ------
    InputError
        The file is there and cannot be read.
    """
    path = folder / PROGRESS_FILE
    if not path.exists():
        return None
    try:
        values: dict[str, Any] = json.loads(read_bytes(path))
        if not isinstance(values["phases"], list):
            raise TypeError("phases are no list")
        phases = [Phase(**phase) for phase in values.pop("phases")]
        record = Record(**values, phases=phases)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(path, f"it cannot be read ({error})", advice="Run the command again") from None
    for entry in (record, *phases):
        for name, holds in _KINDS.items():
            if hasattr(entry, name) and not holds(getattr(entry, name)):
                raise InputError(path, "is of the wrong kind", place=name, advice="Run the command again")
    return record
