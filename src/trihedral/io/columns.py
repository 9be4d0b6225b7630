"""What is said of the columns of text files."""

from itertools import groupby
from typing import Protocol

_PARTS = (("x y z", 3), ("intensity", 1), ("red green blue", 3))
# Runs of columns that a note names.
_MOST_RUNS = 8


class Columns(Protocol):
    """What a parser found."""

    @property
    def used(self) -> list[int]:
        """Columns that are read, from 0: of x, y, z, then of intensity and colour where there are."""

    @property
    def columns(self) -> int:
        """Numbers in a row."""

    @property
    def intensity(self) -> bool:
        """Whether one is read."""

    @property
    def color(self) -> bool:
        """Whether one is read."""


def columns_read(found: Columns) -> str:
    """Name what is read, with its columns counted from 1."""
    left, said = list(found.used), []
    for (name, count), there in zip(_PARTS, (True, found.intensity, found.color), strict=True):
        if there:
            taken, left = left[:count], left[count:]
            said.append(f"{name} ({', '.join(str(at + 1) for at in taken)})")
    return ", ".join(said)


def columns_unused(found: Columns, from_column: int = 0) -> list[str]:
    """Note which columns from one on (counted from 0) are not read, counted from 1."""
    unused = [at + 1 for at in range(from_column, found.columns) if at not in found.used]
    if not unused:
        return []
    runs = [[at for _, at in run] for _, run in groupby(enumerate(unused), lambda pair: pair[1] - pair[0])]
    texts = [str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs]
    more = f" and {len(runs) - _MOST_RUNS} more" if len(runs) > _MOST_RUNS else ""
    return [f"columns not used: {', '.join(texts[:_MOST_RUNS])}{more} (a heading would name them)"]
