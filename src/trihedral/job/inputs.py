"""What a job is given: files found in folders, told apart by content, their scans named.

In: the paths a person typed. Out: files in an order that does not depend on how they were given, names.
"""

import hashlib
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from trihedral.errors import InputError
from trihedral.guarded import Stamp, open_input, stamp_of
from trihedral.io import find_inputs, parts
from trihedral.model.registration import Failure
from trihedral.output_folder import OWN_FOLDER, read_list
from trihedral.scan import ScanHeader

_HASH_BLOCK = 1 << 20
# Scans taken one after the other differ in most of these places, though their headers may not.
_SAMPLES, _SAMPLE_BYTES = 8, 4096


@dataclass(frozen=True)
class SourceFile:
    """A file of the job as it was when the job began."""

    path: Path  # as the user gave it, or below the folder that he gave
    stamp: Stamp
    #: The other files that hold its scan's content, a rig's profiles and pictures.
    parts: tuple["SourceFile", ...] = ()

    @classmethod
    def of(cls, path: Path) -> "SourceFile":
        """Take the state of a file and of all that belongs to it.

        Raises
        ------
        InputError
            It is not there, not a file, or may not be read.
        """
        stamp = stamp_of(path)
        found = []
        # A part that is not there, or cannot be named, is refused by reading.
        with suppress(InputError):
            for part in parts(path):
                with suppress(InputError):
                    found.append(cls(part, stamp_of(part)))
        return cls(path, stamp, tuple(found))

    @property
    def bytes(self) -> int:
        """Of the file itself."""
        return self.stamp.bytes

    @property
    def state(self) -> str:
        """Name the state of the file and all its parts."""
        return repr([self.stamp, *((part.path.name, part.stamp) for part in self.parts)])

    def sampled_hash(self) -> str:
        """Hash a few places of the content; empty where it cannot be read."""
        digest = hashlib.sha256()
        try:
            with open_input(self.path) as file:
                for k in range(_SAMPLES):
                    file.seek(k * self.bytes // _SAMPLES)
                    digest.update(file.read(_SAMPLE_BYTES))
        except InputError:
            return ""
        return digest.hexdigest()

    def sha256(self) -> str:
        """Hash the content, hexadecimal; of a rig file also that of the profiles and pictures that it names.

        Raises
        ------
        InputError
            It cannot be read, or has changed since the job began.
        """
        digest = hashlib.sha256()
        for one in (self, *self.parts):
            with open_input(one.path) as file:
                while block := file.read(_HASH_BLOCK):
                    digest.update(block)
        self.check_unchanged()
        return digest.hexdigest()

    def check_unchanged(self) -> None:
        """Raise `InputError` unless the file and its parts are still as they were when the job began."""
        now = SourceFile.of(self.path)
        if now == self:
            return
        changed = (
            [part.path for part in self.parts if part not in now.parts] if now.stamp == self.stamp else []
        )
        raise InputError(
            changed[0] if changed else self.path,
            "it changed while it was read",
            advice="Run again when it is complete",
        )


def maybe_equal(files: Sequence[SourceFile]) -> set[SourceFile]:
    """Those that may hold what another one of them holds: of the same size, and alike in a few places."""
    alike: dict[object, list[SourceFile]] = {}
    for file in files:
        alike.setdefault(file.bytes, []).append(file)
    for same_size in list(alike.values()):
        if len(same_size) > 1:
            for file in same_size:
                alike.setdefault((file.bytes, file.sampled_hash()), []).append(file)
            alike[same_size[0].bytes] = []
    return {file for group in alike.values() if len(group) > 1 for file in group}


def find_files(
    paths: Iterable[Path | str], aside: Iterable[Path | str] = ()
) -> tuple[list[SourceFile], list[Failure]]:
    """Find the files that the paths stand for, each once, in natural order, and those that cannot be read.

    What the program has written into folders of its own is left out, and so is what lies `aside`.
    """
    others = {Path(path).resolve() for path in aside}
    found: dict[Path, Path] = {}
    failures = []
    for path in sorted({Path(path) for path in paths}, key=lambda p: natural(str(p))):
        try:
            for file in find_inputs([path]):
                given = file.parent == path or file.name not in read_list(file.parent / OWN_FOLDER)
                if given and file.resolve() not in others:
                    found.setdefault(file.resolve(), file)
        except InputError as error:
            failures.append(failure_of(path, error))
    files = []
    for path in sorted(found.values(), key=lambda p: natural(str(p))):
        try:
            files.append(SourceFile.of(path))
        except InputError as error:
            failures.append(failure_of(path, error))
    return files, failures


def failure_of(
    path: Path, error: InputError, scan: ScanHeader | None = None, *, alone: bool = False
) -> Failure:
    """Turn the error into a failure, which names the file itself; its reason names another file that is at fault.

    It names the scan too, but for one that is alone in its file.
    """
    where = [error.place] if error.place and (scan is None or error.place != scan.place) else []
    if error.path != path:
        where.insert(0, error.path.name if error.path.parent == path.parent else str(error.path))
    reason = f"{', '.join(where)}: {error.reason}" if where else error.reason
    index = None if scan is None or alone else scan.scan_index
    return Failure(str(path), index, f"{reason}. {error.advice}" if error.advice else reason)


def failure_line(failure: Failure) -> str:
    """Say a failure in one line."""
    scan = "" if failure.scan_index is None else f", scan {failure.scan_index + 1}"
    return f"{failure.path}{scan}: {failure.reason}"


def natural(text: str) -> list[tuple[int, str]]:
    """Sorting key that puts "s2" before "s10"."""
    return [_digits(part) if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", text)]


def _digits(text: str) -> tuple[int, str]:
    """Order numbers of any length, in any script: the longer is the larger."""
    plain = "".join(str(unicodedata.decimal(digit)) for digit in text).lstrip("0")
    return len(plain), plain


def unique_names(headers: Sequence[ScanHeader], contents: Sequence[str]) -> list[str]:
    """Give each scan a name of its own: its file's stem, and its own name too where the file has several.

    Where two would be the same, the file's suffix tells them apart, then its folders, then the order of
    `contents`, a hash of each.
    """
    in_file = Counter(header.source for header in headers)

    def scan_part(header: ScanHeader) -> str:
        if in_file[header.source] == 1:
            return ""
        return f"/{header.name}" if header.name != header.source.stem else f"/{header.scan_index + 1}"

    def below(depth: int) -> Callable[[ScanHeader], str]:
        return lambda header: "/".join(header.source.absolute().parts[-depth:]) + scan_part(header)

    ways: list[Callable[[ScanHeader], str]] = [
        lambda header: header.source.stem + scan_part(header),
        lambda header: (
            f"{header.source.stem}/{header.scan_index + 1}" if scan_part(header) else header.source.stem
        ),
        *(below(depth) for depth in range(1, 6)),
    ]
    names = [ways[0](header) for header in headers]
    for way in ways[1:]:
        count = Counter(names)
        names = [
            way(header) if count[name] > 1 else name for header, name in zip(headers, names, strict=True)
        ]
    taken: set[str] = set()
    count = Counter(names)
    for place in sorted(range(len(names)), key=lambda k: (count[names[k]], contents[k])):
        name, copy = names[place], 1
        while names[place] in taken:
            copy += 1
            names[place] = f"{name} ({copy})"
        taken.add(names[place])
    return names
