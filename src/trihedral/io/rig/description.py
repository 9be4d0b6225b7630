"""The TOML of a rig: its scanners, cameras and pictures, and the files that it names."""

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from trihedral.errors import InputError
from trihedral.fusion.rig import LineScanner, RigCamera
from trihedral.geometry.se3 import Matrix, motion
from trihedral.io.camera import Table, camera_model, camera_place, read_camera, read_toml

FORMAT = "trihedral-rig/1"


@dataclass(frozen=True)
class RigLine:
    """A line scanner and where its profiles are."""

    scanner: LineScanner
    profiles: Path
    table: Table


@dataclass(frozen=True)
class RigPicture:
    """A picture, its camera and the body's angle (rad) when it was taken."""

    path: Path
    camera: RigCamera
    body_angle: float
    name: str


@dataclass(frozen=True)
class RigFile:
    """What a rig file says."""

    name: str
    lines: list[RigLine]
    pictures: list[RigPicture]
    project_from_station: Matrix | None


def parts(path: Path) -> list[Path]:
    """Name the files whose content belongs to the scan, beside the rig file itself."""
    table = read_toml(path, FORMAT)
    named = [line.text("profiles", "file of the profiles") for line in table.tables("scanner")]
    named += [camera.text("file", "a camera file") for camera in table.tables("camera") if "file" in camera]
    named += [picture.text("file", "a JPEG or PNG file") for picture in table.tables("picture")]
    return [path.parent / name for name in dict.fromkeys(named)]


def read_rig(path: Path) -> RigFile:
    """Read a rig file and its camera files; `InputError` if a field is missing or makes no sense."""
    table = read_toml(path, FORMAT)
    lines = [_line(path, one) for one in table.tables("scanner")]
    if not lines:
        raise table.error("scanner", "it is missing: at least one [[scanner]] with its profiles")
    cameras: dict[str, RigCamera] = {}
    for one in table.tables("camera"):
        camera = _camera(path, one)
        if camera.name in cameras:
            raise one.error("name", f"there are two cameras {camera.name!r}")
        cameras[camera.name] = camera
    pictures = [_picture(path, one, cameras) for one in table.tables("picture")]
    return RigFile(
        name=table.text("name", "the scan's name") if "name" in table else path.stem,
        lines=lines,
        pictures=pictures,
        project_from_station=table.motion("project_from_station")
        if "project_from_station" in table
        else None,
    )


def _line(path: Path, table: Table) -> RigLine:
    mounting = np.eye(4)
    if "body_from_mounting" in table:
        mounting = table.motion("body_from_mounting")
    elif "mounting" in table:
        inner = table.table("mounting")
        turn = inner.numbers("turn_deg", 3, "turns about x, y and z") if "turn_deg" in inner else (0.0,) * 3
        shift = inner.numbers("shift_m", 3, "shift, metres") if "shift_m" in inner else (0.0,) * 3
        x, y, z = np.radians(turn)
        rotation = cv2.Rodrigues(np.array([0.0, 0.0, z]))[0]
        rotation = (
            rotation @ cv2.Rodrigues(np.array([0.0, y, 0.0]))[0] @ cv2.Rodrigues(np.array([x, 0.0, 0.0]))[0]
        )
        mounting = motion(rotation, np.array(shift))
    scanner = LineScanner(
        name=table.text("name", "the scanner's name") if "name" in table else "",
        d=table.number("d_m", "distance of the scanner's centre from the axis, metres"),
        h=table.number("h_m", "height of the scanner's centre, metres"),
        body_from_mounting=mounting,
    )
    return RigLine(scanner, path.parent / table.text("profiles", "file of its profiles"), table)


def _camera(path: Path, table: Table) -> RigCamera:
    name = table.text("name", "the name that pictures call it by")
    if "file" in table:
        file = path.parent / table.text("file", "a camera file")
        found = read_camera(file)
        model, place = found.model, camera_place(table)
        place = found.body_from_camera if place is None else place
    else:
        file, model, place = path, camera_model(table), camera_place(table)
    if place is None:
        raise InputError(
            file,
            "it is missing: where the camera sits on the body",
            place="body_from_camera" if file != path else f"{table.place}body_from_camera",
            advice="Give body_from_camera, or a table mounting with position_m and heading_deg",
        )
    return RigCamera(name, model, place)


def _picture(path: Path, table: Table, cameras: dict[str, RigCamera]) -> RigPicture:
    file = table.text("file", "a JPEG or PNG file")
    if "camera" in table or len(cameras) != 1:
        name = table.text("camera", "name of the [[camera]] that took it")
    else:
        name = next(iter(cameras))
    if name not in cameras:
        known = ", ".join(cameras) or "none"
        raise table.error("camera", f"there is no camera {name!r}; the file describes {known}")
    angle = table.number("body_angle_deg", "angle of the body when it was taken")
    return RigPicture(path.parent / file, cameras[name], math.radians(angle), Path(file).stem)
