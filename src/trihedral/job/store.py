"""What outlives a step of a job, and what is kept while it runs where nothing is written."""

from pathlib import Path
from typing import Any, Protocol

from trihedral.job.inputs import SourceFile
from trihedral.model.link import PairResult
from trihedral.model.pairs import PairPreview


class Store(Protocol):
    """What outlives a step, by default nothing; `sqlite_store.SqliteStore` is the one on disk.

    Calls come from any thread.
    """

    def known_sha256(self, file: SourceFile) -> str | None:
        """Hash of a file that has not changed since it was last read."""
        return None

    def remember_sha256(self, file: SourceFile, sha256: str) -> None:
        """Keep a file's hash."""
        return

    def may_know(self, size: int) -> bool:
        """Whether scans of a file of that many bytes may be stored."""
        return False

    def load(self, key: str) -> Any | None:
        """Give a prepared scan, or None if there is none that can be trusted."""
        return None

    def save(self, key: str, prepared: Any) -> None:
        """Keep a prepared scan."""

    def result(self, key: str) -> PairResult | None:
        """Give the outcome of a pair, or None."""
        return None

    def save_result(self, key: str, result: PairResult) -> None:
        """Keep the outcome of a pair."""
        return

    def preview(self, key: str) -> PairPreview | None:
        """Give what a preview of a pair found, or None."""
        return None

    def save_preview(self, key: str, preview: PairPreview) -> None:
        """Keep what a preview found."""
        return

    @property
    def shared(self) -> Path | None:
        """Folder of the prepared scans, where other processes may read and add to them."""
        return None


class MemoryStore(Store):
    """Keeps prepared scans while the job runs and nothing after it."""

    def __init__(self) -> None:
        self._prepared: dict[str, Any] = {}

    def load(self, key: str) -> Any | None:
        """Give what this run prepared."""
        return self._prepared.get(key)

    def save(self, key: str, prepared: Any) -> None:
        """Keep it for this run."""
        self._prepared[key] = prepared
