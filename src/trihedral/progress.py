"""How a long job says where it is, without printing."""

from typing import Protocol


class Progress(Protocol):
    """Who watches a job. All calls come from the thread that started the job."""

    def phase(self, name: str, total: int, unit: str, work: float, measure: str) -> None:
        """Begin a phase of `total` things called `unit`, which together are `work` of `measure`."""

    def advance(self, detail: str, work: float) -> None:
        """One thing more is done: which, and what it weighed."""

    def note(self, text: str) -> None:
        """Something a person should read now: a scan that failed, an assumption made."""


class Silent:
    """Watches nothing."""

    def phase(self, name: str, total: int, unit: str, work: float, measure: str) -> None:
        """Say nothing."""

    def advance(self, detail: str, work: float) -> None:
        """Say nothing."""

    def note(self, text: str) -> None:
        """Say nothing."""
