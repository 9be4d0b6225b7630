"""E57 (ASTM E2807): scans and pictures in, scans and pictures out.

Station coordinates are those stored in the file before its pose. Camera frames are converted between E57's
and ours (`trihedral.scan.photo`): E57's pinhole camera has x right, y up and looks along -z; its spherical
and cylindrical pictures have z up and their middle on +x, azimuth growing to the left (ASTM E2807).
"""

import dataclasses
import functools
import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.atomic import replacing
from trihedral.errors import InputError
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import fingerprint, scan_from
from trihedral.scan import CameraModel, Photo, Scan, ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT

Precision = Literal["auto", "single", "double", "scaled"]

#: Step of scaled integers (metres): far below any scanner's noise, and 32 bits reach 21 km.
_STEP = 1e-5
#: Beyond this (metres) a 32-bit float is coarser than 0.1 mm.
_SINGLE_REACH = 1000.0
#: Pixel size (metres) that written pinhole cameras claim; only its ratio to the focal length has a meaning.
_PIXEL = 5e-6
#: A rotation that is further from orthonormal than this was not meant as one.
_RIGID = 1e-6

_FIELDS = {
    *("cartesianX", "cartesianY", "cartesianZ", "cartesianInvalidState"),
    *("sphericalRange", "sphericalAzimuth", "sphericalElevation", "sphericalInvalidState"),
    *("intensity", "isIntensityInvalid", "colorRed", "colorGreen", "colorBlue", "isColorInvalid"),
    *("rowIndex", "columnIndex"),
}

_PINHOLE_FROM_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
_PANORAMA_FROM_CAMERA = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
_E57_FROM_CAMERA = {
    "pinhole": _PINHOLE_FROM_CAMERA,
    "visual-reference": _PINHOLE_FROM_CAMERA,
    "spherical": _PANORAMA_FROM_CAMERA,
    "cylindrical": _PANORAMA_FROM_CAMERA,
}


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read what an E57 file says of its scans, without its points.

    Parameters
    ----------
    path
        The file.
    options
        What the user said about the files.

    Returns
    -------
    list of ScanHeader
        In the file's order. A scan whose description is damaged has no points; a note says why.

    Raises
    ------
    InputError
        If the file is cut short, damaged, of another format or without scans.
    """
    found = _describe(path)
    if not found["scans"]:
        raise InputError(path, "it holds no scans")
    return [_header(path, found, index, options) for index in range(len(found["scans"]))]


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the valid points of one scan.

    Raises
    ------
    InputError
        If the scan is cut short or damaged, or the scanner cannot have stood where the file puts it.
    """
    found = _describe(path)
    header = _header(path, found, scan_index, options)
    with _core_errors(path, header.name):
        arrays = found["file"].read_points(scan_index, METRES_PER_UNIT[header.units])
    if arrays["no_return"] and not len(arrays["xyz"]):
        raise InputError(
            path,
            f"none of its {header.points} points is a measurement: they lie at the scanner itself",
            place=header.name,
            advice="Export the scan again",
        )
    notes = list(header.notes)
    if arrays["intensity_by_extremes"]:
        notes.append("intensity scaled by its extremes: the file states no limits that hold")
    if arrays["color_by_extremes"]:
        notes.append("the file does not state the colours' depth: taken from the largest value")
    grid = header.grid
    if "row" in arrays:
        bounds = found["scans"][scan_index]["index_bounds"]
        arrays["row"], arrays["column"], grid, contradictions = _grid(arrays["row"], arrays["column"], bounds)
        notes.extend(contradictions)
    header = dataclasses.replace(header, grid=grid, notes=tuple(notes))
    return scan_from(header, arrays, dataclasses.replace(options, units=header.units))


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """Read the pictures that belong to one scan.

    Those are the ones that name the scan; a picture that names none belongs to the only scan of its file.

    Raises
    ------
    InputError
        If one of them is cut short or damaged.
    """
    found = _describe(path)
    scan = found["scans"][scan_index]
    scan_pose = _motion(scan["pose"])[0] if isinstance(scan, dict) else None
    photos = []
    for index in _photos_of(found, scan_index):
        image = found["images"][index]
        with _core_errors(path, image["name"]):
            data = found["file"].read_image(index)
        file_from_e57 = _motion(image["pose"])[0]
        station_from_camera = None
        if file_from_e57 is not None:
            station_from_file = np.linalg.inv(scan_pose) if scan_pose is not None else np.eye(4)
            station_from_camera = station_from_file @ file_from_e57 @ _E57_FROM_CAMERA[image["kind"]]
        photos.append(
            Photo(
                name=image["name"] or f"photo {index}",
                encoding="png" if image["png"] else "jpeg",
                data=data,
                camera=_camera(image),
                station_from_camera=station_from_camera,
            )
        )
    return photos


