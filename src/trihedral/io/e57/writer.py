"""Writing E57 files: new ones, and copies with other poses."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.atomic import creating
from trihedral.errors import InputError
from trihedral.io.e57.contents import contents, core_errors
from trihedral.io.e57.pictures import E57_FROM_CAMERA, projection_of
from trihedral.io.e57.poses import check_motion, motion_of
from trihedral.scan import Photo

Precision = Literal["auto", "single", "double", "scaled"]

# Step of scaled integers (metres): far below any scanner's noise, and 32 bits reach 21 km.
_STEP = 1e-5
# Beyond this (metres) a 32-bit float is coarser than 0.1 mm.
_SINGLE_REACH = 1000.0


@dataclass(frozen=True)
class E57Scan:
    """One scan to write.

    Attributes
    ----------
    name
        Shown to people.
    xyz
        (N, 3) float32 or float64, metres, station coordinates.
    pose
        project_from_station (4x4), or None.
    intensity
        (N,) float32 from 0 to 1, or None.
    color
        (N, 3) uint8, or None.
    colored
        (N,) bool: points that have a colour; None for all of them.
    row, column
        (N,) int32 grid indices from 0, both or none.
    invalid
        (N,) bool: cells of a structured scan without a return; their coordinates are not written.
    photos
        Pictures taken at this station.
    """

    name: str
    xyz: NDArray[np.float32] | NDArray[np.float64]
    pose: NDArray[np.float64] | None = None
    intensity: NDArray[np.float32] | None = None
    color: NDArray[np.uint8] | None = None
    colored: NDArray[np.bool_] | None = None
    row: NDArray[np.int32] | None = None
    column: NDArray[np.int32] | None = None
    invalid: NDArray[np.bool_] | None = None
    photos: Sequence[Photo] = ()

    def __post_init__(self) -> None:
        count = len(self.xyz)
        if self.xyz.shape != (count, 3):
            raise ValueError(f"xyz of scan {self.name!r} has the shape {self.xyz.shape}, not (N, 3)")
        shapes = dict.fromkeys(("intensity", "colored", "row", "column", "invalid"), (count,)) | {
            "color": (count, 3)
        }
        for field, shape in shapes.items():
            values = getattr(self, field)
            if values is not None and values.shape != shape:
                raise ValueError(f"{field} of scan {self.name!r} has the shape {values.shape}, not {shape}")
        if (self.row is None) != (self.column is None):
            raise ValueError(f"scan {self.name!r} has rows without columns, or columns without rows")
        for indices in (self.row, self.column):
            if indices is not None and count and int(indices.min()) < 0:
                raise ValueError(f"grid indices of scan {self.name!r} are negative")
        if self.pose is not None:
            check_motion(self.pose, f"pose of scan {self.name!r}")
        for photo in self.photos:
            if photo.station_from_camera is not None:
                check_motion(photo.station_from_camera, f"pose of photo {photo.name!r}")


def write_e57(
    path: Path | str, scans: Iterable[E57Scan], *, precision: Precision = "auto", crs: str | None = None
) -> None:
    """Write scans and their pictures into a new E57 file.

    The same scans give the same bytes: identifiers are made from the content, and no time is written.

    Parameters
    ----------
    scans
        Taken one at a time, so that one scan is in memory.
    precision
        How coordinates are stored: `single` or `double` floats, `scaled` integers of 0.01 mm, or `auto`:
        single floats where they are finer than 0.1 mm (within 1 km), else double ones.
    crs
        Coordinate reference system that the poses lead into, name or WKT.

    Raises
    ------
    OutputError
        If the file cannot be written, or something is at its place.
    ValueError
        If a valid point is not finite, or a picture's camera cannot be stored.
    """
    path = Path(path)
    with creating(path) as partial:
        writer = _core.E57Writer(partial)
        if crs is not None:
            writer.set_coordinates(crs)
        identity = hashlib.sha256()
        for index, scan in enumerate(scans):
            guid = _put_scan(writer, scan, index, precision)
            identity.update(guid.encode())
            for number, photo in enumerate(scan.photos):
                photo_guid = _put_photo(writer, photo, number, guid, scan)
                identity.update(photo_guid.encode())
        writer.finish(_guid(identity.hexdigest()))


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
    with creating(target) as partial, core_errors(source):
        _core.e57_copy_with_poses(
            source,
            partial,
            {index: np.ascontiguousarray(pose, np.float64) for index, pose in poses.items()},
            moved_images,
            crs,
        )


def _guid(digest: str) -> str:
    """Format a hash as identifiers in E57 files look."""
    digits = digest.upper()
    parts = (digits[:8], digits[8:12], digits[12:16], digits[16:20], digits[20:32])
    return "{" + "-".join(parts) + "}"


def _put_scan(writer: _core.E57Writer, scan: E57Scan, index: int, precision: Precision) -> str:
    valid = scan.xyz if scan.invalid is None else scan.xyz[~scan.invalid]
    reach = float(np.abs(valid).max(initial=0.0))
    if not np.isfinite(reach):
        raise ValueError(f"scan {scan.name!r} has valid points with NaN or infinite coordinates")
    if precision == "auto":
        precision = "single" if reach <= _SINGLE_REACH else "double"

    def flat(values: NDArray[Any] | None, kind: type[np.generic]) -> NDArray[Any] | None:
        return None if values is None else np.ascontiguousarray(values, kind).reshape(-1)

    xyz: NDArray[np.float32] | NDArray[np.float64] = (
        np.ascontiguousarray(scan.xyz, np.float32).reshape(-1)
        if precision == "single"
        else np.ascontiguousarray(scan.xyz, np.float64).reshape(-1)
    )
    arrays = {
        "intensity": flat(scan.intensity, np.float32),
        "color": flat(scan.color, np.uint8),
        "colorless": None if scan.colored is None or scan.color is None else flat(~scan.colored, np.bool_),
        "row": flat(scan.row, np.int32),
        "column": flat(scan.column, np.int32),
        "invalid": flat(scan.invalid, np.bool_),
    }
    identity = hashlib.sha256(f"{index} {scan.name}".encode())
    for values in (scan.pose, xyz, *arrays.values()):
        if values is not None:
            identity.update(np.ascontiguousarray(values).data.cast("B") if values.size else b"")
    guid = _guid(identity.hexdigest())
    writer.add_scan(
        name=scan.name,
        guid=guid,
        pose=None if scan.pose is None else np.ascontiguousarray(scan.pose, np.float64),
        xyz=xyz,
        step=_STEP if precision == "scaled" else None,
        **arrays,
    )
    return guid


def _put_photo(writer: _core.E57Writer, photo: Photo, number: int, scan_guid: str, scan: E57Scan) -> str:
    camera = photo.camera
    pose = None
    if photo.station_from_camera is not None:
        file_from_station = np.eye(4) if scan.pose is None else scan.pose
        pose = file_from_station @ photo.station_from_camera @ np.linalg.inv(E57_FROM_CAMERA[camera.kind])
    identity = hashlib.sha256(f"{scan_guid} {number} {photo.name}".encode() + photo.data)
    guid = _guid(identity.hexdigest())
    writer.add_photo(
        name=photo.name,
        guid=guid,
        scan_guid=scan_guid,
        pose=None if pose is None else np.ascontiguousarray(pose),
        png=photo.encoding == "png",
        data=photo.data,
        size=(camera.width, camera.height),
        projection=projection_of(photo),
    )
    return guid
