"""Space that a station saw to be empty."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from trihedral.scan.stored_arrays import Arrays


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

    def arrays(self) -> Arrays:
        """All of it, cells where something was seen only: a scan of few points is a small file."""
        seen = (self.nearest != 0) | (self.farthest != 0)
        # Where what was seen begins and ends, in turns.
        edges = np.flatnonzero(np.diff(seen, prepend=False, append=False)).astype(np.uint32)
        cells = np.asarray(len(seen))
        return {
            "cells": cells,
            "edges": edges,
            "nearest": self.nearest[seen],
            "farthest": self.farthest[seen],
        }

    @classmethod
    def from_arrays(cls, stored: Arrays) -> Self:
        """Undo `arrays`."""
        edge = np.zeros(int(stored["cells"]) + 1, dtype=bool)
        edge[stored["edges"]] = True
        seen = np.logical_xor.accumulate(edge)[:-1]
        nearest, farthest = np.zeros((2, len(seen)), dtype=np.float32)
        nearest[seen], farthest[seen] = stored["nearest"], stored["farthest"]
        return cls(nearest, farthest)
