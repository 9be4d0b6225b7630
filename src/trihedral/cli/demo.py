"""`trihedral demo`: a site made here, registered, and compared with its truth."""

from pathlib import Path
from typing import Annotated

import typer


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the scans and the result.")] = Path("demo-out"),
    seed: Annotated[int, typer.Option(min=0, help="Which site is made.")] = 1,
) -> int:
    """Simulate a small site, register it, and show how close the result is to the truth."""
    return 0