def read_cameras(path: Path, scan_index: int) -> list[tuple[str, CameraModel]]:
    """Tell the name and camera of each picture of `read_photos`, without reading the pictures.

    Raises
    ------
    InputError
        If the file is cut short or damaged.
    """
    found = _describe(path)
    images = [(index, found["images"][index]) for index in _photos_of(found, scan_index)]
    return [(image["name"] or f"photo {index}", _camera(image)) for index, image in images]


@contextmanager
def _core_errors(path: Path, part: str = "") -> Iterator[None]:
    """Turn the core's errors into ones that name the file, and the part of it that was being read."""
    try:
        yield
    except _core.FileFormatError as error:
        place, reason = error.args
        damaged = any(word in reason for word in ("cut short", "damaged", "promises"))
        raise InputError(
            path,
            reason,
            place=", ".join(filter(None, [part, place])),
            advice="Copy the file again from where it came, or export it again" if damaged else "",
        ) from error


def _describe(path: Path) -> dict[str, Any]:
    """Describe scans and pictures of a file; of one with many scans the XML section alone has megabytes."""
    return _opened(path, fingerprint(path))


@functools.lru_cache(maxsize=4)
def _opened(path: Path, stamp: tuple[int, int]) -> dict[str, Any]:
    """Open a file: `file` reads its parts, `owned` has the places of its pictures by the scan that they name."""
    with _core_errors(path):
        file = _core.E57File(path)
    found = file.describe()
    owned: dict[str, list[int]] = {}
    for index, image in enumerate(found["images"]):
        if isinstance(image, dict):
            owned.setdefault(_same(image["scan_guid"]), []).append(index)
    broken = [image for image in found["images"] if isinstance(image, str)]
    return {**found, "file": file, "owned": owned, "broken": broken}


def _same(guid: str) -> str:
    """Strip what differs between the places where programs write an identifier: case and braces."""
    return guid.strip("{}").lower()


def _header(path: Path, found: dict[str, Any], index: int, options: ReadOptions) -> ScanHeader:
    scans = found["scans"]
    if not 0 <= index < len(scans):
        raise InputError(path, f"it has {len(scans)} scans; there is no scan {index}")
    scan = scans[index]
    notes = []
    if isinstance(scan, str):
        notes.append(f"cannot be read: {scan}")
        scan = {"name": "", "points": None, "fields": [], "pose": None, "index_bounds": None, "extras": []}
    fields = scan["fields"]
    file_pose, doubts = _motion(scan["pose"])
    notes.extend(f"pose in the file: {doubt}" for doubt in doubts)
    ignored = [field for field in fields if field not in _FIELDS]
    if ignored:
        notes.append("fields not used: " + ", ".join(ignored))
    if scan["extras"]:
        notes.append("extensions not used: " + ", ".join(scan["extras"]))
    notes.extend(f"a picture of the file cannot be read: {reason}" for reason in found["broken"])
    if options.units not in (None, "m"):
        notes.append(f"E57 is in metres; {options.units} was asked for")
    units = options.units or "m"
    if file_pose is not None:
        file_pose[:3, 3] *= METRES_PER_UNIT[units]
    structured = {"rowIndex", "columnIndex"} <= set(fields)
    origin = options.scanner_origin if options.scanner_origin is not None else (0.0, 0.0, 0.0)
    return ScanHeader(
        source=path,
        scan_index=index,
        name=scan["name"] or (path.stem if len(scans) == 1 else f"{path.stem}-{index}"),
        format="e57",
        points=scan["points"],
        grid=_grid_size(scan["index_bounds"]) if structured else None,
        has_color={"colorRed", "colorGreen", "colorBlue"} <= set(fields),
        has_intensity="intensity" in fields,
        photos=len(_photos_of(found, index)),
        file_pose=file_pose,
        scanner_origin=np.array(origin, dtype=np.float64),
        origin_stated=True,
        units=units,
        units_stated=True,
        notes=tuple(notes),
    )


