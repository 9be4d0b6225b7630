"""A picture of which every pixel knows the 3D point that it shows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class View:
    """A picture, taken or rendered, with the inverse of its texture map.

    Attributes
    ----------
    name
        Of the picture or of the direction that was rendered; unique in its station.
    image
        (H, W) uint8, grey, or (H, W, 3) uint8, red, green, blue.
    points
        (H, W, 3) float32, metres, station coordinates minus the scan's `local_origin`: the point that the centre of the
        pixel shows; NaN where none is known.
    edge
        (H, W) whether ranges jump at the pixel, so that a point near it may be of another surface.
    """

    name: str
    image: NDArray[np.uint8]
    points: NDArray[np.float32]
    edge: NDArray[np.bool_]
