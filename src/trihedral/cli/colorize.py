"""`trihedral colorize`: colours of pictures onto points."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from trihedral.cli.options import JsonProgress, NoProgress
from trihedral.cli.terminal import show


class ColoredFileFormat(StrEnum):
    """What can be written; the same names as `trihedral.export.colored.ColoredFormat`."""

    e57 = "e57"
    ply = "ply"
    laz = "laz"


def colorize(
    scans: Annotated[list[Path], typer.Argument(metavar="SCANS...", help="Scan files, and folders of them.")],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="A folder; or a file .e57, .ply or .laz, which must not exist."),
    ],
    kind: Annotated[
        ColoredFileFormat, typer.Option("--format", "-f", help="Format of the files in a folder.")
    ] = ColoredFileFormat.e57,
    photos: Annotated[
        list[Path] | None,
        typer.Option(help="A loose picture, or a folder of them; may be given several times."),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="Camera file of the loose pictures; see docs/cameras.md.")
    ] = None,
    quiet: NoProgress = False,
    json_progress: JsonProgress = False,
) -> int:
    """Give points the colours of the pictures that see them.

    Pictures are those in the scan file (E57, a rig's) or loose ones with a camera file. Points behind the
    camera or behind something nearer take no colour; overlapping pictures are brought to one exposure and
    blended. Points that no picture sees keep the colour they had, or are black.

    Exits with 2 when a file cannot be used or no picture shows anything of a scan.
    """
    from trihedral.cli.watch import watching
    from trihedral.export.colored import colorize_files

    with watching(quiet=quiet, as_json=json_progress) as progress:
        done = colorize_files(scans, out, kind.value, pictures=photos or (), camera=camera, progress=progress)
        for scan in done:
            for photo in scan.photos:
                if photo.reason:
                    progress.note(f"{scan.name}: picture {photo.name} not used: {photo.reason}")
    for scan in done:
        used = sum(not photo.reason for photo in scan.photos)
        share = scan.colored / max(scan.points, 1)
        show(
            f"{scan.file}: {scan.colored:,} of {scan.points:,} points coloured ({share:.0%}) from "
            f"{used} {'picture' if used == 1 else 'pictures'}"
        )
    return 0
