"""Steps done by the workers of a Dask cluster: scans and the job folder lie on storage that all of them share.

Workers read scans, and read and write prepared ones; what they find goes back through the scheduler. Only the process
that was started by the person writes the database and the result.
"""

import importlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Self, TypeVar

from trihedral.errors import InputError, OptionError, OutputError
from trihedral.job.executor import PairStep, PairTask, ScanTask
from trihedral.job.hashes import FileHashes
from trihedral.job.inputs import SourceFile
from trihedral.job.prepared_cache import PreparedCache
from trihedral.job.stages import ScanSteps, StoredScan
from trihedral.job.store import Store
from trihedral.version import fingerprint

T = TypeVar("T")
R = TypeVar("R")

_CONNECTING = 20  # seconds


@dataclass(frozen=True)
class _Worker:
    """What workers do, as sent to them."""

    folder: Path  # of prepared scans, absolute
    program: str  # fingerprint of all of it
    steps: ScanSteps

    def prepare(self, task: ScanTask) -> StoredScan | InputError:
        """Read and prepare one scan and put it into the cache."""
        _same_program(self.program)

        def sha256() -> str:
            hashed = _hash(task.file)
            task.file.check_unchanged()
            return hashed

        try:
            return self.steps.store(task.header, sha256, _cache(self).save)
        except InputError as error:
            return error

    def apply(self, step: Callable[[Any, Any, int], T], pair: tuple[str, str, int]) -> T:
        """Do a step with two prepared scans, named by their keys, and a seed."""
        _same_program(self.program)
        a, b, seed = pair
        return step(self._taken(a), self._taken(b), seed)

    def _taken(self, key: str) -> Any:
        prepared = _cache(self).load(key)
        if prepared is None:
            raise OutputError(
                self.folder,
                f"the prepared scan {key} is not there",
                advice="Use an output folder that all workers see under the same path",
            )
        return prepared


class DaskExecutor:
    """The workers of a Dask scheduler at an address like "tcp://host:8786", who all see the store's folder.

    Raises
    ------
    OptionError
        The store has no such folder, dask.distributed is not installed, or there is no scheduler at the address.
    """

    def __init__(self, address: str, steps: ScanSteps, store: Store) -> None:
        if store.shared is None:
            raise OptionError(
                "A cluster needs an output folder, through which its workers share prepared scans."
            )
        self._worker = _Worker(store.shared, _own_program(), steps)
        try:
            distributed: Any = importlib.import_module("distributed")
        except ImportError:
            raise OptionError(
                "--dask needs dask.distributed: install it with pip install 'trihedral[dask]'."
            ) from None
        self._distributed = distributed
        try:
            self._client = distributed.Client(address, timeout=_CONNECTING)
        except (OSError, ValueError) as error:
            raise OptionError(f"There is no Dask scheduler at {address}: {error}.") from None

    def prepare(
        self, tasks: Sequence[ScanTask], hashes: FileHashes, done: Callable[[ScanTask], None]
    ) -> list[StoredScan | InputError]:
        """Prepare scans; workers hash their files."""

        def arrived(task: ScanTask, found: StoredScan | InputError) -> None:
            if isinstance(found, StoredScan):
                hashes.put(task.file, found.sha256)
            done(task)

        found = self._map(self._worker.prepare, tasks, ScanTask.resolved, arrived)
        # Workers know files by resolved paths; a person by those he gave.
        return [
            InputError(task.file.path, one.reason, place=one.place, advice=one.advice)
            if isinstance(one, InputError)
            else one
            for task, one in zip(tasks, found, strict=True)
        ]

    def each_pair(
        self, step: PairStep[T], tasks: Sequence[PairTask], done: Callable[[PairTask], None]
    ) -> list[T]:
        """Do a step with each pair; outcomes are stored here."""

        def arrived(task: PairTask, outcome: T) -> None:
            step.save(step.key(task), outcome)
            done(task)

        return self._map(
            partial(self._worker.apply, step.apply), tasks, lambda t: (t.a.key, t.b.key, t.seed), arrived
        )

    def _map(
        self,
        function: Callable[[Any], R],
        tasks: Sequence[T],
        sent: Callable[[T], object],
        arrived: Callable[[T, R], None],
    ) -> list[R]:
        """Apply a function to what is sent of every task; results are in the order of tasks.

        `arrived` is called in this thread with a task and its result, in order of completion. What a worker that died
        was at is done by another.
        """
        futures = self._client.map(function, [sent(task) for task in tasks], pure=False)
        place = {future.key: index for index, future in enumerate(futures)}
        results: list[Any] = [None] * len(tasks)
        try:
            for future, result in self._distributed.as_completed(futures, with_results=True):
                index = place[future.key]
                results[index] = result
                arrived(tasks[index], result)
                # A result that is here need not stay there.
                future.release()
        except self._distributed.KilledWorker as error:
            raise OptionError(f"Several workers died at the same step: {error}.") from None
        finally:
            self._client.cancel(futures)
        return results

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the scheduler; its workers stay."""
        self._client.close()


_LOCK = threading.Lock()
_CACHES: dict[tuple[Path, str], PreparedCache] = {}


def _cache(worker: _Worker) -> PreparedCache:
    """The worker's own cache of the shared folder, with what it holds in memory."""
    with _LOCK:
        key = (worker.folder, worker.program)
        if key not in _CACHES:
            _CACHES.clear()
            _CACHES[key] = PreparedCache(worker.folder, worker.steps.load)
        return _CACHES[key]


@cache
def _hash(file: SourceFile) -> str:
    return file.sha256()


@cache
def _own_program() -> str:
    """Fingerprint of all that workers run."""
    return fingerprint("")


def _same_program(program: str) -> None:
    if program != _own_program():
        raise OptionError(
            "A worker runs another version of trihedral: install the same one everywhere and start the workers anew."
        )
