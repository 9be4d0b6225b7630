"""What surfaces look like less the light on them and the way to them, which change from scan to scan."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from trihedral.geometry.arrays import Float32, Float64, Int64
from trihedral.scan.pieces import numbered, pieces
from trihedral.scan.surfels import Surfels

# Surfels of a patch, or of a piece of it, below which its shading says nothing.
LEAST_TOGETHER = 30
# Metres: surface that no patch has is compared with what is about it within this.
TILE = 1.5
# Metres: the light of a lamp changes evenly over so much of a patch.
EVEN = 3.0
# Square of the share of a surface's extent that its thickness may be.
_FLAT = 1e-4
# Cosine to the normal from which paint, tiles and glass send the beam back like a mirror: 5 degrees from head-on.
GLARE = float(np.cos(np.radians(5.0)))
# Of intensities, and of cosines, that logarithms are taken of; 8 bits of intensity end at 0.004.
_LEAST_INTENSITY, _LEAST_COSINE = 1e-3, 0.02
# Surfels that the fall-off is found from, at the most, and rounds until what does not follow it counts little.
_SAMPLES, _ROUNDS = 6_000, 4
# Least eigenvalue that tells something, to the largest: on a single plane range and cosine are the same.
_TOLD = 1e-6


@dataclass(frozen=True)
class Photometry:
    """What is left of colour and intensity once light, distance and incidence are taken away.

    Attributes
    ----------
    color
        (N,) grey value of each surfel's colour less its shading; NaN without colour.
    intensity
        (N,) logarithm of its intensity less what distance and incidence make of it, and less its shading; NaN without.
    """

    color: Float32
    intensity: Float32


@dataclass(frozen=True)
class SurfaceTexture:
    """Values of surfels less light and distance, and which of them is near.

    Attributes
    ----------
    points
        (N, 3) places of the surfels.
    values
        (N,); NaN where nothing is known.
    """

    points: Float32
    values: Float32

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """Indices of the surfels whose value is known."""
        return np.flatnonzero(np.isfinite(self.values))

    @cached_property
    def tree(self) -> KDTree:
        """Finds the nearest of `index`."""
        # It is searched for a scan's surfels a few times: what halving by medians costs does not come back.
        return KDTree(self.points[self.index], leafsize=32, compact_nodes=False, balanced_tree=False)

    @cached_property
    def _neighbours(self) -> tuple[Float64, NDArray[np.intp]]:
        """Distance (N,) to the nearest other surfel of `index`, NaN where it was not asked for, and which it is."""
        return np.full(len(self.points), np.nan), np.zeros(len(self.points), dtype=np.intp)

    def neighbours(self, index: NDArray[np.intp]) -> tuple[Float64, NDArray[np.intp]]:
        """Distances (m) of (K,) surfels whose value is known to the nearest others, and which these are."""
        # A scan is compared under many poses: each surfel is searched for once.
        apart, nearest = self._neighbours
        unknown = index[np.isnan(apart[index])]
        if len(unknown):
            found, which = self.tree.query(self.points[unknown], k=2)
            nearest[unknown] = self.index[which[:, 1]]
            apart[unknown] = found[:, 1]
        return apart[index], nearest[index]


def photometry(surfels: Surfels) -> Photometry:
    """Take light, distance and incidence from what a scan shows."""
    return Photometry(
        color=less_shading(surfels, surfels.color.mean(axis=1, dtype=np.float64)),
        intensity=less_shading(surfels, less_fall_off(surfels)),
    )


def less_shading(surfels: Surfels, grey: NDArray[np.floating]) -> Float32:
    """Take from (N,) values of the surfels their linear trend over the patch, or the tile where there is none.

    Lamps fall off: of what is left the trend over each piece of a patch is taken, too.

    Returns
    -------
    (N,)
        NaN where the value is, and where too few surfels are together.
    """
    surface = _surfaces(surfels)
    known = np.flatnonzero(np.isfinite(grey) & (surface >= 0))
    points, surface = surfels.points[known].astype(np.float64), surface[known]
    left = _less_trend(points, grey[known].astype(np.float64), surface)
    places = np.floor(points / EVEN).astype(np.int64)
    finer = _less_trend(points, left, numbered(np.column_stack([surface, places])))
    texture = np.full(len(surfels.points), np.nan, dtype=np.float32)
    texture[known] = np.where(np.isfinite(finer), finer, left)
    return texture


def less_fall_off(surfels: Surfels) -> Float64:
    """Take from the logarithm of the (N,) intensities what range and incidence make of them.

    Instruments differ in that, and many correct for a part of it. So it is found in the scan itself: the polynomial of
    second degree in the logarithms of range and cosine that leaves least within patches and tiles (Cauchy's weights).

    Returns
    -------
    (N,)
        NaN where the intensity is, where there is no plane, and where a surface is seen head-on and may glare.
    """
    points = surfels.points.astype(np.float64)
    distance = np.linalg.norm(points, axis=1)
    cosine = np.abs(np.einsum("ij,ij->i", points, surfels.normals)) / distance
    surface = _surfaces(surfels)
    left = np.full(len(points), np.nan)
    known = np.flatnonzero(np.isfinite(surfels.intensity) & (surface >= 0) & (cosine < GLARE))
    if not len(known):
        return left
    steep, far = np.log(np.maximum(cosine[known], _LEAST_COSINE)), np.log(distance[known])
    terms = np.column_stack([steep, steep**2, far, far**2])
    bright = np.log(np.maximum(surfels.intensity[known].astype(np.float64), _LEAST_INTENSITY))
    some = np.s_[:: max(1, len(known) // _SAMPLES)]
    left[known] = bright - terms @ _common_trend(terms[some], bright[some], surface[known][some])
    return left


def _common_trend(terms: Float64, values: Float64, group: Int64) -> Float64:
    """(K,) weights of (N, K) terms that values follow in every group, each group with a level of its own."""
    number = np.maximum(np.bincount(group), 1)

    def centred(of: Float64) -> Float64:
        less_mean: Float64 = of - (np.bincount(group, of) / number)[group]
        return less_mean

    inside = np.column_stack([centred(term) for term in terms.T])
    values = centred(values)
    slope = np.zeros(terms.shape[1])
    weight = np.ones(len(values))
    for _ in range(_ROUNDS):
        # Plain sums: those of matrix products may depend on the number of threads.
        square = np.einsum("n,ni,nj->ij", weight, inside, inside)
        along = np.einsum("n,ni,n->i", weight, inside, values)
        slope = np.linalg.pinv(square, rcond=_TOLD, hermitian=True) @ along
        rest = values - np.einsum("ni,i->n", inside, slope)
        # 1.4826 median deviations are one standard deviation of normally distributed values.
        weight = 1.0 / (1.0 + (rest / (2 * 1.4826 * np.median(np.abs(rest)) + 1e-12)) ** 2)
    return slope


def _surfaces(surfels: Surfels) -> Int64:
    """(N,) number of a surfel's patch, of its tile where a thinly seen plane has no patch; -1 where it has no plane.

    Tiles are pieces of space with the axis that surface in them faces.
    """
    surface = surfels.patch.astype(np.int64)
    off = np.flatnonzero((surfels.patch < 0) & surfels.planar)
    patches = surface.max(initial=-1) + 1
    surface[off] = patches + pieces(surfels.points[off], surfels.normals[off], TILE)
    return surface


def _less_trend(points: Float64, values: Float64, group: Int64) -> Float64:
    """Take from values their linear trend over (N, 3) points of each group; NaN where it is too small."""
    if not len(values):
        return values
    number = np.bincount(group)

    def mean(of: Float64) -> Float64:
        together: Float64 = np.bincount(group, of) / np.maximum(number, 1)
        return together

    offset = points - np.column_stack([mean(points[:, k]) for k in range(3)])[group]
    left = values - mean(values)[group]
    spread = np.array([[mean(offset[:, i] * offset[:, j]) for i in range(3)] for j in range(3)])
    along = np.stack([mean(offset[:, i] * left) for i in range(3)], axis=1)
    slope = np.einsum(
        "gij,gj->gi", np.linalg.pinv(np.moveaxis(spread, 2, 0), rcond=_FLAT, hermitian=True), along
    )
    left -= np.einsum("ij,ij->i", offset, slope[group])
    left[number[group] < LEAST_TOGETHER] = np.nan
    return left
