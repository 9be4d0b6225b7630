"""Input files, opened and read in one way: regular files only, no more than they hold, errors that name them.

Everything that is read for a person goes through here or through the core, which holds to the same rules.
"""

import math
import os
import stat
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from trihedral.errors import InputError, TrihedralError

# What reading a file may take beside the program itself: so many bytes, and so many for each byte of the file.
_MEMORY, _MEMORY_PER_BYTE = 200_000_000, 20
# A description or table that a person writes is no larger than this (bytes).
_LARGEST_TEXT = 1 << 26
# Systems set the times of files by a clock that ticks at least so often (seconds).
_TICK = 0.05
# Where the system has no such flag, nothing in a folder makes opening wait.
_DO_NOT_WAIT = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
_REASONS: dict[type[OSError], str] = {
    FileNotFoundError: "there is no such file",
    PermissionError: "there is no permission to read it",
    IsADirectoryError: "it is a folder, not a file",
}


@dataclass(frozen=True)
class Stamp:
    """State of a file: while it stays, so does the content."""

    bytes: int
    modified_ns: int
    #: The system sets it, and nobody can set it back.
    changed_ns: int


def stamp_of(path: Path) -> Stamp:
    """Take the state of a regular file; `InputError` says why it cannot be read.

    Of a file that was changed this very moment the state is taken a tick later: a further change might leave it as it
    is.
    """
    with open_input(path) as stream:
        found = os.fstat(stream.fileno())
        if 0 <= time.time() - found.st_ctime < _TICK:
            time.sleep(_TICK)
            found = os.fstat(stream.fileno())
        return Stamp(found.st_size, found.st_mtime_ns, found.st_ctime_ns)


@contextmanager
def open_input(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file for reading; `InputError` for anything else, and for whatever the system says against it."""
    try:
        # Opening a pipe would wait for somebody to write into it.
        handle = os.open(path, os.O_RDONLY | _DO_NOT_WAIT)
    except ValueError:
        # A zero byte, which other files may put into a name.
        raise InputError(path, "no file can have that name") from None
    except OSError as error:
        raise _unreadable(path, error) from error
    try:
        with os.fdopen(handle, "rb") as stream:
            mode = os.fstat(handle).st_mode
            if not stat.S_ISREG(mode):
                raise InputError(path, "it is not a regular file")
            yield stream
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError) -> InputError:
    return InputError(
        path, _REASONS.get(type(error)) or f"it cannot be read: {(error.strerror or str(error)).lower()}"
    )


def allowed_memory(file_bytes: int) -> int:
    """Bytes of memory that reading a file of so many bytes may take."""
    return _MEMORY + _MEMORY_PER_BYTE * file_bytes


def read_bytes(path: Path, most: int | None = None) -> bytes:
    """Read a file, of at most so many bytes."""
    with open_input(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        if most is not None and size > most:
            raise InputError(
                path, f"it has {size:,} bytes, more than the {most:,} that are read of such a file"
            )
        # What grows meanwhile, or claims no size and never ends, is read no further.
        return stream.read(size)


def read_text(path: Path) -> str:
    """Read a description or table in UTF-8, with or without its mark."""
    try:
        return read_bytes(path, _LARGEST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(path, "it is not UTF-8 text", place=f"byte {error.start}") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file."""
    try:
        return tomllib.loads(read_text(path))
    except RecursionError:
        raise InputError(path, "it is no valid TOML: it is nested too deeply") from None
    except ValueError as error:
        # Numbers of thousands of digits are no `TOMLDecodeError`.
        raise InputError(path, f"it is no valid TOML: {error}") from None


def is_finite_number(value: object) -> bool:
    """Whether a value is a number that a float64 can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


@contextmanager
def blamed_on(path: Path, doing: str = "reading it") -> Iterator[None]:
    """Turn whatever goes wrong with a file into an `InputError` that names it: it must not cost the others."""
    try:
        yield
    except (TrihedralError, GeneratorExit, KeyboardInterrupt, SystemExit):
        raise
    except OSError as error:
        raise _unreadable(path, error) from error
    except MemoryError as error:
        raise InputError(
            path, f"{doing} needs more memory than there is", advice="Use fewer --threads, or a smaller file"
        ) from error
    except BaseException as error:
        # A panic of Rust is no `Exception`.
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        said = str(error)[:200] or "no reason given"
        raise InputError(
            path,
            f"{doing} failed ({type(error).__name__}: {said})",
            advice="If other programs read it without complaint, please send it to us",
        ) from error
