"""Where the scanner stood in each file, from a table: TOML or rows of text."""

import csv
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from trihedral.errors import InputError
from trihedral.guarded import read_text, read_toml
from trihedral.io.options import Place

_ADVICE = 'Rows are: name of the file, x, y, z in metres; TOML is: "station 1.las" = [x, y, z]'


def read_scanner_origins(path: Path) -> tuple[tuple[str, Place], ...]:
    """Read a table of file names, with or without suffix, and positions.

    In a text, values are apart by commas, semicolons, tabs or spaces; a heading and comments (`#`) are passed over.

    Raises
    ------
    InputError
        It cannot be read, or says nothing, something twice or what is no position.
    """
    rows = _toml(path) if path.suffix.lower() == ".toml" else _text(path, read_text(path))
    found: dict[str, Place] = {}
    for place, name, values in rows:
        if name in found:
            raise InputError(path, f"{name!r} is given twice", place=place)
        found[name] = _position(path, place, values)
    if not found:
        raise InputError(path, "it holds no positions of scanners", advice=_ADVICE)
    return tuple(found.items())


def _toml(path: Path) -> list[tuple[str, str, Any]]:
    return [(f"key {name!r}", name, values) for name, values in read_toml(path).items()]


def _text(path: Path, text: str) -> Iterable[tuple[str, str, list[str]]]:
    lines = [(k, line.strip()) for k, line in enumerate(text.splitlines(), 1)]
    lines = [(k, line) for k, line in lines if line and not line.startswith("#")]
    mark = next((m for m in (";", "\t", ",") if lines and all(m in line for _, line in lines)), " ")
    rows: list[tuple[str, str, list[str]]] = []
    for number, line in lines:
        cells = next(csv.reader([line], delimiter=mark, skipinitialspace=True))
        if len(cells) < 4:
            raise InputError(
                path, "a name and three numbers are expected", place=f"line {number}", advice=_ADVICE
            )
        # A name may hold spaces.
        name, values = mark.join(cells[:-3]).strip(), [cell.strip() for cell in cells[-3:]]
        if mark == ";":
            values = [value.replace(",", ".") for value in values]
        if not rows and not any(_is_number(value) for value in values):
            continue
        rows.append((f"line {number}", name, values))
    return rows


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _position(path: Path, place: str, values: Any) -> Place:
    try:
        x, y, z = (float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            path, f"{str(values)[:80]!r} is not three numbers", place=place, advice=_ADVICE
        ) from None
    if not all(math.isfinite(value) for value in (x, y, z)):
        raise InputError(path, f"{values!r} is not three finite numbers", place=place)
    return x, y, z
