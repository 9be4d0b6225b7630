"""Writing files that are whole or not there, in places where nothing is.

A file is written under a name of our own, flushed and then given its place; what is there already is neither replaced
nor followed. What a kill leaves is known by its name and by nobody holding a lock on it. Folders in which files may be
replaced are in `output_folder`.
"""

import contextlib
import errno
import fcntl
import os
import re
import stat
import uuid
from collections.abc import Iterator
from pathlib import Path

from trihedral.errors import OutputError

# The name of every file that is still being written.
_PART = re.compile(r"\.trihedral-[0-9a-f]{32}\.part")

_EXISTS = ("it exists already", "Remove it, or choose another name")
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
    errno.EEXIST: _EXISTS,
}
# Of file systems that have no hard links.
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


def output_error(path: Path | str, error: OSError) -> OutputError:
    """Say what the system's error on writing `path` means to a person."""
    reason, advice = _REASONS.get(error.errno or 0, (error.strerror or str(error), ""))
    return OutputError(path, reason, advice=advice)


@contextlib.contextmanager
def creating(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; on leaving, flush it to disk and give it its place.

    When the block raises, the temporary file is removed.

    Raises
    ------
    OutputError
        Something is at `path`, the folder cannot be written, or the disk is full.
    """
    try:
        check_absent(path)
        remove_parts(path.parent)
        with part_in(path.parent) as part:
            yield part
            flush(part)
            place(part, path)
    except OSError as error:
        raise output_error(path, error) from error


def write_new(path: Path | str, data: bytes) -> None:
    """Write `data` to `path` as `creating` does; `OutputError` if it cannot be."""
    with creating(Path(path)) as part:
        part.write_bytes(data)


def check_absent(path: Path) -> None:
    """Raise an `OutputError` where something is at `path`, be it a link that leads nowhere."""
    if os.path.lexists(path):
        raise OutputError(path, _EXISTS[0], advice=_EXISTS[1])


@contextlib.contextmanager
def part_in(folder: Path) -> Iterator[Path]:
    """Make an empty file of our own in a folder, locked for as long as it is in use, and removed at the end."""
    part = folder / f".trihedral-{uuid.uuid4().hex}.part"
    handle = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield part
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        os.close(handle)


def remove_parts(folder: Path) -> None:
    """Remove what killed runs left half-written in a folder, and nothing else."""
    for part in [path for path in folder.iterdir() if _PART.fullmatch(path.name)]:
        with contextlib.suppress(OSError):
            handle = os.open(part, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if stat.S_ISREG(os.fstat(handle).st_mode):
                    part.unlink()
            finally:
                os.close(handle)


def place(part: Path, path: Path) -> None:
    """Give a written file its place; `FileExistsError` where something is there."""
    try:
        os.link(part, path)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        check_absent(path)
        part.replace(path)
    with contextlib.suppress(OSError):
        part.unlink(missing_ok=True)
    flush_folder(path.parent)


def flush(path: Path) -> None:
    """Bring a file's content to the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def flush_folder(folder: Path) -> None:
    """Make names themselves survive a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
