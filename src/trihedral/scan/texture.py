"""What the surface of a scan looks like, and which of it is near."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Texture:
    """Values of surface elements from which light and distance are taken (`scan.photometry`).

    Attributes
    ----------
    points
        (N, 3) places of the elements.
    values
        (N,); NaN where nothing is known.
    """

    points: Float32
    values: Float32

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """Indices of the elements whose value is known."""
        return np.flatnonzero(np.isfinite(self.values))

    @cached_property
    def tree(self) -> KDTree:
        """Finds the nearest of `index`."""
        # It is searched for a scan's elements a few times: what halving by medians costs does not come back.
        return KDTree(self.points[self.index], leafsize=32, compact_nodes=False, balanced_tree=False)

    @cached_property
    def _neighbours(self) -> tuple[Float64, NDArray[np.intp]]:
        """Distance (N,) to the nearest other element of `index`, NaN where it was not asked for, and which it is."""
        return np.full(len(self.points), np.nan), np.zeros(len(self.points), dtype=np.intp)

    def neighbours(self, index: NDArray[np.intp]) -> tuple[Float64, NDArray[np.intp]]:
        """Distances (m) of (K,) elements whose value is known to the nearest others, and which these are."""
        # A scan is compared under many poses: each element is searched for once.
        apart, nearest = self._neighbours
        unknown = index[np.isnan(apart[index])]
        if len(unknown):
            found, which = self.tree.query(self.points[unknown], k=2)
            nearest[unknown] = self.index[which[:, 1]]
            apart[unknown] = found[:, 1]
        return apart[index], nearest[index]
