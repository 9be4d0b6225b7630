"""What tells files, prepared scans and pairs apart: hashes of their content."""

import hashlib
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Self

from trihedral.job.inputs import SourceFile, natural
from trihedral.job.store import Store


def digest(*parts: str) -> str:
    """Hash some texts, hexadecimal."""
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def seed_of(*parts: str) -> int:
    """Make a number that any JSON reader keeps exactly."""
    return int(digest(*parts)[:12], 16)


@dataclass(frozen=True)
class HashedFile:
    """A file that the job has read."""

    path: str  # as the user gave it
    sha256: str  # of its bytes, hexadecimal
    bytes: int


class FileHashes:
    """Hashes of files, each file read once for it, beside other work; the store knows those of earlier runs."""

    def __init__(self, store: Store, threads: int) -> None:
        self._store = store
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="trihedral-hash")
        self._futures: dict[SourceFile, Future[str]] = {}
        self._lock = threading.Lock()

    def start(self, file: SourceFile) -> Future[str]:
        """Begin to hash a file, if nobody has."""
        with self._lock:
            if file not in self._futures:
                self._futures[file] = self._pool.submit(self._hash, file)
            return self._futures[file]

    def of(self, file: SourceFile) -> str:
        """Give the hash when it is there.

        Raises
        ------
        InputError
            The file cannot be read, or has changed since the job began.
        """
        return self.start(file).result()

    def of_read(self, file: SourceFile) -> str:
        """Give the hash of a file that was read since the job began; `InputError` if it has changed since then."""
        sha256 = self.of(file)
        file.check_unchanged()
        return sha256

    def put(self, file: SourceFile, sha256: str) -> None:
        """Take a hash that was made elsewhere."""
        future: Future[str] = Future()
        future.set_result(sha256)
        with self._lock:
            self._futures.setdefault(file, future)
        self._store.remember_sha256(file, sha256)

    def known(self, file: SourceFile) -> str | None:
        """Give the hash if it is there without reading the file."""
        with self._lock:
            future = self._futures.get(file)
        return future.result() if future is not None and future.done() else self._store.known_sha256(file)

    def may_be_stored(self, file: SourceFile) -> bool:
        """Whether the hash is known, or scans of a file of that size may be stored."""
        return self._store.may_know(file.bytes) or self._store.known_sha256(file) is not None

    def inputs(self) -> tuple[HashedFile, ...]:
        """Every file that was hashed, by path."""
        files = [
            HashedFile(str(file.path), future.result(), file.bytes)
            for file, future in self._futures.items()
            if future.exception() is None
        ]
        return tuple(sorted(files, key=lambda file: natural(file.path)))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _hash(self, file: SourceFile) -> str:
        sha256 = self._store.known_sha256(file)
        if sha256 is None:
            sha256 = file.sha256()
            self._store.remember_sha256(file, sha256)
        return sha256
