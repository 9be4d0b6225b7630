"""From pixels to the 3D points that they show, one surface at a time."""

import numpy as np

from trihedral.geometry.arrays import Bool, Float64, Floating
from trihedral.scan.view import View

# Four neighbouring pixels on one surface span a parallelogram; a corner farther off than this share of its greater
# diagonal lies on another surface.
SKEW = 0.5


def lift(view: View, pixels: Floating) -> tuple[Float64, Float64]:
    """3D points that a picture shows at places between its pixels.

    A point is interpolated between the four pixels around the place where all of them show one surface. Where some
    show nothing, it is the point of the pixel itself. Places with a depth edge among the four have none.

    Parameters
    ----------
    pixels
        (N, 2) x, y; pixel centres at integers.

    Returns
    -------
    points
        (N, 3) metres, in the coordinates of `View.points`; NaN where none is known.
    footprint
        (N,) metres on the surface that one pixel shows; NaN where the point is.
    """
    x, y = np.asarray(pixels, dtype=np.float64).reshape(-1, 2).T
    height, width = view.edge.shape
    inside = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    column = np.clip(np.floor(x).astype(np.intp), 0, max(width - 2, 0))
    row = np.clip(np.floor(y).astype(np.intp), 0, max(height - 2, 0))
    right, below = np.minimum(column + 1, width - 1), np.minimum(row + 1, height - 1)
    u, v = np.clip(x - column, 0.0, 1.0), np.clip(y - row, 0.0, 1.0)
    corners = np.stack(
        [view.points[r, c] for r, c in ((row, column), (row, right), (below, column), (below, right))]
    ).astype(np.float64)
    edges = (
        view.edge[row, column] | view.edge[row, right] | view.edge[below, column] | view.edge[below, right]
    )
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])

    known = np.isfinite(corners).all(axis=2)
    diagonals = np.linalg.norm([corners[3] - corners[0], corners[2] - corners[1]], axis=2).max(axis=0)
    skew = np.linalg.norm(corners[0] - corners[1] - corners[2] + corners[3], axis=1)
    interpolated = np.einsum("kn,knj->nj", weights, corners)
    nearest = np.take_along_axis(corners, weights.argmax(axis=0)[None, :, None], axis=0)[0]
    all_known = np.logical_and.reduce(known)
    points = np.where(np.expand_dims(all_known, 1), interpolated, nearest)
    torn: Bool = np.logical_and(all_known, ~(skew <= SKEW * diagonals))
    points[torn | edges | ~inside] = np.nan

    # Two corners on one side of the four are a pixel apart.
    sides = np.linalg.norm(corners[[0, 2, 0, 1]] - corners[[1, 3, 2, 3]], axis=2)
    found = np.isfinite(sides)
    footprint = np.where(found, sides, 0.0).sum(axis=0) / np.maximum(found.sum(axis=0), 1)
    lost = ~found.any(axis=0)
    points[lost] = np.nan
    footprint[np.isnan(points).any(axis=1)] = np.nan
    return points, footprint
