"""Prepared scans as files, which any number of processes may read and add to.

Each file's name says what it was made from and what it holds: `<key>-<hash of the file>.npz`. It appears whole or not
at all, and what does not hold what its name says is taken for absent.
"""

import contextlib
import re
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from trihedral.atomic import flush, flush_folder, output_error, part_in
from trihedral.network.visiting_order import HELD
from trihedral.output_folder import sha256_of

STORED_NAME = re.compile(r"[0-9a-f]{32}-[0-9a-f]{32}\.npz")


class PreparedCache:
    """A folder of prepared scans, and the last few of them in memory.

    Any exception of `load`, which reads a prepared scan, means that the file is not usable.
    """

    def __init__(self, folder: Path, load: Callable[[Path], Any]) -> None:
        self.folder = folder
        self._load = load
        self._lock = threading.Lock()
        self._held: OrderedDict[str, Any] = OrderedDict()
        self._reading: dict[str, threading.Lock] = {}

    def load(self, key: str) -> Any | None:
        """Give a prepared scan, or None; a damaged one is removed."""
        with self._lock:
            reading = self._reading.setdefault(key, threading.Lock())
        # Pairs that share a scan are worked on at once: it is read once for them.
        with reading:
            with self._lock:
                if key in self._held:
                    self._held.move_to_end(key)
                    return self._held[key]
            for path in [p for p in self.folder.glob(f"{key}-*.npz") if not p.is_symlink()]:
                prepared = self._read(path)
                if prepared is not None:
                    self._hold(key, prepared)
                    return prepared
                with contextlib.suppress(OSError):
                    path.unlink()
            return None

    def save(self, key: str, prepared: Any) -> None:
        """Keep a prepared scan; an `OutputError` says that it cannot be written."""
        try:
            with part_in(self.folder) as part:
                prepared.save(part)
                flush(part)
                part.replace(self.folder / f"{key}-{sha256_of(part)[:32]}.npz")
                flush_folder(self.folder)
        except OSError as error:
            raise output_error(self.folder, error) from error
        self._hold(key, prepared)

    def __bool__(self) -> bool:
        """Whether there is anything in it."""
        return any(self.folder.iterdir())

    def _hold(self, key: str, prepared: Any) -> None:
        with self._lock:
            self._held[key] = prepared
            self._held.move_to_end(key)
            while len(self._held) > HELD:
                self._held.popitem(last=False)

    def _read(self, path: Path) -> Any | None:
        try:
            if path.stem.rpartition("-")[2] != sha256_of(path)[:32]:
                return None
            return self._load(path)
        except Exception:  # whatever is wrong with it, the scan is prepared again
            return None
