"""Which program this is: for results, for bug reports, and for what was stored by another one."""

import hashlib
import importlib.metadata
from pathlib import Path

VERSION = importlib.metadata.version("trihedral")


def fingerprint(*parts: str) -> str:
    """Hash of the program's own files in the given rooms, and of its compiled core.

    Stored results carry it, so that those of another program are never taken for this one's.

    Parameters
    ----------
    parts
        Folders and files of the package: "io", "pipeline.py".

    Raises
    ------
    ValueError
        A part is not there or holds no source: results would not depend on it.
    """
    package = Path(__file__).parent
    files = [path for part in parts for path in _sources(package, part)]
    digest = hashlib.sha256(VERSION.encode())
    for path in sorted(files) + sorted(package.glob("_core*")):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _sources(package: Path, part: str) -> list[Path]:
    path = package / part
    found = [path] if path.is_file() else list(path.rglob("*.py"))
    if not found:
        raise ValueError(f"there is no source in {part!r} of the package")
    return found
