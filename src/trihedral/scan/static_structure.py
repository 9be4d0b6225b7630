"""Which elements are of the building: of planar patches that no vehicle or furniture has."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from trihedral.scan.prepared import LOOKS_DOWN, Prepared

# Square metres: planar faces of people, furniture and parked cars are smaller (docs/method.md).
SOLID_AREA = 3.0
# No vehicle on a road has a planar face of this area (m2), or this tall (m): trailers are at most 4.0 m high and 13.6 m
# long in the European Union (Directive 96/53/EC), their boxes lower.
STANDING_AREA = 40.0
STANDING_HEIGHT = 4.2
# Metres within which the top of a wall meets a ceiling, seen from one station.
CEILING_GAP = 0.5


def solid_elements(prepared: Prepared) -> NDArray[np.bool_]:
    """Tell (N,) whether each is of a large patch that looks down, is higher than vehicles are, or ends at a ceiling."""
    faces_down = prepared.normals[:, 2] < LOOKS_DOWN
    ceilings = KDTree(prepared.points[faces_down]) if faces_down.any() else None
    solid = np.zeros(len(prepared.patch_areas) + 1, dtype=np.bool_)
    for index in np.flatnonzero(prepared.patch_areas >= SOLID_AREA):
        points = prepared.points[prepared.patch == index]
        heights = points[:, 2]
        tall = np.ptp(np.percentile(heights, [2, 98])) >= STANDING_HEIGHT
        down = prepared.patch_normals[index, 2]
        if tall or down < LOOKS_DOWN or prepared.patch_areas[index] >= STANDING_AREA:
            solid[index] = True
        elif ceilings is not None and abs(down) < 0.5:
            top = points[heights >= np.percentile(heights, 95)]
            gaps = ceilings.query(top, distance_upper_bound=CEILING_GAP)[0]
            solid[index] = np.isfinite(gaps).mean() > 0.3
    return solid[prepared.patch]
