"""What surfaces look like less the light on them, which changes from scan to scan."""

import numpy as np
from numpy.typing import NDArray

from trihedral.scan.prepared import Prepared

Float32 = NDArray[np.float32]

# Elements of a patch, below which its shading says nothing.
LEAST_ON_PATCH = 30
# Metres: surface that no patch has is compared with what is about it within this.
TILE = 1.5


def less_shading(prepared: Prepared, grey: NDArray[np.floating]) -> Float32:
    """Take from (N,) values of the elements their linear trend over the patch, or the tile where there is none.

    Returns
    -------
    (N,)
        NaN where the value is, and where too few elements are together.
    """
    texture = np.full(len(prepared.points), np.nan, dtype=np.float32)
    for together in [*prepared.on_patch(), *_on_tiles(prepared)]:
        index = together[np.isfinite(grey[together])]
        if len(index) < LEAST_ON_PATCH:
            continue
        points = prepared.points[index].astype(np.float64)
        ranges = np.linalg.norm(points, axis=1)
        trend = np.column_stack([np.ones(len(index)), points - points.mean(axis=0), ranges])
        shading = trend @ np.linalg.lstsq(trend, grey[index])[0]
        texture[index] = grey[index] - shading
    return texture


def _on_tiles(prepared: Prepared) -> list[NDArray[np.intp]]:
    """Elements of thinly seen planes, which no patch has, by pieces of space and the axis that they face."""
    off = np.flatnonzero((prepared.patch < 0) & prepared.planar)
    if not len(off):
        return []
    axis = np.abs(prepared.normals[off]).argmax(axis=1)
    backwards = prepared.normals[off, axis] < 0
    tile = np.column_stack([np.floor(prepared.points[off] / TILE).astype(np.int64), axis, backwards])
    _, number = np.unique(tile, axis=0, return_inverse=True)
    number = number.ravel()
    order = np.argsort(number, kind="stable")
    return np.split(off[order], np.flatnonzero(np.diff(number[order])) + 1)
