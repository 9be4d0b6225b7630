"""E57 (ASTM E2807): scans and pictures in, scans and pictures out.

Station coordinates are those stored in the file before its pose.
"""

from trihedral.io.e57.pictures import read_cameras, read_photos
from trihedral.io.e57.scans import read_headers, read_scan
from trihedral.io.e57.writer import E57Scan, copy_with_poses, write_e57

__all__ = [
    "E57Scan",
    "copy_with_poses",
    "read_cameras",
    "read_headers",
    "read_photos",
    "read_scan",
    "write_e57",
]
