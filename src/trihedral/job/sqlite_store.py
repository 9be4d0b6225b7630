"""The out/ folder: what a run leaves for the next one, safe against kills, damage and a second run at once.

`out/.trihedral/` holds a SQLite database (file hashes, outcomes of pairs) and `prepared/<program>/`, a
`PreparedCache`. Nothing in it is trusted unless its hash is right. What another version prepared is of no use to this
one, and is removed.
"""

import contextlib
import dataclasses
import hashlib
import os
import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self
from urllib.parse import quote

from trihedral.atomic import output_error, remove_parts
from trihedral.errors import OutputError
from trihedral.job.inputs import SourceFile
from trihedral.job.prepared_cache import STORED_NAME, PreparedCache
from trihedral.model.link import PairResult
from trihedral.model.pairs import PairPreview
from trihedral.model.storage import from_text, to_text
from trihedral.output_folder import OutputFolder, check_own_file, own_folder, remove_own

# Of the database's tables and of what is in them; a database of another layout is made anew.
_LAYOUT = 4
_TABLES = """
CREATE TABLE file (path TEXT PRIMARY KEY, bytes INTEGER, state TEXT, sha256 TEXT) WITHOUT ROWID;
CREATE TABLE pair (key TEXT PRIMARY KEY, outcome TEXT, sha256 TEXT) WITHOUT ROWID;
CREATE TABLE preview (key TEXT PRIMARY KEY, score REAL, appearance_similarity REAL, seconds REAL) WITHOUT ROWID;
"""
_DATABASE_FILES = ("job.sqlite", "job.sqlite-wal", "job.sqlite-shm", "job.sqlite-journal")
_IN_USE = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
_FORBIDDEN = (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM)
# What a person reads of SQLite's codes, and is told to do.
_REASONS = [
    (_IN_USE, "another run of trihedral is using it", "Wait until it ends, or choose another output folder"),
    ((sqlite3.SQLITE_FULL,), "the disk is full", "Free some space and run the same command again"),
    (_FORBIDDEN, "there is no permission to write there", "Choose another output folder"),
]


