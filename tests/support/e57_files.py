"""E57 files as the independent reader has them, and what is written into them."""

from pathlib import Path

import numpy as np
import pye57

from trihedral.scan import CameraModel

STANDARD = {
    *(f"cartesian{axis}" for axis in ("X", "Y", "Z", "InvalidState")),
    *(f"spherical{name}" for name in ("Range", "Azimuth", "Elevation", "InvalidState")),
    *("intensity", "colorRed", "colorGreen", "colorBlue", "rowIndex", "columnIndex"),
}


def by_pye57(path: Path, index: int) -> dict[str, np.ndarray]:
    """The valid points as the independent reader has them: every field in float64, and xyz."""
    reader = pye57.E57(str(path))
    found = reader.get_header(index)
    names = [name for name in found.point_fields if name in STANDARD]
    fields = {name: np.zeros(found.point_count) for name in names}
    buffers = pye57.libe57.VectorSourceDestBuffer()
    for name, values in fields.items():
        buffers.append(
            pye57.libe57.SourceDestBuffer(reader.image_file, name, values, len(values), True, True)
        )
    found.points.reader(buffers).read()
    if "cartesianX" in fields:
        xyz = np.column_stack([fields[f"cartesian{axis}"] for axis in "XYZ"])
    else:
        distance, azimuth, elevation = (
            fields[f"spherical{name}"] for name in ("Range", "Azimuth", "Elevation")
        )
        flat = distance * np.cos(elevation)
        xyz = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)])
    keep = np.any(xyz != 0.0, axis=1)
    for name in ("cartesianInvalidState", "sphericalInvalidState"):
        if name in fields:
            keep &= fields[name] == 0
    return {"xyz": xyz[keep], **{name: values[keep] for name, values in fields.items()}}


def pictures_by_pye57(path: Path) -> list[bytes]:
    reader = pye57.E57(str(path))
    found = []
    for image in reader.image_file.root()["images2D"]:
        kinds = ("pinhole", "spherical", "cylindrical", "visualReference")
        [kind] = [f"{kind}Representation" for kind in kinds if image.isDefined(f"{kind}Representation")]
        blob = image[kind]["jpegImage" if image[kind].isDefined("jpegImage") else "pngImage"]
        data = np.zeros(blob.byteCount(), np.uint8)
        blob.read(data, 0, len(data))
        found.append(data.tobytes())
    return found


JPEG = b"\xff\xd8\xff" + bytes(range(256)) * 9 + b"\xff\xd9"


def rotation(rng: np.random.Generator) -> np.ndarray:
    matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return matrix * np.sign(np.linalg.det(matrix))


def motion(rng: np.random.Generator, reach: float = 100.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = rotation(rng)
    pose[:3, 3] = rng.uniform(-reach, reach, 3)
    return pose


def cameras() -> dict[str, CameraModel]:
    size = (640, 480)
    angle = (2 * np.pi / 640, np.pi / 480)
    return {
        "pinhole": CameraModel("pinhole", *size, focal=(500.0, 510.0), centre=(321.0, 238.5)),
        "spherical": CameraModel("spherical", *size, pixel_angle=angle),
        "cylindrical": CameraModel(
            "cylindrical",
            *size,
            focal=(1.0 / angle[0], 300.0),
            centre=(319.5, 240.0),
            pixel_angle=(angle[0], 1.0 / 300.0),
        ),
        "visual-reference": CameraModel("visual-reference", *size),
    }
