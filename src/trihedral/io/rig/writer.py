"""Writing the files of a rig."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import creating, write_new
from trihedral.fusion.rig import Profiles, RigCamera
from trihedral.io.camera import camera_lines, matrix_text, quoted
from trihedral.io.rig.description import FORMAT

_JPEG_QUALITY = 92


def write_rig(
    path: Path | str,
    name: str,
    profiles: Sequence[Profiles],
    camera: RigCamera | None = None,
    pictures: Sequence[tuple[NDArray[np.uint8], float]] = (),
) -> None:
    """Write a rig file with its profiles and pictures beside it.

    Parameters
    ----------
    path
        The TOML; other files are named after it and written first.
    name
        Of the scan.
    profiles
        Of each line scanner.
    camera
        That took the pictures.
    pictures
        (H, W, 3) red, green, blue, and the body's angle (rad), each; written as JPEG.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    path = Path(path)
    lines = [f"format = {quoted(FORMAT)}", f"name = {quoted(name)}"]
    for one in profiles:
        lines += _write_profiles(path.with_name(f"{path.stem}-{one.scanner.name}.npz"), one)
    if camera is not None:
        lines += ["", "[[camera]]", *camera_lines(camera.name, camera.model, camera.body_from_camera)]
        for number, (image, angle) in enumerate(pictures):
            file = path.with_name(f"{path.stem}-{number:02d}.jpg")
            lines += _write_picture(file, image, camera.name, angle)
    write_new(path, ("\n".join(lines) + "\n").encode())


def _write_profiles(file: Path, one: Profiles) -> list[str]:
    """Write the profiles of a line scanner; the lines of its table."""
    arrays: dict[str, NDArray[Any]] = {
        "body_angle_deg": np.degrees(one.body_angles),
        "beam_angle_deg": np.degrees(one.beam_angles),
        "range_m": one.ranges,
    }
    if one.intensity is not None:
        arrays["intensity"] = one.intensity
    with creating(file) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]
    return [
        "",
        "[[scanner]]",
        f"name = {quoted(one.scanner.name)}",
        f"d_m = {one.scanner.d!r}",
        f"h_m = {one.scanner.h!r}",
        f"body_from_mounting = {matrix_text(one.scanner.body_from_mounting)}",
        f"profiles = {quoted(file.name)}",
    ]


def _write_picture(file: Path, image: NDArray[np.uint8], camera: str, angle: float) -> list[str]:
    """Write a picture; the lines of its table."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    _, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), quality)
    write_new(file, data.tobytes())
    return [
        "",
        "[[picture]]",
        f"file = {quoted(file.name)}",
        f"camera = {quoted(camera)}",
        f"body_angle_deg = {math.degrees(angle)!r}",
    ]