def _grid_size(bounds: Sequence[int] | None) -> tuple[int, int] | None:
    """Rows and columns by the bounds of the indices; None where they say nothing."""
    if bounds is None:
        return None
    rows, columns = bounds[1] - bounds[0] + 1, bounds[3] - bounds[2] + 1
    return (rows, columns) if rows > 1 and columns > 1 else None


def _grid(
    row: NDArray[np.int32], column: NDArray[np.int32], bounds: Sequence[int] | None
) -> tuple[NDArray[np.int32], NDArray[np.int32], tuple[int, int] | None, list[str]]:
    """Count rows and columns from zero; where the bounds do not hold, the points' indices do."""
    if not len(row):
        return row, column, _grid_size(bounds), []
    actual = (int(row.min()), int(row.max()), int(column.min()), int(column.max()))
    holds = bounds is not None and (
        bounds[0] <= actual[0]
        and actual[1] <= bounds[1]
        and bounds[2] <= actual[2]
        and actual[3] <= bounds[3]
    )
    if bounds is not None and holds:
        first_row, _, first_column, _ = bounds
        size = _grid_size(bounds)
    else:
        first_row, first_column = min(actual[0], 0), min(actual[2], 0)
        size = _grid_size((first_row, actual[1], first_column, actual[3]))
    if first_row:
        row = row - np.int32(first_row)
    if first_column:
        column = column - np.int32(first_column)
    contradicted = bounds is not None and not holds
    notes = ["grid size taken from the points: the file's bounds do not hold"] if contradicted else []
    return row, column, size, notes


