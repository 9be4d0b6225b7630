"""`trihedral status`: where a job is, while it runs and after."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trihedral.cli.terminal import show, show_json

if TYPE_CHECKING:
    from trihedral.job.progress_file import Phase


def status(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The output folder of `trihedral register`.")],
    as_json: Annotated[bool, typer.Option("--json", help="Everything as JSON, for programs.")] = False,
) -> int:
    """Show where a job is: what is done, how fast it goes, how long it will take, what failed.

    Works beside a run and after it, also after one that was killed. Nothing is changed.

    Exits with 2 when the folder holds no job.
    """
    from trihedral.errors import InputError
    from trihedral.job.progress_file import read_progress
    from trihedral.job.sqlite_store import contents
    from trihedral.output_folder import OWN_FOLDER

    folder = out / OWN_FOLDER
    if not (folder / "job.sqlite").exists():
        raise InputError(out, "there is no job in it", advice="Name the folder given to --out")
    kept, record = contents(folder), read_progress(folder)
    state = "running" if kept.in_use else "finished" if record is not None and record.ended else "stopped"
    result = out / "registration.json"
    verdict = _verdict(result)
    if as_json:
        run = None if record is None else asdict(record)
        found = {"state": state, "verdict": verdict, "kept": asdict(kept), "run": run}
        show_json(found)
        return 0
    show(f"{out}: {state}")
    if record is not None:
        for phase in record.phases:
            show(f"  {_line(phase, current=state == 'running' and phase is record.phases[-1])}")
        for note in record.notes:
            show(f"  note: {note}")
    if kept.prepared is not None:
        show(f"kept: {kept.prepared} prepared scans, {kept.megabytes:.0f} MB")
    if kept.links is not None:
        show(f"      {kept.links} pairs registered, {kept.accepted} accepted; {kept.previews} previewed")
    if verdict is not None:
        older = "; of an earlier run" if state != "finished" else ""
        show(f"result: {verdict}{older}")
    if state == "stopped":
        show("Run the same command again: it goes on where it was.")
    return 0


def _verdict(result: Path) -> str | None:
    try:
        return str(json.loads(result.read_text(encoding="utf-8"))["verdict"]["text"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _line(phase: "Phase", *, current: bool) -> str:
    from trihedral.cli.watch import duration, per_second

    parts = [f"{phase.name}: {phase.done} of {phase.total} {phase.unit}".rstrip(), duration(phase.seconds)]
    if current and phase.rate is not None:
        parts.append(per_second(phase.rate, phase.measure or phase.unit))
    if current and phase.remaining_s is not None:
        parts.append(f"about {duration(phase.remaining_s)} left")
    return ", ".join(parts)
