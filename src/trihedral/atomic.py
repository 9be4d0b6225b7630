"""Writing a file so that it is either whole or not there."""

import contextlib
import errno
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from trihedral.errors import OutputError

# Ends the name of every file that is still being written; what a killed run leaves is known by it.
PART_SUFFIX = ".part"

_REASONS = {
    errno.ENOSPC: (
        "the disk is full",
        "Free some space and run the same command again: it goes on where it was",
    ),
    errno.EDQUOT: ("the disk quota is used up", "Free some space and run the same command again"),
    errno.EFBIG: ("the file would be larger than this system allows", "Choose another output folder"),
    errno.EACCES: ("there is no permission to write there", "Choose another output folder"),
    errno.EPERM: ("there is no permission to write there", "Choose another output folder"),
    errno.EROFS: ("the file system is read-only", "Choose another output folder"),
    errno.ENOTDIR: ("a part of the path is a file, not a folder", "Choose another output folder"),
    errno.ENAMETOOLONG: ("the name is too long", "Choose another output folder"),
}


def output_error(path: Path | str, error: OSError) -> OutputError:
    """Say what the system's error on writing `path` means to a person."""
    reason, advice = _REASONS.get(error.errno or 0, (error.strerror or str(error), ""))
    return OutputError(path, reason, advice=advice)


@contextlib.contextmanager
def replacing(path: Path, final: Callable[[Path], Path] | None = None) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; on leaving, flush it to disk and rename it into place.

    When the block raises, the temporary file is removed and what was at `path` before is untouched.

    Parameters
    ----------
    path
        Where the file is to be.
    final
        Gives, from the written file, a place in the same folder that it is to have instead of `path`.

    Raises
    ------
    OutputError
        The folder cannot be written or the disk is full.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}{PART_SUFFIX}")
    try:
        yield temporary
        _flush(temporary)
        temporary.replace(path if final is None else final(temporary))
        _flush_folder(path.parent)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise output_error(path, error) from error
        raise


def write_atomically(path: Path | str, data: bytes) -> None:
    """Write `data` to `path` as `replacing` does.

    Raises
    ------
    OutputError
        The folder cannot be written or the disk is full; what was at `path` before is untouched.
    """
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(data)


def remove_parts(folder: Path) -> None:
    """Remove what killed runs left half-written in a folder."""
    for part in folder.glob(f".*{PART_SUFFIX}"):
        part.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Make the rename itself survive a power cut, where the system can open folders."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
