"""Steps done by the workers of a Dask cluster: scans and the job folder lie on storage that all of them share.

Workers read scans, and read and write prepared ones; what they find goes back through the scheduler. Only the process
that was started by the person writes the database and the result.
"""

import importlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from trihedral.errors import InputError, OptionError, OutputError
from trihedral.job.inputs import SourceFile
from trihedral.job.prepared_cache import Shelf
from trihedral.model.link import PairResult
from trihedral.model.pairs import PairPreview
from trihedral.scan import Scan, ScanHeader
from trihedral.version import fingerprint

T = TypeVar("T")
R = TypeVar("R")

_CONNECTING = 20  # seconds


@dataclass(frozen=True)
class PreparedThere:
    """What the client needs of a scan that a worker has prepared."""

    sha256: str  # of the file
    key: str
    points: int
    descriptor: Any


@dataclass(frozen=True)
class Steps:
    """What workers do, as sent to them."""

    folder: Path  # of prepared scans, absolute
    program: str  # fingerprint of all of it
    read_scan: Callable[[ScanHeader], Scan]
    prepare: Callable[[Scan], Any]
    load: Callable[[Path], Any]
    describe: Callable[[Any], Any]
    register_pair: Callable[[Any, Any, int], PairResult]
    preview: Callable[[Any, Any], PairPreview] | None
    key: Callable[[str, int], str] = field(repr=False)  # of a prepared scan: hash of its file, number in it

    def prepare_scan(self, task: tuple[SourceFile, ScanHeader]) -> PreparedThere | InputError:
        """Read and prepare one scan and put it on the shelf."""
        _same_program(self.program)
        file, header = task
        try:
            scan = self.read_scan(header)
            if len(scan) == 0:
                raise InputError(file.path, "the scan has no valid points")
            prepared = self.prepare(scan)
            sha256 = _hash(file)
        except InputError as error:
            return error
        key = self.key(sha256, header.scan_index)
        _shelf(self).save(key, prepared)
        return PreparedThere(sha256, key, prepared.scanned_points, self.describe(prepared))

    def register(self, pair: tuple[str, str, int]) -> PairResult:
        """Register two prepared scans, named by their keys, with a seed."""
        _same_program(self.program)
        a, b, seed = pair
        return self.register_pair(self._taken(a), self._taken(b), seed)

    def preview_pair(self, pair: tuple[str, str]) -> PairPreview:
        """Preview two prepared scans, named by their keys."""
        _same_program(self.program)
        if self.preview is None:
            raise AssertionError("a preview was asked for, and there is none")
        return self.preview(self._taken(pair[0]), self._taken(pair[1]))

    def _taken(self, key: str) -> Any:
        prepared = _shelf(self).load(key)
        if prepared is None:
            raise OutputError(
                self.folder,
                f"the prepared scan {key} is not there",
                advice="Use an output folder that all workers see under the same path",
            )
        return prepared


class Cluster:
    """The workers of a Dask scheduler.

    Parameters
    ----------
    address
        Of the scheduler: "tcp://host:8786".

    Raises
    ------
    OptionError
        dask.distributed is not installed, or there is no scheduler at the address.
    """

    def __init__(self, address: str) -> None:
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

    def map(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        done: Callable[[int, R], None],
    ) -> list[R]:
        """Apply a function to every item on the workers; results are in the order of items.

        `done` is called in this thread with the place of an item and its result, in order of completion. What a worker
        that died was at is done by another.
        """
        futures = self._client.map(function, items, pure=False)
        place = {future.key: index for index, future in enumerate(futures)}
        results: list[Any] = [None] * len(items)
        try:
            for future, result in self._distributed.as_completed(futures, with_results=True):
                index = place[future.key]
                results[index] = result
                done(index, result)
                # A result that is here need not stay there.
                future.release()
        except self._distributed.KilledWorker as error:
            raise OptionError(f"Several workers died at the same step: {error}.") from None
        finally:
            self._client.cancel(futures)
        return results

    def close(self) -> None:
        """Leave the scheduler; its workers stay."""
        self._client.close()

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


_LOCK = threading.Lock()
_SHELVES: dict[tuple[Path, str], Shelf] = {}


def _shelf(steps: Steps) -> Shelf:
    """The worker's own shelf on the shared folder, with what it holds in memory."""
    with _LOCK:
        key = (steps.folder, steps.program)
        if key not in _SHELVES:
            _SHELVES.clear()
            _SHELVES[key] = Shelf(steps.folder, steps.load)
        return _SHELVES[key]


@cache
def _hash(file: SourceFile) -> str:
    return file.sha256()


def whole_program() -> str:
    """Fingerprint of all that workers run."""
    return fingerprint("")


@cache
def _own_program() -> str:
    return whole_program()


def _same_program(program: str) -> None:
    if program != _own_program():
        raise OptionError(
            "A worker runs another version of trihedral: install the same one everywhere and start the workers anew."
        )
