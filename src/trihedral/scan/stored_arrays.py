"""Files of named arrays (.npz), which prepared scans are kept in."""

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays uncompressed."""
    with path.open("wb") as stream:
        np.savez(stream, **arrays)


@contextmanager
def stored_arrays(path: Path) -> Iterator[Mapping[str, NDArray[Any]]]:
    """Open what `write_arrays` wrote; what is missing in it is an error on leaving, too.

    Raises
    ------
    ValueError
        If the file is damaged or of another version.
    OSError
        If it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            yield stored
    except (KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is not a prepared scan: {error}") from error
