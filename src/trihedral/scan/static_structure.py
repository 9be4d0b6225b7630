"""Static structure: surfels of planar patches that no vehicle or furniture has."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from trihedral.scan.patches import Patches
from trihedral.scan.surfels import FACES_DOWN, Surfels, faces_down

# Square metres: planar faces of people, furniture and parked cars are smaller (docs/method/preparation.md).
STATIC_AREA = 3.0
# No vehicle on a road has a planar face of this area (m2), or this tall (m): trailers are at most 4.0 m high and 13.6 m
# long in the European Union (Directive 96/53/EC), their boxes lower.
STANDING_AREA = 40.0
STANDING_HEIGHT = 4.2
# Metres within which the top of a wall meets a ceiling, seen from one station.
CEILING_GAP = 0.5


def static_structure(surfels: Surfels, patches: Patches, up: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Tell (N,) whether a surfel is of a large patch that faces down, is higher than vehicles, or ends at a ceiling.

    `up` (3,) is what is up in the scan.
    """
    points, patch = surfels.points, surfels.patch
    ceiling = faces_down(points, surfels.normals, up)
    ceilings = KDTree(points[ceiling]) if ceiling.any() else None
    static = np.zeros(len(patches) + 1, dtype=np.bool_)
    for index in np.flatnonzero(patches.areas >= STATIC_AREA):
        on_patch = points[patch == index]
        heights = on_patch @ up
        tall = np.ptp(np.percentile(heights, [2, 98])) >= STANDING_HEIGHT
        down = patches.normals[index] @ up
        if tall or (down < FACES_DOWN and heights.mean() > 0) or patches.areas[index] >= STANDING_AREA:
            static[index] = True
        elif ceilings is not None and abs(down) < 0.5:
            top = on_patch[heights >= np.percentile(heights, 95)]
            gaps = ceilings.query(top, distance_upper_bound=CEILING_GAP)[0]
            static[index] = np.isfinite(gaps).mean() > 0.3
    return static[patch]
