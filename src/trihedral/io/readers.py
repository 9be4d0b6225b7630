"""Reading any format: find files, tell what they are, look up who reads headers, points and pictures."""

import importlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Protocol, cast

from trihedral.errors import InputError
from trihedral.guarded import blamed_on
from trihedral.io import rig
from trihedral.io.detect import FORMATS, detect, read_head
from trihedral.io.foreign import said_of, what_it_is
from trihedral.io.options import ReadOptions
from trihedral.io.scanner_place import placed
from trihedral.scan import CameraModel, Photo, Scan, ScanHeader

# Suffixes that promise a scan: such a file in a folder is taken even if it is damaged, so that it is named.
_PROMISING = {f".{kind}" for kind in FORMATS}
# Suffixes that hold points or anything else: taken from a folder where the content is points.
_POSSIBLE = {".txt", ".csv", ".asc", ".xyzrgb", ".xyzi", ".neu"}
_DEFAULTS = ReadOptions()


class Reader(Protocol):
    """The module of a format. Everything raises `InputError` for a file that is damaged or cut short."""

    def read_headers(self, path: Path, options: ReadOptions) -> Sequence[ScanHeader]:
        """Read what a file says of its scans, without their points."""

    def read_scan(self, path: Path, scan_index: int, options: ReadOptions) -> Scan:
        """Read the points."""

    def read_cameras(self, path: Path, scan_index: int) -> list[tuple[str, CameraModel]]:
        """Tell name and camera of each picture of a scan; of formats that hold pictures only, as the next."""

    def read_photos(self, path: Path, scan_index: int) -> list[Photo]:
        """Read the pictures of a scan."""


def _reader(kind: str) -> Reader:
    return cast(Reader, importlib.import_module(f"trihedral.io.{'las' if kind == 'laz' else kind}"))


def find_inputs(paths: Iterable[Path | str]) -> list[Path]:
    """Expand files and folders to the files to read.

    A file is taken as it is. Of a folder, the files in it that are scans are taken, by name; where it has
    none, those of its folders (one folder a setup is common). Hidden files are passed over.
    Files come in the order given, each once (links and repeated names resolved).

    Raises
    ------
    InputError
        If a path does not exist or cannot be read, or a folder holds no scan.
    """
    found: dict[Path, Path] = {}
    for given in paths:
        path = Path(given)
        try:
            is_folder = path.is_dir()
            members = _scans_in(path) if is_folder else [path]
            if is_folder and not members:
                below = sorted(child for child in path.iterdir() if child.is_dir() and not _hidden(child))
                members = [scan for folder in below for scan in _scans_in(folder)]
        except OSError as error:
            raise InputError(path, f"the folder cannot be read: {(error.strerror or '').lower()}") from error
        if not members:
            raise _nothing_in(path)
        if not is_folder:
            read_head(path)
        for member in members:
            found.setdefault(member.resolve(), member)
    return list(found.values())


def _nothing_in(folder: Path) -> InputError:
    """Say that a folder holds no scans, and what it holds; some makers' scans are folders themselves."""
    if (foreign := what_it_is(folder) or said_of(sorted(folder.iterdir()))) is not None:
        return InputError(folder, foreign[0], advice=foreign[1])
    return InputError(folder, "the folder holds no scans", advice=f"Formats read: {', '.join(FORMATS)}")


def _hidden(path: Path) -> bool:
    return path.name.startswith(".")


def _scans_in(folder: Path) -> list[Path]:
    return [
        path for path in sorted(folder.iterdir()) if path.is_file() and not _hidden(path) and _is_scan(path)
    ]


def _is_scan(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix in _PROMISING:
        return True
    try:
        kind = detect(path)
    except InputError:
        return False
    return kind not in ("xyz", "pts") or suffix in _POSSIBLE


def parts(path: Path | str) -> list[Path]:
    """Name the other files that hold a scan file's content; none but for a rig's profiles and pictures."""
    path = Path(path)
    with blamed_on(path):
        return rig.parts(path) if detect(path) == "rig" else []


def read_headers(path: Path | str, options: ReadOptions = _DEFAULTS) -> list[ScanHeader]:
    """Read what a file says of its scans, not its points; `InputError` if it cannot be used."""
    path = Path(path)
    with blamed_on(path):
        return list(_reader(detect(path)).read_headers(path, options))


def read_scan(header: ScanHeader, options: ReadOptions = _DEFAULTS) -> Scan:
    """Read the points of a scan, its scanner placed where they were seen from.

    Raises
    ------
    InputError
        The file is damaged, units or scanner origin must be stated, or it is no single scan.
    """
    with blamed_on(header.source):
        return placed(_reader(header.format).read_scan(header.source, header.scan_index, options), options)


def read_cameras(header: ScanHeader) -> list[tuple[str, CameraModel]]:
    """Tell name and camera of each picture of a scan without reading its pixels; `InputError` as `read_photos`."""
    with blamed_on(header.source):
        return _reader(header.format).read_cameras(header.source, header.scan_index) if header.photos else []


def read_photos(header: ScanHeader) -> list[Photo]:
    """Read the pictures that belong to one scan; `InputError` if the file is damaged."""
    with blamed_on(header.source):
        return _reader(header.format).read_photos(header.source, header.scan_index) if header.photos else []
