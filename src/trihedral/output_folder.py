"""A folder that the program writes into, and what in it is the program's own.

`<folder>/.trihedral/` carries a mark, a lock and a list of the files that were written with the hash of each. Only what
the list names, and what still has its hash, is ever replaced; links are not followed. In `.trihedral/` itself, files of
the program's own names are its own.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import re
import stat
import time
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Self

from trihedral.atomic import flush, flush_folder, output_error, part_in, place, remove_parts
from trihedral.errors import OutputError

OWN_FOLDER = ".trihedral"
# Programs that save or clean disks know a cache by this file: https://bford.info/cachedir/
_MARK = "CACHEDIR.TAG"
_MARK_TEXT = (
    b"Signature: 8a477f597d28d172789f06886806bc55\n# Made by trihedral, which goes on from what is here.\n"
)
_LIST = "written.json"
_PARTS = "parts"
_PART = re.compile(r"[0-9a-f]{32}(\.\w+)?")
_PATIENCE = 0.5  # seconds that another run may take to let go
_FOREIGN = "trihedral did not write it, or it was changed since"


class OutputFolder:
    """A folder locked against other runs while it is open; made if it is not there.

    Raises
    ------
    OutputError
        It cannot be made or written, another run is using it, or its `.trihedral` is not the program's.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.own = self.path / OWN_FOLDER
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(self.path, "it is a file, not a folder", advice="Choose another output folder")
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            _make_marked(self.own)
            self._lock = self._locked()
        except OSError as error:
            raise output_error(self.path, error) from error
        try:
            self._parts = own_folder(self.own / _PARTS)
            for folder in (self.path, self.own, self._parts):
                remove_parts(folder)
            remove_own(self._parts, _PART)
            self._written = read_list(self.own)
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise output_error(self.path, error) from error
            raise

    def close(self) -> None:
        """Let other runs have it."""
        os.close(self._lock)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def check(self, names: Iterable[str]) -> None:
        """Raise an `OutputError` where a file of that name is not the program's own."""
        for name in names:
            self._own_hash(name)

    def holds(self, name: str, made_of: str) -> bool:
        """Whether a file was written here from just that, and still is as it was."""
        entry = self._written.get(name)
        return (
            entry is not None and entry["made_of"] == made_of and self._own_hash(name) == entry["sha256"][-1]
        )

    @contextlib.contextmanager
    def replacing(self, name: str, made_of: str = "") -> Iterator[Path]:
        """Give a path to write a new file to; on leaving, it takes the place of what was written there before.

        Parameters
        ----------
        made_of
            Says what the file is made of, for `holds`.

        Raises
        ------
        OutputError
            The file cannot be written, or what is at its place is not the program's own: that stays untouched.
        """
        target = self.path / name
        part = self._parts / f"{uuid.uuid4().hex}{target.suffix}"
        try:
            yield part
            flush(part)
            old, new = self._own_hash(name), sha256_of(part)
            # Said before it is done: after a kill either is known.
            hashes = [new] if old is None else [old, new]
            self._write_list({**self._written, name: {"sha256": hashes, "made_of": made_of}})
            if old is None:
                place(part, target)
            else:
                part.replace(target)
                flush_folder(self.path)
        except OSError as error:
            raise output_error(target, error) from error
        except OutputError as error:
            if error.path.parent != self._parts:
                raise
            raise OutputError(target, error.reason, advice=error.advice) from error
        finally:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)

    def write(self, name: str, data: bytes) -> None:
        """Write a small file as `replacing` does."""
        with self.replacing(name) as part:
            part.write_bytes(data)

    def _own_hash(self, name: str) -> str | None:
        """Give the hash of a file of the program's own; None where nothing is."""
        path = self.path / name
        try:
            regular = stat.S_ISREG(path.lstat().st_mode)
            found = sha256_of(path) if regular and name in self._written else None
        except FileNotFoundError:
            return None
        except OSError as error:
            raise output_error(path, error) from error
        if found is None or found not in self._written[name]["sha256"]:
            advice = "Move it away, or choose another output folder"
            raise OutputError(
                path, _FOREIGN if regular else "a link or a folder is in its place", advice=advice
            )
        return found

    def _locked(self) -> int:
        check_own_file(self.own / "lock")
        handle = os.open(self.own / "lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        until = time.monotonic() + _PATIENCE
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return handle
            except BlockingIOError:
                if time.monotonic() > until:
                    os.close(handle)
                    advice = "Wait until it ends, or choose another output folder"
                    raise OutputError(
                        self.path, "another run of trihedral is using it", advice=advice
                    ) from None
                time.sleep(_PATIENCE / 10)
            except BaseException:
                os.close(handle)
                raise

    def _write_list(self, written: dict[str, Any]) -> None:
        with part_in(self.own) as part:
            part.write_text(json.dumps(written, indent=0), encoding="ascii")
            flush(part)
            part.replace(self.own / _LIST)
            flush_folder(self.own)
        self._written = written


def is_marked(folder: Path) -> bool:
    """Whether a folder is a `.trihedral` that the program made."""
    with contextlib.suppress(OSError):
        kinds = (folder.lstat().st_mode, (folder / _MARK).lstat().st_mode)
        return stat.S_ISDIR(kinds[0]) and stat.S_ISREG(kinds[1])
    return False


def read_list(own: Path) -> dict[str, Any]:
    """Give the files that were written beside a `.trihedral`, by name; none where the list is damaged."""
    try:
        written = json.loads((own / _LIST).read_text(encoding="ascii")) if is_marked(own) else {}
        return {name: {"sha256": [*e["sha256"]], "made_of": e["made_of"]} for name, e in written.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def own_folder(path: Path) -> Path:
    """Make a folder in a `.trihedral`; an `OutputError` where a link or a file is in its place."""
    with contextlib.suppress(FileExistsError):
        path.mkdir()
    if not stat.S_ISDIR(path.lstat().st_mode):
        raise OutputError(path, "it is not a folder of trihedral's", advice="Move it away")
    return path


def check_own_file(path: Path) -> None:
    """Raise an `OutputError` where a link or a folder is in the place of a file in a `.trihedral`."""
    with contextlib.suppress(FileNotFoundError):
        found = path.lstat()
        if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
            raise OutputError(path, "it is not a file of trihedral's", advice="Move it away")


def remove_own(folder: Path, names: re.Pattern[str]) -> None:
    """Remove files of the program's own names from a folder; links and all else stay."""
    for path in [path for path in folder.iterdir() if names.fullmatch(path.name)]:
        if stat.S_ISREG(path.lstat().st_mode):
            path.unlink()


def sha256_of(path: Path) -> str:
    """Hash a file's content, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _make_marked(own: Path) -> None:
    """Make a `.trihedral` with its mark; an `OutputError` where another one is in its place."""
    own_folder(own)
    if is_marked(own):
        return
    if any(own.iterdir()):
        advice = "Move it away, or choose another output folder"
        raise OutputError(own, "it was not made by this version of trihedral", advice=advice)
    with contextlib.suppress(FileExistsError), (own / _MARK).open("xb") as mark:
        mark.write(_MARK_TEXT)
