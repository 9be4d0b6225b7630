"""`trihedral export`: registered data in a format that other programs read."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from trihedral.cli.options import JsonProgress, NoProgress
from trihedral.cli.terminal import show


class ExportFileFormat(StrEnum):
    """What can be written; the same names as `trihedral.export.registered.ExportFormat`."""

    e57 = "e57"
    laz = "laz"
    ply = "ply"
    pcd = "pcd"
    ptx = "ptx"


def export(
    out: Annotated[Path, typer.Argument(help="The folder that `trihedral register` wrote.")],
    kind: Annotated[
        ExportFileFormat, typer.Option("--format", "-f", help="Format to write.")
    ] = ExportFileFormat.e57,
    folder: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files.  [default: OUT/export]")
    ] = None,
    merged: Annotated[bool, typer.Option("--merged", help="All scans in one file.")] = False,
    quiet: NoProgress = False,
    json_progress: JsonProgress = False,
) -> int:
    """Write the registered scans, each in a file of its own or merged.

    E57 from E57 is a copy in which only the poses differ, unless a scan of the file is not placed.
    Scans that are not placed are left out and named. Prints the files that were written.

    Exits with 2 when a source has changed, is missing or damaged, or a file cannot be written.
    """
    from trihedral.cli.watch import watching
    from trihedral.export.registered import export as write

    with watching(quiet=quiet, as_json=json_progress) as progress:
        done = write(out, kind.value, folder, merged=merged, progress=progress)
        for name, reason in done.left_out:
            progress.note(f"not exported: {name}: {reason}")
        for note in done.notes:
            progress.note(note)
    for path in done.files:
        show(path)
    return 0
