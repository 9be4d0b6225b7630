"""Progress on standard error: a live bar for a person, lines for a log, JSON for a program."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self

import rich.progress
from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, Task, TaskID, TextColumn
from rich.text import Text

from trihedral.errors import printable
from trihedral.progress import Pace, Progress, Silent


def duration(seconds: float) -> str:
    """Say a time as a person would: 8 s, 4 min 10 s, 2 h 05 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def per_second(rate: float, what: str) -> str:
    """Say a rate in the unit that suits it."""
    if rate >= 5e4:
        return f"{rate / 1e6:.1f} M {what}/s"
    if rate >= 1.0:
        return f"{rate:.1f} {what}/s"
    return f"{1 / rate:.1f} s a {what.removesuffix('s')}" if rate > 0 else ""


class _Rate(ProgressColumn):
    """Work done a second."""

    def render(self, task: Task) -> Text:
        pace: Pace = task.fields["pace"]
        if pace.rate is None:
            return Text("")
        return Text(per_second(pace.rate, task.fields["measure"] or task.fields["unit"]))


class _Remaining(ProgressColumn):
    """How long the phase will go on; nothing while that cannot be told."""

    def render(self, task: Task) -> Text:
        remaining = task.fields["pace"].remaining
        return Text("" if remaining is None else f"{duration(remaining)} left")


class Bar:
    """A live bar on a terminal; where standard error is a file, a line at the end of each phase."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._live = self._console.is_terminal
        self._bar = rich.progress.Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.fields[done]} of {task.fields[count]} {task.fields[unit]}"),
            _Rate(),
            _Remaining(),
            TextColumn("{task.fields[detail]}", markup=False),
            console=self._console,
            transient=True,
            disable=not self._live,
        )
        self._task: TaskID | None = None
        self._name = self._unit = ""
        self._done = self._count = 0
        self._pace = Pace(0.0)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._end()
        self._bar.stop()

    def phase(self, name: str, total: int, unit: str, work: float, measure: str) -> None:
        """Begin a bar."""
        self._end()
        self._name, self._unit, self._count, self._done = name, unit, total, 0
        self._pace = Pace(work)
        if total:
            self._task = self._bar.add_task(
                name, total=work, done=0, count=total, unit=unit, detail="", measure=measure, pace=self._pace
            )

    def advance(self, detail: str, work: float) -> None:
        """Move the bar."""
        self._done += 1
        self._pace.advance(work)
        if self._task is not None:
            self._bar.update(self._task, advance=work, done=self._done, detail=printable(detail))

    def note(self, text: str) -> None:
        """Print a line above the bar."""
        self._console.print(printable(text), markup=False)

    def _end(self) -> None:
        if self._count:
            unit = self._unit.removesuffix("s") if self._done == 1 else self._unit
            what = f"{self._name}: {self._done} {unit}" if unit else self._name
            self._console.print(f"{what}, {self._pace.seconds:.1f} s", markup=False)
        if self._task is not None:
            self._bar.remove_task(self._task)
            self._task = None
        self._count = 0


class Lines:
    """One JSON object a line on standard error."""

    def __init__(self) -> None:
        self._pace = Pace(0.0)

    def phase(self, name: str, total: int, unit: str, work: float, measure: str) -> None:
        """Write the beginning of a phase."""
        self._pace = Pace(work)
        _write({"phase": name, "total": total, "unit": unit, "work": work, "measure": measure})

    def advance(self, detail: str, work: float) -> None:
        """Write a step, how many there were, work a second and the seconds until the phase ends, where told."""
        self._pace.advance(work)
        rate, remaining = self._pace.rate, self._pace.remaining
        _write(
            {
                "done": detail,
                "work": work,
                "count": self._pace.steps,
                "rate": None if rate is None else float(f"{rate:.4g}"),
                "remaining_s": None if remaining is None else round(remaining, 1),
            }
        )

    def note(self, text: str) -> None:
        """Write a note."""
        _write({"note": text})


class Quiet(Silent):
    """Says nothing but what a person must know."""

    def note(self, text: str) -> None:
        """Write a line."""
        print(printable(text), file=sys.stderr)  # noqa: T201


@contextmanager
def watching(*, quiet: bool, as_json: bool) -> Iterator[Progress]:
    """Give the watcher that the options ask for."""
    if as_json:
        yield Lines()
    elif quiet:
        yield Quiet()
    else:
        with Bar() as bar:
            yield bar


def _write(record: dict[str, object]) -> None:
    print(json.dumps(record), file=sys.stderr, flush=True)  # noqa: T201
