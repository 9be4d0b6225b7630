"""Options that several verbs share."""

from pathlib import Path
from typing import Annotated

import typer

ScanPaths = Annotated[list[Path], typer.Argument(metavar="PATHS...", help="Scan files, and folders of them.")]
Threads = Annotated[
    int | None, typer.Option(min=1, help="Scans worked on at once.  [default: all processors]")
]
NoProgress = Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")]
JsonProgress = Annotated[
    bool, typer.Option("--json-progress", help="Progress as JSON, one object a line on standard error.")
]
