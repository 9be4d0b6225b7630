"""How a long job says where it is, without printing."""

import time
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Protocol, TypeVar

from trihedral.parallel import worker_threads

T = TypeVar("T")


class Progress(Protocol):
    """Who watches a job, by default nobody. All calls come from the thread that started the job."""

    def phase(self, name: str, total: int, unit: str, work: float, measure: str) -> None:
        """Begin a phase of `total` things called `unit`, which together are `work` of `measure`."""
        return

    def advance(self, detail: str, work: float) -> None:
        """One thing more is done: which, and what it weighed."""
        return

    def note(self, text: str) -> None:
        """Something a person should read now: a scan that failed, an assumption made."""
        return


class Silent(Progress):
    """Watches nothing."""


class _Relay:
    """Puts what it is told on a queue, for another thread to tell."""

    def __init__(self, watcher: Progress, queue: SimpleQueue[Callable[[], None] | None]) -> None:
        self._watcher = watcher
        self._queue = queue

    def phase(self, name: str, total: int, unit: str, work: float, measure: str) -> None:
        self._queue.put(lambda: self._watcher.phase(name, total, unit, work, measure))

    def advance(self, detail: str, work: float) -> None:
        self._queue.put(lambda: self._watcher.advance(detail, work))

    def note(self, text: str) -> None:
        self._queue.put(lambda: self._watcher.note(text))


def relayed(step: Callable[[Progress], T], watcher: Progress) -> T:
    """Run a step on a thread of its own; what it says of its progress is told here, to `watcher`.

    Ctrl-C reaches the calling thread only while it waits; it is raised at once.
    """
    queue: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
    with worker_threads(1) as pool:
        future = pool.submit(step, _Relay(watcher, queue))
        future.add_done_callback(lambda _: queue.put(None))
        while (tell := queue.get()) is not None:
            tell()
        return future.result()


class Pace:
    """How fast a phase goes, and how long it will go on, told once there is something to tell by.

    The rate is that of the last while only: the steps that a run finds done when it goes on where another stopped
    take no time, and are soon forgotten. The while grows with the phase, so that the remaining time does not jump
    about when steps differ. Work is in any measure; the clock gives seconds.
    """

    _LEAST_STEPS = 4
    _LEAST_SECONDS = 3.0
    _WINDOW = 20.0  # seconds, at least
    _SHARE = 0.3  # of the phase so far

    def __init__(self, work: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.work = work
        self.done = 0.0
        self.steps = 0
        self._clock = clock
        self._began = clock()
        self._past: deque[tuple[float, float, int]] = deque([(self._began, 0.0, 0)])

    def advance(self, work: float) -> None:
        """A step of so much work is done."""
        self.done += work
        self.steps += 1
        now = self._clock()
        self._past.append((now, self.done, self.steps))
        window = max(self._WINDOW, self._SHARE * (now - self._began))
        # One from before the window stays, where it begins.
        while len(self._past) > 2 and self._past[1][0] <= now - window:
            self._past.popleft()

    @property
    def seconds(self) -> float:
        """Since the phase began."""
        return self._clock() - self._began

    @property
    def rate(self) -> float | None:
        """Work a second; None while too little is done to tell."""
        (since, before, steps), (until, done, last) = self._past[0], self._past[-1]
        span = until - since
        if last - steps < self._LEAST_STEPS or span < self._LEAST_SECONDS or done <= before:
            return None
        return (done - before) / span

    @property
    def remaining(self) -> float | None:
        """Seconds until the phase ends; None while too little is done to tell."""
        rate = self.rate
        if rate is None:
            return None
        # Time goes on between steps.
        return max(0.0, (self.work - self.done) / rate - (self._clock() - self._past[-1][0]))
