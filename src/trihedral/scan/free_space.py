"""Space that a station saw to be empty."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class FreeSpace:
    """How far a station saw in each direction.

    Attributes
    ----------
    nearest, farthest
        (C,) extremes of range (m) per cell of a spherical grid, rows from the nadir; 0 where nothing was seen.
    """

    nearest: NDArray[np.float32]
    farthest: NDArray[np.float32]
