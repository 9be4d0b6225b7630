"""A scan as E57 takes it."""

from collections.abc import Sequence

from trihedral.fusion.texture import straightened
from trihedral.geometry.se3 import Matrix
from trihedral.io.e57 import E57Scan
from trihedral.scan import Photo, Scan


def e57_scan(name: str, scan: Scan, pose: Matrix | None, photos: Sequence[Photo]) -> E57Scan:
    """Give what is written of a scan; pictures without their lens distortion, which E57 cannot state."""
    return E57Scan(
        name=name,
        xyz=scan.xyz + scan.local_origin if scan.local_origin.any() else scan.xyz,
        pose=pose,
        intensity=scan.intensity,
        color=scan.color,
        colored=scan.colored,
        row=scan.row,
        column=scan.column,
        photos=[straightened(photo, scan) for photo in photos],
    )