def _motion(pose: dict[str, Any] | None) -> tuple[NDArray[np.float64] | None, list[str]]:
    """Build the 4x4 matrix of a stored pose, and say what is doubtful; None where it is no rigid motion."""
    if pose is None:
        return None, []
    quaternion = np.array(pose["quaternion"])
    translation = np.array(pose["translation"])
    norm = float(np.linalg.norm(quaternion))
    if not (np.isfinite(norm) and np.isfinite(translation).all()) or norm < _RIGID:
        return None, ["it is no rigid motion: left out"]
    doubts = [f"its quaternion has the norm {norm:.6g}: scaled to 1"] if abs(norm - 1.0) > _RIGID else []
    w, x, y, z = quaternion / norm
    motion = np.eye(4)
    motion[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    motion[:3, 3] = translation
    return motion, doubts


def _photos_of(found: dict[str, Any], scan_index: int) -> list[int]:
    scan = found["scans"][scan_index]
    guid = _same(scan["guid"]) if isinstance(scan, dict) else ""
    named = found["owned"].get(guid, []) if guid else []
    unnamed = found["owned"].get("", []) if len(found["scans"]) == 1 else []
    return sorted(named + unnamed)


def _camera(image: dict[str, Any]) -> CameraModel:
    """Translate an E57 representation: metres on the sensor become pixels."""
    kind, model = image["kind"], image["model"]
    width, height = image["width"], image["height"]
    pixel = (model.get("pixelWidth", 0.0), model.get("pixelHeight", 0.0))
    focal = centre = pixel_angle = None
    distortion: tuple[float, ...] = ()
    if kind == "pinhole" and min(pixel) > 0.0 and model.get("focalLength", 0.0) > 0.0:
        focal = (model["focalLength"] / pixel[0], model["focalLength"] / pixel[1])
        centre = (model.get("principalPointX", 0.0), model.get("principalPointY", 0.0))
    elif kind == "spherical":
        # Some writers leave the pixel size out of full panoramas.
        pixel_angle = (pixel[0] or 2.0 * np.pi / width, pixel[1] or np.pi / height)
    elif kind == "cylindrical" and min(pixel) > 0.0 and model.get("radius", 0.0) > 0.0:
        along = model["radius"] / pixel[1]
        focal = (1.0 / pixel[0], along)
        centre = ((width - 1) / 2.0, model.get("principalPointY", 0.0))
        pixel_angle = (pixel[0], 1.0 / along)
    if kind == "pinhole" and any(name.startswith("CV_K") or name.startswith("CV_P") for name in model):
        distortion = tuple(model.get(f"CV_{name}", 0.0) for name in ("K1", "K2", "P1", "P2", "K3"))
    return CameraModel(
        kind=kind,
        width=width,
        height=height,
        focal=focal,
        centre=centre,
        distortion=distortion,
        pixel_angle=pixel_angle,
    )


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
    row: NDArray[np.int32] | None = None
    column: NDArray[np.int32] | None = None
    invalid: NDArray[np.bool_] | None = None
    photos: Sequence[Photo] = ()

    def __post_init__(self) -> None:
        count = len(self.xyz)
        if self.xyz.shape != (count, 3):
            raise ValueError(f"xyz of scan {self.name!r} has the shape {self.xyz.shape}, not (N, 3)")
        for field in ("intensity", "row", "column", "invalid"):
            values = getattr(self, field)
            if values is not None and values.shape != (count,):
                raise ValueError(
                    f"{field} of scan {self.name!r} has the shape {values.shape}, not ({count},)"
                )
        if self.color is not None and self.color.shape != (count, 3):
            raise ValueError(
                f"color of scan {self.name!r} has the shape {self.color.shape}, not ({count}, 3)"
            )
        if (self.row is None) != (self.column is None):
            raise ValueError(f"scan {self.name!r} has rows without columns, or columns without rows")
        for indices in (self.row, self.column):
            if indices is not None and count and int(indices.min()) < 0:
                raise ValueError(f"grid indices of scan {self.name!r} are negative")
        if self.pose is not None:
            _check_motion(self.pose, f"pose of scan {self.name!r}")
        for photo in self.photos:
            if photo.station_from_camera is not None:
                _check_motion(photo.station_from_camera, f"pose of photo {photo.name!r}")


def _check_motion(pose: NDArray[np.float64], what: str) -> None:
    pose = np.asarray(pose, dtype=np.float64)
    rotation = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
    rigid = (
        np.isfinite(pose).all()
        and np.abs(rotation @ rotation.T - np.eye(3)).max() < _RIGID
        and np.linalg.det(rotation) > 0.0
        and np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0])
    )
    if not rigid:
        raise ValueError(f"{what} is no rigid motion")


def write_e57(
    path: Path | str, scans: Iterable[E57Scan], *, precision: Precision = "auto", crs: str | None = None
) -> None:
    """Write scans and their pictures into a new E57 file.

    The same scans give the same bytes: identifiers are made from the content, and no time is written.

    Parameters
    ----------
    path
        The file; it appears, or is replaced, when it is complete.
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
        If the file cannot be written; what was there before is untouched.
    ValueError
        If a valid point is not finite, or a picture's camera cannot be stored.
    """
    path = Path(path)
    with replacing(path) as partial:
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
        writer.finish(_guid(identity))


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
    found = _describe(source)
    moved_images: dict[int, NDArray[np.float64]] = {}
    for index, pose in poses.items():
        _check_motion(pose, f"pose of scan {index}")
        if not 0 <= index < len(found["scans"]):
            raise InputError(source, f"it has {len(found['scans'])} scans; there is no scan {index}")
        scan = found["scans"][index]
        old = _motion(scan["pose"])[0] if isinstance(scan, dict) else None
        new_from_old = pose if old is None else pose @ np.linalg.inv(old)
        for image in _photos_of(found, index):
            image_pose = _motion(found["images"][image]["pose"])[0]
            if image_pose is not None:
                moved_images[image] = new_from_old @ image_pose
    with replacing(target) as partial, _core_errors(source):
        _core.e57_copy_with_poses(
            source,
            partial,
            [(index, np.ascontiguousarray(pose, np.float64)) for index, pose in poses.items()],
            list(moved_images.items()),
            crs,
        )


