"""Who does the work of a job: what is asked of an executor, here or on a cluster, and what it gives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

from trihedral.errors import InputError
from trihedral.job.hashes import FileHashes, seed_of
from trihedral.job.inputs import SourceFile, failure_of
from trihedral.job.stages import PreparedStation, StoredScan
from trihedral.model.registration import Failure
from trihedral.scan import ScanHeader

T = TypeVar("T")

# Shorter than any line of any format: bounds the points of a file that does not state their number.
_BYTES_PER_STORED_POINT = 6


@dataclass(frozen=True)
class ScanTask:
    """One scan to be prepared."""

    file: SourceFile
    header: ScanHeader
    alone: bool  # in its file

    def failure(self, error: InputError) -> Failure:
        """Say why it cannot be used; where the file holds no other scan, that is said of the file."""
        return failure_of(self.file.path, error, self.header, alone=self.alone)

    def resolved(self) -> "ScanTask":
        """The same with a path that other processes find too."""
        path = self.file.path.resolve()
        return replace(self, file=replace(self.file, path=path), header=replace(self.header, source=path))

    @property
    def points(self) -> int:
        """As declared, or the most that the file could hold."""
        most = self.file.bytes // _BYTES_PER_STORED_POINT
        return most if self.header.points is None else self.header.points

    @property
    def label(self) -> str:
        """What a person knows it by."""
        name, source = self.header.name, self.header.source
        return source.name if name == source.stem else f"{source.name}: {name}"


@dataclass(frozen=True)
class PairTask:
    """Two stations to be worked on together."""

    a: PreparedStation
    b: PreparedStation

    @property
    def ends(self) -> tuple[str, str]:
        """Their names."""
        return self.a.name, self.b.name

    @property
    def seed(self) -> int:
        """Of all that is drawn for the pair."""
        return seed_of(self.a.content, self.b.content)


@dataclass(frozen=True)
class PairStep(Generic[T]):
    """Something that is done with pairs, each once; from any thread."""

    phase: str  # what a person reads of it
    apply: Callable[[Any, Any, int], T]  # to two prepared scans, with a seed; in any process
    key: Callable[[PairTask], str]  # of the outcome: hash of all that it depends on
    stored: Callable[[str], T | None]  # by its key
    save: Callable[[str, T], None]


class Executor(Protocol):
    """Does the work of a job and stores what comes of it, each as soon as it is there.

    Results are in the order of the tasks. `done` is called in the calling thread, in order of completion.
    """

    def prepare(
        self, tasks: Sequence[ScanTask], hashes: FileHashes, done: Callable[[ScanTask], None]
    ) -> list[StoredScan | InputError]:
        """Read, hash, prepare and store scans, or say why one cannot be used."""

    def each_pair(
        self, step: PairStep[T], tasks: Sequence[PairTask], done: Callable[[PairTask], None]
    ) -> list[T]:
        """Do a step with each pair."""
