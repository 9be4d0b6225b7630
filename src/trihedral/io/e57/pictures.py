"""Pictures of an E57 file, and cameras in its terms and in ours.

Camera frames are converted between E57's and ours (`trihedral.scan.photo`): E57's pinhole camera has x right, y up
and looks along -z; its spherical and cylindrical pictures have z up and their middle on +x, azimuth growing to the
left (ASTM E2807).
"""

from pathlib import Path

import numpy as np

from trihedral import _core
from trihedral.io.e57.contents import contents, core_errors
from trihedral.io.e57.poses import motion_of
from trihedral.scan import CameraModel, Photo

# Pixel size (metres) that written pinhole cameras claim; only its ratio to the focal length has a meaning.
_PIXEL = 5e-6

_PINHOLE_FROM_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
_PANORAMA_FROM_CAMERA = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
E57_FROM_CAMERA = {
    "pinhole": _PINHOLE_FROM_CAMERA,
    "visual-reference": _PINHOLE_FROM_CAMERA,
    "spherical": _PANORAMA_FROM_CAMERA,
    "cylindrical": _PANORAMA_FROM_CAMERA,
}


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """Read the pictures that belong to one scan.

    Those are the ones that name the scan. A picture that names none belongs to the only scan of its file, or to the one
    at whose place it was taken.
    """
    found = contents(path)
    scan_pose = found.pose_of(scan_index)
    photos = []
    for index, image in found.images_of(scan_index):
        with core_errors(path, image.name):
            data = found.file.read_image(index)
        file_from_e57 = motion_of(image.pose)[0]
        station_from_camera = None
        if file_from_e57 is not None:
            station_from_file = np.linalg.inv(scan_pose) if scan_pose is not None else np.eye(4)
            station_from_camera = station_from_file @ file_from_e57 @ E57_FROM_CAMERA[image.kind]
        photos.append(
            Photo(
                name=image.name or f"photo {index}",
                encoding="png" if image.png else "jpeg",
                data=data,
                camera=_camera(image),
                station_from_camera=station_from_camera,
            )
        )
    return photos


def read_cameras(path: Path, scan_index: int) -> list[tuple[str, CameraModel]]:
    """Tell the name and camera of each picture of `read_photos`, without reading the pictures."""
    found = contents(path).images_of(scan_index)
    return [(image.name or f"photo {index}", _camera(image)) for index, image in found]


def _camera(image: _core.E57ImageInfo) -> CameraModel:
    """Translate an E57 representation: metres on the sensor become pixels."""
    kind, model = image.kind, image.model
    width, height = image.width, image.height
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


def projection_of(photo: Photo) -> _core.E57Projection:
    """Express a camera in E57's terms."""
    camera = photo.camera
    if any(camera.distortion):
        raise ValueError(
            f"photo {photo.name!r} has a lens distortion, which E57 cannot state: undistort it first"
        )
    if camera.kind == "visual-reference":
        return _core.E57Projection.visual_reference()
    if camera.kind == "pinhole" and camera.focal is not None and camera.centre is not None:
        focal = camera.focal[0] * _PIXEL
        return _core.E57Projection.pinhole(focal, (_PIXEL, focal / camera.focal[1]), camera.centre)
    if camera.kind == "spherical" and camera.pixel_angle is not None:
        return _core.E57Projection.spherical(camera.pixel_angle)
    if (
        camera.kind == "cylindrical"
        and camera.focal is not None
        and camera.centre is not None
        and camera.pixel_angle is not None
    ):
        pixel = (camera.pixel_angle[0], 1.0 / camera.focal[1])
        return _core.E57Projection.cylindrical(1.0, pixel, camera.centre[1])
    raise ValueError(f"the {camera.kind} camera of photo {photo.name!r} is not complete")
