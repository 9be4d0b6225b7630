"""Which format a file has, told by its content."""

import os
import re
import stat
from pathlib import Path

from trihedral.errors import InputError

# Enough for a few lines of any text format, whatever the length of its comments (bytes).
_HEAD = 65536
_NUMBER = re.compile(rb"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|[+-]?nan|[+-]?inf", re.IGNORECASE)
_COMMENTS = (b"#", b"//", b"%", b"!")

FORMATS = ("e57", "ptx", "pts", "las", "laz", "ply", "pcd", "xyz", "rig")
# TOML files of ours say in their first key what they are.
_OURS = re.compile(rb"^\s*format\s*=\s*[\"']trihedral-(rig|camera)/", re.MULTILINE)


def detect(path: Path | str) -> str:
    """Tell a file's format, one of `FORMATS`, by its content; the suffix counts for nothing.

    Raises
    ------
    InputError
        If the file cannot be read, is empty, or is none of these.
    """
    path = Path(path)
    head = read_head(path)
    if not head:
        raise InputError(path, "the file is empty")
    ours = _OURS.search(head)
    if ours is not None and ours[1] == b"camera":
        raise InputError(
            path, "it is a camera file, not a scan", advice="Give it to `colorize` with --camera"
        )
    found = _binary(head) or ("rig" if ours is not None else _text(head))
    if found is None:
        raise InputError(
            path, _what_instead(head), advice=f"The formats read are {', '.join(FORMATS)}, told by content"
        )
    return found


def read_head(path: Path) -> bytes:
    """Read the first bytes of a regular file, or raise `InputError` saying why that is impossible."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise InputError(path, "it is a folder, not a file")
        if not stat.S_ISREG(mode):
            raise InputError(path, "it is not a regular file")
        with path.open("rb") as stream:
            return stream.read(_HEAD)
    except OSError as error:
        raise InputError(path, f"it cannot be read: {os.strerror(error.errno or 0).lower()}") from error


def _binary(head: bytes) -> str | None:
    """Tell the formats that begin with a mark of their own."""
    if head.startswith(b"ASTM-E57"):
        return "e57"
    if head.startswith(b"LASF"):
        # The highest bit of the point format says that the points are compressed (LASzip).
        return "laz" if len(head) > 104 and head[104] & 0x80 else "las"
    if re.match(rb"ply\s*\n", head) or head.startswith(b"ply\r"):
        return "ply"
    first = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if re.match(rb"#\s*\.PCD", first, re.IGNORECASE) or re.match(
        rb"(#[^\n]*\n\s*)*(VERSION\s+\.?\d|FIELDS\s)", first
    ):
        return "pcd"
    return None


def _fields(line: bytes) -> list[bytes]:
    """Split a row at the separator it uses, so that `1,5;2,0` keeps its decimal commas."""
    return [field for field in re.split(rb"[;\s]+" if b";" in line else rb"[,\s]+", line.strip()) if field]


def _text(head: bytes) -> str | None:
    """Rows of numbers, told apart by what the first of them look like."""
    lines = head.removeprefix(b"\xef\xbb\xbf").split(b"\n")
    if len(head) == _HEAD:
        lines = lines[:-1]
    rows = [line for line in lines if line.strip() and not line.lstrip().startswith(_COMMENTS)][:12]
    split = [_fields(row) for row in rows]
    numeric = [bool(row) and all(_NUMBER.fullmatch(field) for field in row) for row in split]
    sizes = [len(row) for row in split]
    if not rows or split[0][0] == b"body_angle_deg":
        # Nothing, or a table of a rig's profiles, which its TOML names.
        return None
    if numeric[:10] == [True] * 10 and sizes[:10] == [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]:
        return "ptx"
    if numeric[0] and sizes[0] == 1:
        return "pts" if split[0][0].isdigit() and all(size >= 3 for size in sizes[1:3]) else None
    # A header line names the columns; the rows below it are numbers.
    body = slice(0, 3) if numeric[0] else slice(1, 4)
    if rows[body] and all(numeric[body]) and all(size >= 3 for size in sizes[body]):
        return "xyz"
    return None


def _what_instead(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "it is UTF-16 text; save it as UTF-8 or ASCII"
    if b"\0" in head[:4096]:
        return "it is a binary file of no known point format"
    return "it is text, but not rows of point coordinates"
