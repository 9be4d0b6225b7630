"""Small places where surfaces that agree in shape look different: copies of a room differ by a sign or a poster."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from trihedral.geometry.arrays import Bool, Float64, Int64
from trihedral.scan.pieces import pieces
from trihedral.scan.prepared import Prepared
from trihedral.verdict.appearance import COLOR, compared_kind, meeting

# Metres: edge of the cells that are compared at the least, and of the tiles whose usual difference is of light and
# exposure; edge of a cell over the spacing of the surfels.
_CELL, _TILE, _SPACINGS = 0.25, 1.0, 3.0
# Surfels of a cell, and cells, below which nothing is said.
_LEAST_SURFELS, _LEAST_CELLS = 4, 20
# Standard deviations from which a cell differs: of its mean, and of what cells of these scans usually differ by.
_SIGNIFICANT, _USUAL = 3.0, 2.0
# Logarithm by which a cell differs at the least; share of its contrast to its tile that cameras may render otherwise.
_LEAST, _OF_CONTRAST = 0.15, 0.3
# Added to the standard deviations: a step of 8 bits. What logarithms are taken of at the least.
_STEP, _DARKEST = 0.01, 0.03


@dataclass(frozen=True)
class Differences:
    """Cells of surface that agree in shape, and those of them that look different."""

    compared: int
    #: (K, 3) middles of those that differ, in the frame of the first scan.
    places: Float64


def differences(a: Prepared, b: Prepared, pose: Float64) -> Differences | None:
    """Compare the looks of planar patches where they meet under ``b_from_a``, in small cells.

    Compared is colour, under a ceiling: outdoors shadows move, and intensity at edges and in glare differs between
    two scans of one place as much as between copies. What most of a tile differs by is of the light. A cell differs if
    what is left is more than its own scatter, that of the other cells and another camera explain.

    Returns
    -------
    Differences or None
        None where nothing can be said.
    """
    if compared_kind(a, b) != COLOR:
        return None
    index = a.textures[COLOR].index
    of_a, of_b = meeting(a, b, pose, index[a.surfels.patch[index] >= 0], b.textures[COLOR])
    on_patches = b.surfels.patch[of_b] >= 0
    of_a, of_b = of_a[on_patches], of_b[on_patches]
    points, normals = a.surfels.points[of_a], a.surfels.normals[of_a]
    edge = max(_CELL, _SPACINGS * max(a.surfels.spacing, b.surfels.spacing))
    tile, cell = pieces(points, normals, max(_TILE, 4 * edge)), pieces(points, normals, edge)
    number = np.bincount(cell)
    told = number >= _LEAST_SURFELS
    if told.sum() < _LEAST_CELLS:
        return None
    differ = np.zeros(len(number), dtype=bool)
    for first, second in zip(_looks(a, of_a), _looks(b, of_b), strict=True):
        differ |= told & _odd(_less_usual(first, tile), _less_usual(second, tile), cell, told)
    places = np.stack([np.bincount(cell, axis)[differ] / number[differ] for axis in points.T], axis=1)
    return Differences(int(told.sum()), places)


def _looks(scan: Prepared, index: NDArray[np.intp]) -> list[Float64]:
    """Logarithms of (K,) surfels: grey less the shading of its patch, and red and blue over green."""
    color = np.maximum(scan.surfels.color[index].astype(np.float64), _DARKEST)
    red, green, blue = np.log(color).T
    return [scan.photometry.color[index] / color.mean(axis=1), red - green, blue - green]


def _less_usual(values: Float64, tile: Int64) -> Float64:
    """Take from (N,) values the median of their tile."""
    medians = np.asarray(ndimage.median(values, tile, np.arange(tile.max() + 1)))
    left: Float64 = values - medians[tile]
    return left


def _odd(first: Float64, second: Float64, cell: Int64, told: Bool) -> Bool:
    """Which cells of the (N,) values of both scans differ by more than scatter explains."""
    number = np.maximum(np.bincount(cell), 2)

    def mean(of: Float64) -> Float64:
        means: Float64 = np.bincount(cell, of) / number
        return means

    off = mean(second - first)
    variance = np.maximum(mean((second - first) ** 2) - off**2, 0.0) / (number - 1)
    # 1.4826 median deviations are one standard deviation of normally distributed values.
    usual = _USUAL * 1.4826 * float(np.median(np.abs(off[told])))
    sigma = np.sqrt(variance + usual**2 + _STEP**2)
    contrast = np.maximum(np.abs(mean(first)), np.abs(mean(second)))
    odd: Bool = np.abs(off) > np.maximum.reduce(
        [np.full(len(off), _LEAST), _SIGNIFICANT * sigma, _OF_CONTRAST * contrast]
    )
    return odd
