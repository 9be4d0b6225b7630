"""Seconds that each step of a pair takes."""

import time
from typing import TypeVar

T = TypeVar("T")


class Stopwatch:
    """Notes how long steps take that follow each other.

    Attributes
    ----------
    seconds
        Of each step, by its name.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str, result: T) -> T:
        """Note the time since the last step for this one, and hand its result on."""
        now = time.perf_counter()
        self.seconds[step] = now - self._last
        self._last = now
        return result