class SqliteStore:
    """A job on disk, locked against other processes while it is open; a `store.Store`.

    Parameters
    ----------
    out
        The output folder; made if it is not there.
    load
        Reads a prepared scan; any exception of it means that the file is not usable.
    program
        Names what prepares the scans.

    Raises
    ------
    OutputError
        The folder cannot be made or written, or another run is using it.
    """

    def __init__(self, out: Path | str, load: Callable[[Path], Any], program: str) -> None:
        self.outputs = OutputFolder(out)
        self.out, self.folder = self.outputs.path, self.outputs.own
        self._prepared = self.folder / "prepared" / program
        self._lock = threading.RLock()
        self._cache = PreparedCache(self._prepared, load)
        try:
            own_folder(own_folder(self._prepared.parent) / program)
            remove_parts(self._prepared)
            for other in self._prepared.parent.iterdir():
                if other != self._prepared and other.is_dir() and not other.is_symlink():
                    _clear(other)
            self._database = self._open()
        except BaseException as error:
            self.outputs.close()
            if isinstance(error, OSError):
                raise output_error(self.out, error) from error
            raise

    def close(self) -> None:
        """Let other runs have it."""
        with self._lock:
            self._database.close()
        self.outputs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def known_sha256(self, file: SourceFile) -> str | None:
        """Hash of a file that is, with all that belongs to it, in the state in which it was hashed."""
        row = self._query(
            "SELECT sha256 FROM file WHERE path = ? AND state = ?", (_absolute(file), file.state)
        )
        return None if row is None else str(row[0])

    def remember_sha256(self, file: SourceFile, sha256: str) -> None:
        """Keep a file's hash, with the state that it is good for."""
        self._query(
            "INSERT OR REPLACE INTO file VALUES (?, ?, ?, ?)",
            (_absolute(file), file.bytes, file.state, sha256),
        )

    def may_know(self, size: int) -> bool:
        """Whether a file of that many bytes was hashed here, or scans are here whose files are not known."""
        if self._query("SELECT 1 FROM file WHERE bytes = ? LIMIT 1", (size,)) is not None:
            return True
        return self._query("SELECT 1 FROM file LIMIT 1", ()) is None and bool(self._cache)

    @property
    def shared(self) -> Path:
        """Folder of the prepared scans, for other processes."""
        return self._prepared.resolve()

    def load(self, key: str) -> Any | None:
        """Give a prepared scan, or None; a damaged one is removed."""
        return self._cache.load(key)

    def save(self, key: str, prepared: Any) -> None:
        """Keep a prepared scan; an `OutputError` says that it cannot be written."""
        self._cache.save(key, prepared)

    def result(self, key: str) -> PairResult | None:
        """Give the outcome of a pair, or None if there is none that can be trusted."""
        row = self._query("SELECT outcome, sha256 FROM pair WHERE key = ?", (key,))
        if row is None or hashlib.sha256(str(row[0]).encode()).hexdigest() != row[1]:
            return None
        try:
            return from_text(row[0])
        except Exception:  # of another layout: whatever is wrong with it, the pair is registered again
            return None

    def save_result(self, key: str, result: PairResult) -> None:
        """Keep the outcome of a pair."""
        text = to_text(result)
        digest = hashlib.sha256(text.encode()).hexdigest()
        self._query("INSERT OR REPLACE INTO pair VALUES (?, ?, ?)", (key, text, digest))

    def preview(self, key: str) -> PairPreview | None:
        """Give what a preview of a pair found, or None."""
        row = self._query("SELECT score, appearance_similarity, seconds FROM preview WHERE key = ?", (key,))
        return None if row is None else PairPreview(*row)

    def save_preview(self, key: str, preview: PairPreview) -> None:
        """Keep what a preview of a pair found."""
        values = (key, preview.score, preview.appearance_similarity, preview.seconds)
        self._query("INSERT OR REPLACE INTO preview VALUES (?, ?, ?, ?)", values)

    def _open(self) -> sqlite3.Connection:
        path = self.folder / "job.sqlite"
        for name in _DATABASE_FILES:
            check_own_file(self.folder / name)
        for attempt in range(2):
            database = None
            try:
                database = sqlite3.connect(path, timeout=0.5, isolation_level=None, check_same_thread=False)
                # Exclusive: one process at a time, known to the system, so that a kill leaves no stale lock;
                # and no shared memory, which network file systems lack.
                database.execute("PRAGMA locking_mode = EXCLUSIVE")
                database.execute("PRAGMA journal_mode = WAL")
                database.execute("PRAGMA synchronous = NORMAL")
                database.execute("BEGIN EXCLUSIVE")
                layout = database.execute("PRAGMA user_version").fetchone()[0]
                sound = database.execute("PRAGMA quick_check").fetchone()[0] == "ok"
                if layout == 0 and sound and not database.execute("SELECT 1 FROM sqlite_master").fetchone():
                    for statement in _TABLES.split(";"):
                        database.execute(statement)
                    database.execute(f"PRAGMA user_version = {_LAYOUT}")
                elif layout != _LAYOUT or not sound:
                    raise sqlite3.DatabaseError("another layout, or damaged")
                database.execute("COMMIT")
                return database
            except sqlite3.Error as error:
                if database is not None:
                    database.close()
                if attempt == 1 or not _damaged(error):
                    raise self._error(error) from error
                for name in _DATABASE_FILES:
                    (self.folder / name).unlink(missing_ok=True)
        raise AssertionError("the second attempt returns or raises")

    def _query(self, statement: str, values: tuple[object, ...]) -> Any:
        try:
            with self._lock:
                return self._database.execute(statement, values).fetchone()
        except sqlite3.Error as error:
            raise self._error(error) from error

    def _error(self, error: sqlite3.Error) -> OutputError:
        for codes, reason, advice in _REASONS:
            if _code(error) in codes:
                return OutputError(self.out, reason, advice=advice)
        advice = f"If it happens again, delete {self.folder}: only time is lost"
        return OutputError(self.folder / "job.sqlite", str(error), advice=advice)


@dataclasses.dataclass(frozen=True)
class JobContents:
    """What a job folder holds; None where it cannot be told while a run is using it."""

    in_use: bool
    prepared: int | None  # scans
    megabytes: float  # of them
    links: int | None = None
    accepted: int | None = None
    previews: int | None = None


def contents(folder: Path) -> JobContents:
    """Say what is in a job's folder without changing or locking it."""
    sizes = [path.stat().st_size for path in (folder / "prepared").glob("*/*.npz")]
    found = JobContents(False, len(sizes), sum(sizes) / 1e6)
    path = folder / "job.sqlite"
    if not path.exists():
        return found
    try:
        with contextlib.closing(
            sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True, timeout=0)
        ) as kept:
            count = "SELECT count(*) FROM"
            links = kept.execute(f"{count} pair").fetchone()[0]
            accepted = kept.execute(
                f"{count} pair WHERE json_extract(outcome, '$.verdict') = 'accepted'"
            ).fetchone()[0]
            previews = kept.execute(f"{count} preview").fetchone()[0]
    except sqlite3.Error as error:
        return dataclasses.replace(found, in_use=_code(error) in _IN_USE)
    return dataclasses.replace(found, links=links, accepted=accepted, previews=previews)


def _clear(folder: Path) -> None:
    """Remove what another version prepared, and the folder if nothing else is in it."""
    remove_parts(folder)
    remove_own(folder, STORED_NAME)
    with contextlib.suppress(OSError):
        folder.rmdir()


def _damaged(error: sqlite3.Error) -> bool:
    # Our own finding carries no code.
    return _code(error) in (0, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


def _code(error: sqlite3.Error) -> int:
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _absolute(file: SourceFile) -> str:
    # Names of files need not be text; SQLite's text must be.
    return os.fsencode(file.path.absolute()).hex()
