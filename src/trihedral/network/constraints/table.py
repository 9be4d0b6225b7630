"""A table of the constraints file: values with their checks."""

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from trihedral.errors import InputError
from trihedral.guarded import is_finite_number
from trihedral.network.constraints.constraints import Rows, Triple

# Sigmas beyond these (mm, arc seconds) say nothing that a measurement could, and weights overflow.
_LEAST_SIGMA, _MOST_SIGMA = 1e-6, 1e9
_SIGMA_RANGE = f"above 0, from {_LEAST_SIGMA:g} to {_MOST_SIGMA:g}"
# No coordinate lies further (file's units).
_FARTHEST = 1e12


class ConstraintTable:
    """A table of the file; every key must be asked for before `done`."""

    def __init__(self, path: Path, place: str, values: Mapping[str, Any]) -> None:
        self.path, self.place, self.values = path, place, values
        self.known: list[str] = []

    def at(self, key: str) -> str:
        """Name a key in full."""
        return f"{self.place}.{key}" if self.place else key

    def error(self, key: str, reason: str, advice: str = "") -> InputError:
        """Say what is wrong with a value."""
        return InputError(self.path, reason, place=self.at(key), advice=advice)

    def get(self, key: str) -> Any:
        """Give a value or None."""
        self.known.append(key)
        return self.values.get(key)

    def text(self, key: str, default: str | None) -> str | None:
        """Give a text that is not empty."""
        value = self.get(key)
        if value is None:
            return default
        if not isinstance(value, str) or not value.strip():
            raise self.error(key, "must be a text in quotes")
        return value

    def name(self, key: str) -> str:
        """Give a text that must be there."""
        value = self.text(key, None)
        if value is None:
            raise self.error(key, "is missing")
        return value

    def names(self, key: str) -> tuple[str, ...] | None:
        """Give a list of texts."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
            raise self.error(key, "must be a list of names in quotes")
        return tuple(value)

    def choice(self, key: str, allowed: Sequence[str], default: str) -> str:
        """Give one of a few words."""
        value = self.get(key)
        if value is None:
            return default
        if value not in allowed:
            raise self.error(key, f"must be one of {', '.join(allowed)}, not {value!r}")
        return str(value)

    def positive(self, key: str, default: float | None) -> float:
        """Give a number above zero."""
        value = self.get(key)
        if value is None and default is not None:
            return default
        if not _is_sigma(value):
            raise self.error(key, "is missing" if value is None else f"must be a number {_SIGMA_RANGE}")
        return float(value)

    def flag(self, key: str) -> bool:
        """Give true or false."""
        value = self.get(key)
        if value not in (None, True, False):
            raise self.error(key, "must be true or false")
        return bool(value)

    def triple(self, key: str) -> Triple:
        """Give three numbers."""
        value = self.get(key)
        if not isinstance(value, list) or len(value) != 3 or not all(map(_is_coordinate, value)):
            raise self.error(key, "is missing" if value is None else "must be three numbers, [x, y, z]")
        return float(value[0]), float(value[1]), float(value[2])

    def sigma(self, key: str, default: Triple) -> Triple:
        """Give one standard deviation or three, millimetres as metres; the default is in metres."""
        value = self.get(key)
        if value is None:
            return default
        values = value if isinstance(value, list) else [value] * 3
        if len(values) != 3 or not all(map(_is_sigma, values)):
            raise self.error(key, f"must be a number {_SIGMA_RANGE}, or three of them for x, y and z")
        return values[0] * 1e-3, values[1] * 1e-3, values[2] * 1e-3

    def pose(self, key: str) -> Rows | None:
        """Give a rigid motion."""
        value = self.get(key)
        return None if value is None else rigid_motion(self.path, self.at(key), value)

    def table(self, key: str) -> "ConstraintTable | None":
        """Give a table inside it."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, dict):
            raise self.error(key, f"must be a table, [{self.at(key)}]")
        return ConstraintTable(self.path, self.at(key), value)

    def tables(self, key: str) -> list["ConstraintTable"]:
        """Give a list of tables; a single one counts as a list of it."""
        value = self.get(key)
        listed = [] if value is None else [value] if isinstance(value, dict) else value
        if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
            raise self.error(key, f"must be tables, [[{self.at(key)}]]")
        single = isinstance(value, dict)
        return [
            ConstraintTable(self.path, self.at(key) if single else f"{self.at(key)}[{number}]", entry)
            for number, entry in enumerate(listed, start=1)
        ]

    def done(self) -> None:
        """Refuse keys that mean nothing."""
        for key in self.values:
            if key not in self.known:
                near = difflib.get_close_matches(key, self.known, 1)
                known = f"Known here: {', '.join(self.known)}"
                raise self.error(key, "means nothing here", f"Is it {near[0]}?" if near else known)


def _is_sigma(value: Any) -> bool:
    return is_finite_number(value) and _LEAST_SIGMA <= value <= _MOST_SIGMA


def _is_coordinate(value: Any) -> bool:
    return is_finite_number(value) and abs(value) <= _FARTHEST


def rigid_motion(path: Path, place: str, value: Any) -> Rows:
    """Check that a value is four rows of a rigid motion."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not (np.abs(matrix) <= _FARTHEST).all():
        raise InputError(path, "must be four rows of four numbers", place=place)
    rotation = matrix[:3, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5) or np.linalg.det(rotation) < 0:
        raise InputError(path, "is not a rotation and a translation", place=place)
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(path, "must end with the row 0, 0, 0, 1", place=place)
    # Digits that a file leaves out must not make it stretch.
    u, _, vt = np.linalg.svd(rotation)
    matrix[:3, :3] = u @ vt
    return cast(Rows, tuple(tuple(float(value) for value in row) for row in matrix))
