"""Files of named arrays (.npz), which prepared scans are kept in."""

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from trihedral.parallel import ARRAY_HEADERS

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Arrays = Mapping[str, NDArray[Any]]
P = TypeVar("P", bound="DataclassInstance")


class StoredFeatures(Protocol):
    """What a source of features keeps with a prepared scan."""

    def arrays(self) -> Arrays:
        """All of it, by names of its own."""

    @classmethod
    def from_arrays(cls, stored: Arrays) -> Self:
        """Undo `arrays`."""


def arrays_of(part: "DataclassInstance") -> Arrays:
    """Every field as an array, by its name."""
    return {field.name: np.asarray(getattr(part, field.name)) for field in fields(part)}


def part_of(kind: type[P], stored: Arrays) -> P:
    """Undo `arrays_of`; more arrays than the fields' do not matter."""
    values = {field.name: stored[field.name] for field in fields(kind)}
    return kind(**{name: value.item() if value.ndim == 0 else value for name, value in values.items()})


def with_prefix(prefix: str, arrays: Arrays) -> Arrays:
    """The same by names with a prefix and a dot before them."""
    return {f"{prefix}.{name}": values for name, values in arrays.items()}


def without_prefix(prefix: str, stored: Arrays) -> Arrays:
    """Undo `with_prefix`, other arrays left out."""
    start = f"{prefix}."
    return {name.removeprefix(start): stored[name] for name in stored if name.startswith(start)}


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays uncompressed."""
    with path.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **arrays)


@contextmanager
def stored_arrays(path: Path) -> Iterator[Arrays]:
    """Open what `write_arrays` wrote; what is missing in it is an error on leaving, too.

    Raises
    ------
    ValueError
        If the file is damaged or of another version.
    OSError
        If it cannot be read.
    """
    try:
        with ARRAY_HEADERS, np.load(path, allow_pickle=False) as stored:
            yield stored
    except (KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is not a prepared scan: {error}") from error
