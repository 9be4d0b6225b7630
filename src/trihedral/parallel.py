"""Work on several threads whose results do not depend on how many there are."""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from typing import TypeVar

# Headers of NumPy's files are Python literals, and Python 3.11 counts how deep it is in one for all threads together:
# two that are read at once may fail with a SystemError (CPython issue 106905). Held while one is read.
ARRAY_HEADERS = threading.Lock()

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def worker_threads(count: int) -> Iterator[ThreadPoolExecutor]:
    """Give threads for a block that waits for them.

    The first exception drops what has not begun and is raised when what has begun has ended, so that nothing is written
    any more. Ctrl-C is raised at once; a step already begun ends in its thread, and its result is dropped.
    """
    pool = ThreadPoolExecutor(count, thread_name_prefix="trihedral")
    try:
        yield pool
    except Exception:
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def ordered_map(
    function: Callable[[T], R],
    items: Sequence[T],
    threads: int,
    done: Callable[[T, R], None] = lambda item, result: None,
) -> list[R]:
    """Apply `function` to every item on `threads` threads; results are in the order of `items`.

    `done` is called in the calling thread, in order of completion.
    """
    with worker_threads(threads) as pool:
        futures = {pool.submit(function, item): item for item in items}
        for future in as_completed(futures):
            done(futures[future], future.result())
        return [future.result() for future in futures]


class MemoryBudget:
    """Lets steps run together only while what they need together fits; one alone may always run."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._used = 0
        self._freed = threading.Condition()

    @contextmanager
    def reserved(self, amount: int) -> Iterator[None]:
        """Wait until `amount` bytes are free, and hold them for the block."""
        with self._freed:
            self._freed.wait_for(lambda: self._used == 0 or self._used + amount <= self._limit)
            self._used += amount
        try:
            yield
        finally:
            with self._freed:
                self._used -= amount
                self._freed.notify_all()


def half_of_memory() -> int:
    """Half of this machine's memory in bytes; where the system does not say, no limit worth the name."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    except (AttributeError, OSError, ValueError):
        return 1 << 62


def processors() -> int:
    """Processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1
