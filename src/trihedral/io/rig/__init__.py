"""The raw data of a rotating rig: a TOML that names profiles and pictures; docs/rig.md.

Points are made from ranges and angles by Eq. (1) of Kim, Chen and Cho (2017).
"""

from trihedral.io.rig.description import parts
from trihedral.io.rig.reading import loose_photo, read_cameras, read_headers, read_photos, read_scan
from trihedral.io.rig.writer import write_rig

__all__ = ["loose_photo", "parts", "read_cameras", "read_headers", "read_photos", "read_scan", "write_rig"]
