"""Whether points can have been seen from a place: what a surface hides was not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trihedral.geometry.arrays import Float64
from trihedral.scan.place.neighbourhoods import Neighbourhoods, neighbourhoods

# A surface is asked about where it is seen less slantwise than this, and hides what is farther behind it than this:
# metres, and share of the range.
_LEAST_COSINE = 0.2
_GAP, _GAP_SHARE = 0.2, 0.03
# Surfaces are looked up apart by range, each shell farther than the last by this factor.
_SHELL = 1.5
# Points that surfaces are made of, pieces of them, points of a piece, points that are asked about.
_SAMPLE, _PIECES, _NEIGHBOURS, _ASKED = 120_000, 25_000, 12, 10_000
# Pieces of a shell that may hide a point, and the share of a piece's radius that it hides within.
_CANDIDATES, _INSIDE = 4, 0.6
# Directions are told apart in cells: parts of a unit; one with fewer points tells nothing, and in one of which more
# than this share is hidden, many are.
_CELLS, _LEAST, _MANY = 4.0, 10, 0.1


@dataclass(frozen=True)
class Hidden:
    """What of a scan lies behind surfaces of its own.

    Attributes
    ----------
    share
        Of the points.
    spread
        Share of the directions with points where many do.
    """

    share: float
    spread: float


def hidden_from(points: Float64, place: Float64, rng: np.random.Generator) -> Hidden:
    """Tell what of points (N, 3) planar surfaces among them hide from a place."""
    sample = points[rng.choice(len(points), min(len(points), _SAMPLE), replace=False)]
    pieces = neighbourhoods(sample, rng, _PIECES, _NEIGHBOURS)
    ray = points[rng.choice(len(points), min(len(points), _ASKED), replace=False)] - place
    distance = np.maximum(np.linalg.norm(ray, axis=1), 1e-6)
    direction = ray / distance[:, None]
    behind = _behind(pieces, direction, distance, place)
    cell = np.unique(np.floor(direction * _CELLS), axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(cell)
    many = (np.bincount(cell, behind) > _MANY * count)[count >= _LEAST]
    return Hidden(float(behind.mean()), float(many.mean()) if len(many) else 0.0)


def _behind(
    pieces: Neighbourhoods, direction: Float64, distance: Float64, place: Float64
) -> NDArray[np.bool_]:
    own = pieces.centres - place
    length = np.maximum(np.linalg.norm(own, axis=1), 1e-6)
    height = np.einsum("mi,mi->m", own, pieces.normals)
    sound = np.abs(height) > _LEAST_COSINE * length
    shell = np.floor(np.log(length) / np.log(_SHELL)).astype(np.int64)
    behind = np.zeros(len(direction), dtype=bool)
    for number in np.unique(shell[sound]):
        here = np.flatnonzero(sound & (shell == number))
        asked = np.flatnonzero(~behind & (distance > _SHELL ** float(number) + _GAP))
        if not len(asked):
            break
        tree = cKDTree(own[here] / length[here, None])
        near = tree.query(direction[asked], k=min(_CANDIDATES, len(here)))[1].reshape(len(asked), -1)
        found = here[near]
        towards = np.einsum("ai,aki->ak", direction[asked], pieces.normals[found])
        depth = height[found] / np.where(np.abs(towards) < 1e-6, 1e-6, towards)
        off = direction[asked][:, None] * depth[..., None] - own[found]
        inside = np.einsum("aki,aki->ak", off, off) < (_INSIDE * pieces.radius[found]) ** 2
        gap = np.maximum(_GAP, _GAP_SHARE * distance[asked])[:, None]
        behind[asked] = (inside & (depth > 0) & (distance[asked][:, None] > depth + gap)).any(axis=1)
    return behind
