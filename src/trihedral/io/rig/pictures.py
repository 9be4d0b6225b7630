"""Pictures that a rig's cameras took."""

from pathlib import Path

from trihedral.errors import InputError
from trihedral.fusion.kinematics import station_from_body
from trihedral.geometry.se3 import Matrix
from trihedral.io.pictures import read_picture
from trihedral.io.rig.description import read_rig
from trihedral.scan import CameraModel, Photo


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """Read the pictures; each camera is where the body's angle put it.

    Raises
    ------
    InputError
        If one is absent, is no JPEG or PNG, or has another size than its camera is calibrated for.
    """
    return [
        loose_photo(
            picture.path,
            picture.camera.model,
            station_from_body(picture.body_angle) @ picture.camera.body_from_camera,
            picture.name,
        )
        for picture in read_rig(path).pictures
    ]


def loose_photo(
    path: Path, camera: CameraModel, station_from_camera: Matrix | None, name: str | None = None
) -> Photo:
    """Read a JPEG or PNG file as a picture of a camera.

    Raises
    ------
    InputError
        If it cannot be read, is of another format, or of another size than the camera is calibrated for.
    """
    data, size, kind = read_picture(path)
    if size != (camera.width, camera.height):
        raise InputError(
            path,
            f"the picture has {size[0]} x {size[1]} pixels, its camera is calibrated for "
            f"{camera.width} x {camera.height}",
            place="width, height",
            advice="Use the picture as it was taken, or calibrate at its size",
        )
    return Photo(name or path.stem, "jpeg" if kind == "jpeg" else "png", data, camera, station_from_camera)


def read_cameras(path: Path, scan_index: int) -> list[tuple[str, CameraModel]]:
    """Tell name and camera of each picture of `read_photos`, without reading the pictures.

    Raises
    ------
    InputError
        If the rig file is damaged.
    """
    return [(picture.name, picture.camera.model) for picture in read_rig(path).pictures]
