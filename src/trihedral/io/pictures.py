"""Picture files: JPEG and PNG, refused when damaged."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import InputError
from trihedral.fusion.pixels import decoded, picture_size
from trihedral.guarded import read_bytes

_SUFFIXES = (".jpg", ".jpeg", ".png")


def picture_files(given: Iterable[Path | str]) -> list[Path]:
    """Files as given, and in place of each folder its pictures by name; `InputError` if it holds none."""
    files: list[Path] = []
    for path in map(Path, given):
        if not path.is_dir():
            files.append(path)
            continue
        try:
            found = [file for file in sorted(path.iterdir()) if file.suffix.lower() in _SUFFIXES]
        except OSError as error:
            raise InputError(path, f"it cannot be read: {(error.strerror or '').lower()}") from error
        if not found:
            raise InputError(path, "the folder holds no JPEG or PNG pictures")
        files += found
    return files


def read_picture(path: Path) -> tuple[bytes, tuple[int, int], str]:
    """Read a JPEG or PNG file: its bytes, columns and rows, and "jpeg" or "png"; pixels are not decoded.

    Another format is an `InputError`, as is a file that cannot be read.
    """
    data = read_bytes(path)
    try:
        size, kind = picture_size(data)
    except ValueError as error:
        reason = f"it is no JPEG or PNG picture that can be read ({error})"
        raise InputError(path, reason, advice="Use JPEG or PNG") from None
    return data, size, kind


def read_grey(path: Path) -> NDArray[np.uint8]:
    """Read the brightness (H, W) of a picture; `InputError` if it cannot be read or is cut short."""
    data, _, _ = read_picture(path)
    try:
        return decoded(data, "L")
    except ValueError as error:
        raise InputError(path, f"the picture is damaged ({error})") from error
