"""A picture taken at a station, with its camera."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class CameraModel:
    """How directions become pixels.

    Camera axes are those of computer vision: x right, y down, z along the view. Pixel centres at integers.
    """

    kind: Literal["pinhole", "spherical", "cylindrical", "visual-reference"]
    width: int  # pixels
    height: int  # pixels
    focal: tuple[float, float] | None = None  # fx, fy in pixels (pinhole; cylindrical: fy)
    centre: tuple[float, float] | None = None  # cx, cy in pixels
    distortion: tuple[float, ...] = ()  # k1, k2, p1, p2, k3 (Brown)
    pixel_angle: tuple[float, float] | None = (
        None  # horizontal, vertical radians a pixel (spherical, cylindrical)
    )


@dataclass(frozen=True)
class Photo:
    """An embedded or loose picture; `data` are the encoded JPEG or PNG bytes."""

    name: str
    encoding: Literal["jpeg", "png"]
    data: bytes
    camera: CameraModel
    station_from_camera: NDArray[np.float64] | None  # 4x4; None where the file does not say