def _guid(identity: Any) -> str:
    """Format a hash as identifiers in E57 files look."""
    digits = identity.hexdigest().upper()[:32]
    return "{" + "-".join(re.fullmatch(r"(.{8})(.{4})(.{4})(.{4})(.{12})", digits).groups()) + "}"  # type: ignore[union-attr]


def _put_scan(writer: _core.E57Writer, scan: E57Scan, index: int, precision: Precision) -> str:
    valid = scan.xyz if scan.invalid is None else scan.xyz[~scan.invalid]
    reach = float(np.abs(valid).max(initial=0.0))
    if not np.isfinite(reach):
        raise ValueError(f"scan {scan.name!r} has valid points with NaN or infinite coordinates")
    if precision == "auto":
        precision = "single" if reach <= _SINGLE_REACH else "double"
    xyz: NDArray[np.float32] | NDArray[np.float64] = (
        np.ascontiguousarray(scan.xyz, np.float32).reshape(-1)
        if precision == "single"
        else np.ascontiguousarray(scan.xyz, np.float64).reshape(-1)
    )

    def flat(values: NDArray[Any] | None, kind: type[np.generic]) -> NDArray[Any] | None:
        return None if values is None else np.ascontiguousarray(values, kind).reshape(-1)

    arrays = {
        "intensity": flat(scan.intensity, np.float32),
        "color": flat(scan.color, np.uint8),
        "row": flat(scan.row, np.int32),
        "column": flat(scan.column, np.int32),
        "invalid": flat(scan.invalid, np.bool_),
    }
    identity = hashlib.sha256(f"{index} {scan.name}".encode())
    for values in (scan.pose, xyz, *arrays.values()):
        if values is not None:
            identity.update(np.ascontiguousarray(values).data.cast("B") if values.size else b"")
    guid = _guid(identity)
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
        pose = file_from_station @ photo.station_from_camera @ np.linalg.inv(_E57_FROM_CAMERA[camera.kind])
    guid = _guid(hashlib.sha256(f"{scan_guid} {number} {photo.name}".encode() + photo.data))
    writer.add_photo(
        name=photo.name,
        guid=guid,
        scan_guid=scan_guid,
        pose=None if pose is None else np.ascontiguousarray(pose),
        png=photo.encoding == "png",
        data=photo.data,
        size=(camera.width, camera.height),
        kind=camera.kind,
        model=_e57_model(photo),
    )
    return guid


def _e57_model(photo: Photo) -> list[float]:
    """Express a camera in E57's numbers, in the order that the core takes them."""
    camera = photo.camera
    if any(camera.distortion):
        raise ValueError(
            f"photo {photo.name!r} has a lens distortion, which E57 cannot state: undistort it first"
        )
    if camera.kind == "visual-reference":
        return []
    if camera.kind == "pinhole" and camera.focal is not None and camera.centre is not None:
        focal = camera.focal[0] * _PIXEL
        return [focal, _PIXEL, focal / camera.focal[1], *camera.centre]
    if camera.kind == "spherical" and camera.pixel_angle is not None:
        return list(camera.pixel_angle)
    if (
        camera.kind == "cylindrical"
        and camera.focal is not None
        and camera.centre is not None
        and camera.pixel_angle is not None
    ):
        return [1.0, camera.pixel_angle[0], 1.0 / camera.focal[1], camera.centre[1]]
    raise ValueError(f"the {camera.kind} camera of photo {photo.name!r} is not complete")
