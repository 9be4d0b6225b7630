"""Names of files that are written side by side."""

import os
import re

# Names are cut to so many bytes, the suffix apart: file systems take no more than 255, and some add to them.
_LONGEST = 120
# Devices of Windows, whatever follows after a dot.
_DEVICES = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³])(?=\.|$)", re.IGNORECASE)


def file_name(name: str, suffix: str, taken: set[str]) -> str:
    """Make of a scan's name a file's that every system takes, no command takes for an option, and no other has.

    Parameters
    ----------
    taken
        Names that are taken, whatever the case; this one is added.
    """
    safe = re.sub(r"[^\w.()+ -]+", "_", name).strip(" .")
    if safe.startswith("-") or _DEVICES.match(safe):
        safe = f"_{safe}"
    stem = distinct(_cut(safe, _LONGEST) or "scan", taken)
    # Bytes of UTF-8 on the disk, whatever the locale.
    return os.fsdecode(f"{stem}.{suffix}".encode())


def distinct(stem: str, taken: set[str]) -> str:
    """Number a name that is taken already, whatever the case, and add it to those that are."""
    name, number = stem, 1
    while name.casefold() in taken:
        number += 1
        name = f"{stem}-{number}"
    taken.add(name.casefold())
    return name


def _cut(text: str, most: int) -> str:
    """Cut to so many bytes of UTF-8, between characters."""
    return text.encode()[:most].decode(errors="ignore").strip(" .")
