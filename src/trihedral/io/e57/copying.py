"""Copies of E57 files with other poses."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.atomic import replacing
from trihedral.errors import InputError
from trihedral.io.e57.contents import contents, core_errors
from trihedral.io.e57.poses import check_motion, motion_of


def copy_with_poses(
    source: Path | str,
    target: Path | str,
    poses: Mapping[int, NDArray[np.float64]],
    crs: str | None = None,
) -> None:
    """Copy an E57 file with other poses of scans, and their pictures moved along.

    Points, colours, intensities, indices, pictures and extensions stay byte for byte; of the XML section only
    the poses change. Scans that are not named keep their poses.

    Parameters
    ----------
    source
        The file; it is only read.
    target
        The copy; it appears, or is replaced, when it is complete.
    poses
        project_from_station (4x4) by the scan's place in the file; translations in the file's unit.
    crs
        Coordinate reference system that the poses lead into, name or WKT; by default what the file says stays.

    Raises
    ------
    InputError
        If the source cannot be read, is damaged anywhere, has no such scan, or is the target itself.
    OutputError
        If the copy cannot be written; what was there before is untouched.
    ValueError
        If a pose is no rigid motion.
    """
    source, target = Path(source), Path(target)
    if target.exists() and source.exists() and target.samefile(source):
        raise InputError(source, "it is the source and the target at once", advice="Name another target")
    found = contents(source)
    moved_images: dict[int, NDArray[np.float64]] = {}
    for index, pose in poses.items():
        check_motion(pose, f"pose of scan {index}")
        found.scan(index)
        old = found.pose_of(index)
        new_from_old = pose if old is None else pose @ np.linalg.inv(old)
        for place, image in found.images_of(index):
            image_pose = motion_of(image.pose)[0]
            if image_pose is not None:
                moved_images[place] = new_from_old @ image_pose
    with replacing(target) as partial, core_errors(source):
        _core.e57_copy_with_poses(
            source,
            partial,
            {index: np.ascontiguousarray(pose, np.float64) for index, pose in poses.items()},
            moved_images,
            crs,
        )
