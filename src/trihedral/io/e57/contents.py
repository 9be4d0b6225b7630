"""What an E57 file says of itself, read once while the file stays as it is."""

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import InputError
from trihedral.io.e57.poses import motion_of
from trihedral.io.scan_builder import file_stamp


@dataclass(frozen=True)
class Contents:
    """An open file with its scans and pictures; where a description is damaged, a text says why.

    Attributes
    ----------
    file
        Reads points and pictures.
    scans, images
        In the file's order.
    owned
        Pictures and their places in the file, by the scan that they name.
    """

    path: Path
    file: _core.E57File
    scans: list[_core.E57ScanInfo | str]
    images: list[_core.E57ImageInfo | str]
    owned: dict[str, list[tuple[int, _core.E57ImageInfo]]]

    def scan(self, index: int) -> _core.E57ScanInfo | str:
        """Take a scan that must be there."""
        if not 0 <= index < len(self.scans):
            raise InputError(self.path, f"it has {len(self.scans)} scans; there is no scan {index}")
        return self.scans[index]

    def pose_of(self, scan_index: int) -> NDArray[np.float64] | None:
        """Pose of a scan (4x4), in the file's unit; None where it has none."""
        scan = self.scans[scan_index]
        return None if isinstance(scan, str) else motion_of(scan.pose)[0]

    def images_of(self, scan_index: int) -> list[tuple[int, _core.E57ImageInfo]]:
        """Pictures that name a scan, or none in a file of one scan, and their places in the file."""
        scan = self.scans[scan_index]
        guid = "" if isinstance(scan, str) else _same(scan.guid)
        named = self.owned.get(guid, []) if guid else []
        unnamed = self.owned.get("", []) if len(self.scans) == 1 else []
        return sorted(named + unnamed, key=lambda found: found[0])


def contents(path: Path) -> Contents:
    """Describe scans and pictures of a file; of one with many scans the XML section alone has megabytes."""
    return _opened(path, file_stamp(path))


@functools.lru_cache(maxsize=4)
def _opened(path: Path, stamp: tuple[int, int]) -> Contents:
    with core_errors(path):
        file = _core.E57File(path)
    images = file.images()
    owned: dict[str, list[tuple[int, _core.E57ImageInfo]]] = {}
    for index, image in enumerate(images):
        if not isinstance(image, str):
            owned.setdefault(_same(image.scan_guid), []).append((index, image))
    return Contents(path, file, file.scans(), images, owned)


@contextmanager
def core_errors(path: Path, part: str = "") -> Iterator[None]:
    """Turn the core's errors into ones that name the file, and the part of it that was being read."""
    try:
        yield
    except _core.FileFormatError as error:
        place, reason = error.args
        damaged = any(word in reason for word in ("cut short", "damaged", "promises"))
        raise InputError(
            path,
            reason,
            place=", ".join(filter(None, [part, place])),
            advice="Copy the file again from where it came, or export it again" if damaged else "",
        ) from error


def _same(guid: str) -> str:
    """Strip what differs between the places where programs write an identifier: case and braces."""
    return guid.strip("{}").lower()
