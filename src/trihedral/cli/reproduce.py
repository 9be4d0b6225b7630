"""`trihedral reproduce`: the source paper's experiments on simulated testbeds."""

from pathlib import Path
from typing import Annotated

import typer

from trihedral.cli import bug
from trihedral.cli.options import JsonProgress, NoProgress, Threads
from trihedral.cli.terminal import show
from trihedral.cli.threads import limit_threads


def reproduce(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for tables, plots and testbeds.")] = Path(
        "reproduce-out"
    ),
    table: Annotated[
        list[int] | None, typer.Option(min=2, max=6, help="Only this table; may be given again.")
    ] = None,
    seed: Annotated[
        list[int] | None,
        typer.Option(min=0, help="Of a testbed; may be given again.  [default: 1, 2 and 3]"),
    ] = None,
    points: Annotated[
        int, typer.Option(min=10_000, max=22_800_000, help="Beams a scan; the paper's rig sends the most.")
    ] = 600_000,
    threads: Threads = None,
    quiet: NoProgress = False,
    json_progress: JsonProgress = False,
) -> int:
    """Run the experiments of Kim, Chen and Cho (2017) and set their tables beside ours.

    Simulates their testbeds with a rig like theirs and writes reproduce.md, one CSV a table, trials.csv with
    everything that was measured, fig5-overlap.svg, fig5-distance.svg and a plan of each testbed.
    """
    limit_threads(threads)
    bug.folder = out

    from trihedral.cli.watch import watching
    from trihedral.reproduce.page import reproduce_tables

    with watching(quiet=quiet, as_json=json_progress) as progress:
        text = reproduce_tables(
            sorted(set(table or (2, 3, 4, 5, 6))),
            sorted(set(seed or (1, 2, 3))),
            out,
            points=points,
            threads=threads,
            progress=progress,
        )
    show(*text.split("\n"))
    return 0
