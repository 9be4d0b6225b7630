"""Point files: one file or folder a format; `readers` looks up which.

In: paths and `ReadOptions`. Out: `ScanHeader`, `Scan`, `Photo`; files written in the other direction. Raises
`InputError` for every file that cannot be used as it is.
"""

from trihedral.io.detect import FORMATS, detect
from trihedral.io.options import ReadOptions
from trihedral.io.readers import find_inputs, parts, read_cameras, read_headers, read_photos, read_scan

__all__ = [
    "FORMATS",
    "ReadOptions",
    "detect",
    "find_inputs",
    "parts",
    "read_cameras",
    "read_headers",
    "read_photos",
    "read_scan",
]
