"""What one station saw: points with colour and intensity, pictures, and the prepared scan made of them.

In: arrays from a reader. Out: `Scan`, `Photo`, `Prepared`. Knows no files and no other scans.
"""

from trihedral.scan.photo import CameraModel, Photo
from trihedral.scan.scan import Scan, ScanHeader

__all__ = ["CameraModel", "Photo", "Scan", "ScanHeader"]
