"""The work of a job on threads of this process, as many scans at once as fit into memory."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from trihedral.errors import InputError
from trihedral.job.executor import PairStep, PairTask, ScanTask
from trihedral.job.hashes import FileHashes
from trihedral.job.stages import ScanSteps, StoredScan
from trihedral.job.store import Store
from trihedral.parallel import MemoryBudget, half_of_memory, ordered_map

T = TypeVar("T")

# What a raw point costs while it is read and prepared: its coordinates as stored in the file and as we store
# them, colour, grid indices, and the sort keys of the sampling.
_BYTES_PER_POINT = 64


class LocalExecutor:
    """So many threads of this process; prepared scans go into the store."""

    def __init__(self, steps: ScanSteps, store: Store, threads: int) -> None:
        self._steps = steps
        self._store = store
        self._threads = threads

    def prepare(
        self, tasks: Sequence[ScanTask], hashes: FileHashes, done: Callable[[ScanTask], None]
    ) -> list[StoredScan | InputError]:
        """Prepare scans; each file is hashed beside its reading."""
        budget = MemoryBudget(half_of_memory())

        def prepare(task: ScanTask) -> StoredScan | InputError:
            try:
                with budget.reserved(task.points * _BYTES_PER_POINT):
                    hashes.start(task.file)
                    return self._steps.store(task.header, lambda: hashes.of_read(task.file), self._store.save)
            except InputError as error:
                return error

        return ordered_map(prepare, tasks, self._threads, lambda task, _: done(task))

    def each_pair(
        self, step: PairStep[T], tasks: Sequence[PairTask], done: Callable[[PairTask], None]
    ) -> list[T]:
        """Do a step with each pair; the thread that does it stores the outcome."""

        def apply(task: PairTask) -> T:
            outcome = step.apply(task.a.load(), task.b.load(), task.seed)
            step.save(step.key(task), outcome)
            return outcome

        return ordered_map(apply, tasks, self._threads, lambda task, _: done(task))
