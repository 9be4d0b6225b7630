"""Markdown tables, and what the machine is, without its name."""

import os
from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path

WORK = Path(__file__).parent / "work"  # inputs that are made once; ignored by git
RESULTS = Path(__file__).parent / "results"


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Lay out a table; numbers to the right."""
    rows = [[str(cell) for cell in row] for row in rows]
    sides = ["---:" if all(_numeric(row[k]) for row in rows) and rows else "---" for k in range(len(head))]
    return "\n".join("| " + " | ".join(row) + " |" for row in [list(head), sides, *rows]) + "\n"


def _numeric(cell: str) -> bool:
    return not cell or cell[0].isdigit() or cell in {"-", "not installed"}


def machine() -> str:
    """Give processors, their kind, memory and the load of other work at this moment."""
    kind = next(
        (line.split(":", 1)[1].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")),
        "processor of unknown kind",
    )
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    load = os.getloadavg()[0]
    return (
        f"{os.cpu_count()} processors ({kind}), {memory:.0f} GB of memory, "
        f"load average {load:.1f} at the start, {date.today().isoformat()}"
    )


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
