"""What an E57 file says of itself, read once while the file stays as it is."""

import functools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import InputError
from trihedral.guarded import Stamp, stamp_of
from trihedral.io.e57.poses import motion_of

# A camera lies no further from the scanner that it is mounted on (file's unit).
_CAMERA_REACH = 0.5
# Scans that stood closer together than this have one place (file's unit).
_SAME_PLACE = 0.1


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
    adopted
        Scan of each picture that names none of the file's, by their places in the file: the one at whose place it was
        taken, None where there is none such.
    """

    path: Path
    file: _core.E57File
    scans: list[_core.E57ScanInfo | str]
    images: list[_core.E57ImageInfo | str]
    owned: dict[str, list[tuple[int, _core.E57ImageInfo]]]
    adopted: dict[int, int | None]

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
        """Pictures that name a scan, or were adopted for it, and their places in the file."""
        scan = self.scans[scan_index]
        guid = "" if isinstance(scan, str) else _same(scan.guid)
        named = self.owned.get(guid, []) if guid else []
        return sorted(named + self._by_scan.get(scan_index, []), key=lambda found: found[0])

    @functools.cached_property
    def damaged_pictures(self) -> list[str]:
        """Say how many pictures cannot be read, and why the first one."""
        reasons = [image for image in self.images if isinstance(image, str)]
        others = f", and {len(reasons) - 1} others" if len(reasons) > 1 else ""
        return [f"a picture of the file cannot be read{others}: {reasons[0]}"] if reasons else []

    @functools.cached_property
    def _by_scan(self) -> dict[int | None, list[tuple[int, _core.E57ImageInfo]]]:
        """Adopted pictures and their places in the file, by scan."""
        known = {index: image for images in self.owned.values() for index, image in images}
        found: dict[int | None, list[tuple[int, _core.E57ImageInfo]]] = {}
        for index, owner in self.adopted.items():
            found.setdefault(owner, []).append((index, known[index]))
        return found

    def said_of_pictures(self, scan_index: int) -> list[str]:
        """Note which pictures name no scan."""
        here, nowhere = len(self._by_scan.get(scan_index, [])), len(self._by_scan.get(None, []))
        if len(self.scans) == 1 and not nowhere:
            return []
        notes = [f"{_pictures(here)} no scan: taken for this one, where it was taken"] if here else []
        return notes + ([f"{_pictures(nowhere)} no scan, and not taken at one: not used"] if nowhere else [])


def contents(path: Path) -> Contents:
    """Describe scans and pictures of a file; of one with many scans the XML section alone has megabytes."""
    return _opened(path, stamp_of(path))


@functools.lru_cache(maxsize=4)
def _opened(path: Path, _stamp: Stamp) -> Contents:
    with core_errors(path):
        file = _core.E57File(path)
    images, scans = file.images(), file.scans()
    owned: dict[str, list[tuple[int, _core.E57ImageInfo]]] = {}
    for index, image in enumerate(images):
        if not isinstance(image, str):
            owned.setdefault(_same(image.scan_guid), []).append((index, image))
    scans_named = {_same(scan.guid) for scan in scans if not isinstance(scan, str)} - {""}
    strays = [found for guid, pictures in owned.items() if guid not in scans_named for found in pictures]
    places = [np.zeros(3) if isinstance(s, str) else _place(motion_of(s.pose)[0]) for s in scans if strays]
    adopted = {index: _owner(image, scans, np.array(places)) for index, image in strays}
    return Contents(path, file, scans, images, owned, adopted)


def _pictures(count: int) -> str:
    return "a picture names" if count == 1 else f"{count} pictures name"


def _owner(
    image: _core.E57ImageInfo, scans: Sequence[_core.E57ScanInfo | str], places: NDArray[np.float64]
) -> int | None:
    """Find the scan that a picture was taken at; of a file with one scan that one, unless it names another."""
    if len(scans) == 1 and not image.scan_guid:
        return 0
    pose = motion_of(image.pose)[0]
    if pose is None or not scans:
        return None
    apart = np.linalg.norm(pose[:3, 3] - places, axis=1)
    nearest = int(apart.argmin())
    # Another scan as near leaves open whose it is.
    doubtful = (np.delete(apart, nearest) < 2.0 * apart[nearest] + _SAME_PLACE).any()
    return None if apart[nearest] > _CAMERA_REACH or doubtful or isinstance(scans[nearest], str) else nearest


def _place(pose: NDArray[np.float64] | None) -> NDArray[np.float64]:
    return np.zeros(3) if pose is None else pose[:3, 3]


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
