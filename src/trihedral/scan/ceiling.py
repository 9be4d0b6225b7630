"""Whether a scanner may have stood under a ceiling, as in rooms and storeys, which may have copies."""

import numpy as np
from numpy.typing import NDArray

from trihedral.scan.surfels import faces_down

# Share of a scan's surfels that face down: under a ceiling light is the same in every scan.
LEAST_CEILING = 0.05
# Radians above the level, and metres above the scanner, that a scan must reach to show that no ceiling is there; the
# quantile of its surfels that counts as its top.
FLAT_VIEW, LOW_VIEW = np.radians(20.0), 6.0
_TOP = 0.995


def may_be_enclosed(
    points: NDArray[np.floating], normals: NDArray[np.floating], up: NDArray[np.floating]
) -> bool:
    """Tell whether a scan has a ceiling, or its beams did not reach up to where one would be.

    Parameters
    ----------
    points, normals
        (N, 3) surfels, centred on the scanner.
    up
        (3,) unit vector.
    """
    if not len(points):
        return False
    if float(faces_down(points, normals, up).mean()) >= LEAST_CEILING:
        return True
    height = points @ up
    elevation = np.arcsin(np.clip(height / np.linalg.norm(points, axis=1), -1.0, 1.0))
    return bool(np.quantile(elevation, _TOP) < FLAT_VIEW and np.quantile(height, _TOP) < LOW_VIEW)
