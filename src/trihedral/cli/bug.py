"""What a person can send us when trihedral itself fails."""

import importlib.metadata
import os
import platform
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from pathlib import Path

from trihedral.output_folder import OWN_FOLDER, is_marked

_PARTS = ("trihedral", "numpy", "scipy", "laspy", "typer", "rich")

# The output folder of the verb that runs, where a report is easiest to find.
folder: Path | None = None


def keep_report(error: BaseException, arguments: Sequence[str]) -> str:
    """Write what happened to a file and give the text that says where it is.

    The file is in `.trihedral/` of the output folder, or among the system's temporary files.
    """
    text = "\n".join(
        [
            f"command: {list(arguments)}",
            f"python: {sys.version}",
            f"system: {platform.platform()}",
            *(f"{part}: {_version(part)}" for part in _PARTS),
            "",
            "".join(traceback.format_exception(error)),
        ]
    )
    summary = (
        f"trihedral failed: {type(error).__name__}: {error}\nThis is a bug in trihedral, not in your data. "
    )
    own = None if folder is None else folder / OWN_FOLDER
    for place in [*([own] if own is not None and is_marked(own) else []), None]:
        try:
            # A name that nobody can foresee, and a file that only its owner reads.
            handle, path = tempfile.mkstemp(".txt", time.strftime("bug-%Y%m%d-%H%M%S-"), place)
            with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
                file.write(text)
        except OSError:
            continue
        return f"{summary}Please send us {path}: it holds the versions and the steps, no scan data."
    return f"{summary}Please send us this:\n{text}"


def _version(part: str) -> str:
    try:
        return importlib.metadata.version(part)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
