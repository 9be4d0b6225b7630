"""Which format a file has, told by its content."""

import re
from pathlib import Path

from trihedral import _core
from trihedral.errors import InputError
from trihedral.guarded import blamed_on, open_input
from trihedral.io.foreign import what_it_is

# Enough for a few lines of any text format, whatever the length of its comments (bytes).
_HEAD = 65536

FORMATS = ("e57", "ptx", "pts", "las", "laz", "ply", "pcd", "xyz", "rig")
# TOML files of ours say in their first key what they are.
_OURS = re.compile(rb"^[ \t]*format[ \t]*=[ \t]*[\"']trihedral-(rig|camera)/", re.MULTILINE)


def detect(path: Path | str) -> str:
    """Tell a file's format, one of `FORMATS`, by its content; the suffix counts for nothing but a message.

    Raises
    ------
    InputError
        If the file cannot be read, is empty, or is none of these.
    """
    path = Path(path)
    with blamed_on(path, "telling what it is"):
        return _format_of(path)


def _format_of(path: Path) -> str:
    head = read_head(path)
    if not head:
        raise InputError(path, "the file is empty")
    ours = _OURS.search(head)
    if ours is not None and ours[1] == b"camera":
        raise InputError(
            path, "it is a camera file, not a scan", advice="Give it to `colorize` with --camera"
        )
    found = _binary(head) or ("rig" if ours is not None else _text(head))
    if found is None and (foreign := what_it_is(path)) is not None:
        raise InputError(path, foreign[0], advice=foreign[1])
    if found is None:
        raise InputError(
            path, _what_instead(head), advice=f"The formats read are {', '.join(FORMATS)}, told by content"
        )
    return found


def read_head(path: Path) -> bytes:
    """Read the first bytes of a regular file, or raise `InputError` saying why that is impossible."""
    with open_input(path) as stream:
        return stream.read(_HEAD)


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


def _text(head: bytes) -> str | None:
    """Rows of numbers, told apart by what the first of them look like."""
    lines = head.splitlines()
    if any(line.strip().startswith(b"body_angle_deg") for line in lines[:3]):
        # A table of a rig's profiles, which its TOML names.
        return None
    whole = head[: head.rfind(b"\n") + 1] if len(head) == _HEAD else head
    return None if b"\0" in head else _core.text_kind(whole)


def _what_instead(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "it is UTF-16 text; save it as UTF-8 or ASCII"
    if b"\0" in head[:4096]:
        return "it is a binary file of no known point format"
    return "it is text, but not rows of point coordinates"
