"""Errors that people read: what happened, where, and what to do about it."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path


def printable(text: str) -> str:
    """Replace control characters, which names of files may hold and terminals would obey."""
    return "".join(character if character.isprintable() else "?" for character in text)


class TrihedralError(Exception):
    """Base of every error that trihedral raises on purpose; its text is meant for the user."""


class InputError(TrihedralError):
    """A file that cannot be used.

    Parameters
    ----------
    reason
        What is wrong with it, as a clause without a final stop.
    place
        Where in the file: a line, a byte, a field; empty when it is the file as a whole.
    advice
        What the user can do, as a sentence without a final stop; empty when there is nothing.
    """

    def __init__(self, path: Path | str, reason: str, *, place: str = "", advice: str = "") -> None:
        self.path = Path(path)
        self.reason = reason
        self.place = place
        self.advice = advice
        where = f"{self.path}, {place}" if place else f"{self.path}"
        super().__init__(printable(f"{where}: {reason}." + (f" {advice}." if advice else "")))

    def __reduce__(self) -> tuple[object, ...]:
        return partial(type(self), self.path, self.reason, place=self.place, advice=self.advice), ()


class NothingToRegister(TrihedralError):  # noqa: N818 - it is an outcome as much as an error
    """No scan is left; each line of the reasons says why one input cannot be used."""

    summary = "There is no scan to register."

    def __init__(self, reasons: Sequence[str]) -> None:
        self.reasons = tuple(reasons)
        super().__init__("\n".join([self.summary, *reasons]))


class OptionError(TrihedralError):
    """An option with a value that makes no sense."""


class OutputError(TrihedralError):
    """A file or folder that cannot be written; `reason` and `advice` as of an `InputError`."""

    def __init__(self, path: Path | str, reason: str, *, advice: str = "") -> None:
        self.path = Path(path)
        self.reason = reason
        self.advice = advice
        super().__init__(
            printable(f"Cannot write {self.path}: {reason}." + (f" {advice}." if advice else ""))
        )

    def __reduce__(self) -> tuple[object, ...]:
        return partial(type(self), self.path, self.reason, advice=self.advice), ()
