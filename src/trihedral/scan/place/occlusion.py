"""Whether points can have been seen from a place: what a surface hides was not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trihedral.geometry.arrays import Float64
from trihedral.scan.place.neighbourhoods import Neighbourhoods, neighbourhoods

# Points that are looked at; one of each cell of about this share of the range stays, whatever their density.
_SAMPLE, _CELL = 1_000_000, 0.03
# Points of a piece, its thickness as a share of its extent, its largest radius as a share of the range, and the share
# of its radius that it hides within.
_NEIGHBOURS, _FLATNESS, _WIDEST, _INSIDE = 16, 0.08, 0.12, 0.6
# A surface is asked about where it is seen less slantwise than this, and hides what is farther behind it than this:
# metres, and share of the range.
_LEAST_COSINE = 0.2
_GAP, _GAP_SHARE = 0.1, 0.02
# Surfaces are looked up apart by range, each shell farther than the last by this factor.
_SHELL = 1.25
# Pieces that are asked about, and those of a shell that may hide one.
_ASKED, _CANDIDATES = 10_000, 6
# A lone piece hides nothing: a surface that is whole has so many in each direction.
_COVER = 2
# Planes that may be of glass, draws for each; metres and share of the range that a piece on one lies off it at the
# most, and the least cosine between them.
_PANES, _DRAWS = 3, 30
_OFF, _OFF_SHARE, _ALONG = 0.05, 0.03, 0.9


@dataclass(frozen=True)
class Hidden:
    """What of a scan's surfaces lies behind others of its own, as shares of what is seen of them.

    Attributes
    ----------
    share
        Behind any.
    opaque
        Behind two, or one that is not on the few planes that hide most: what is seen through glass is behind one pane.
    """

    share: float
    opaque: float


def hidden_from(points: Float64, place: Float64, rng: np.random.Generator) -> Hidden:
    """Tell what of the surfaces among points (N, 3) others of them hide from a place."""
    if len(points) > _SAMPLE:
        points = points[rng.integers(len(points), size=_SAMPLE)]
    ray = _evenly(points - place)
    if len(ray) < _NEIGHBOURS:
        return Hidden(0.0, 0.0)
    pieces = neighbourhoods(ray, rng, len(ray), _NEIGHBOURS, _FLATNESS)
    pieces = pieces.of(pieces.radius < _WIDEST * np.linalg.norm(pieces.centres, axis=1))
    if not len(pieces):
        return Hidden(0.0, 0.0)
    asked = pieces.centres[rng.permutation(len(pieces))[:_ASKED]]
    behind, by, depth = _behind(asked, pieces)
    nearest = np.full(len(asked), np.inf)
    np.minimum.at(nearest, behind, depth)
    second = depth > nearest[behind] + _gap(depth)
    first = np.flatnonzero(~second)
    for _ in range(_PANES):
        first = first[~_on_a_plane(pieces, by[first], rng)]
    second[first] = True
    covers = [np.bincount(some, minlength=len(asked)) for some in (behind, behind[second])]
    return Hidden(*(float((cover >= _COVER).mean()) for cover in covers))


def _gap(distance: Float64) -> Float64:
    return np.maximum(_GAP, _GAP_SHARE * distance)


def _evenly(ray: Float64) -> Float64:
    """One point (N, 3) of each cell; cells grow with the distance from zero."""
    distance = np.maximum(np.linalg.norm(ray, axis=1), 1e-3)
    shell = np.floor(np.log(distance) / np.log1p(_CELL)).astype(np.int64)
    across = np.floor(ray / distance[:, None] / _CELL).astype(np.int64)
    number = (shell << 24) + across @ np.array([1 << 16, 1 << 8, 1])
    return np.asarray(ray[np.unique(number, return_index=True)[1]])


def _behind(asked: Float64, pieces: Neighbourhoods) -> tuple[NDArray[np.int64], NDArray[np.int64], Float64]:
    """Pairs of asked (N, 3), seen from zero, and a piece that hides it: their numbers, and how far the piece is."""
    distance = np.linalg.norm(asked, axis=1)
    direction = asked / distance[:, None]
    length = np.linalg.norm(pieces.centres, axis=1)
    height = np.einsum("mi,mi->m", pieces.centres, pieces.normals)
    sound = np.abs(height) > _LEAST_COSINE * length
    shell = np.floor(np.log(length) / np.log(_SHELL)).astype(np.int64)
    pairs = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))]
    for number in np.unique(shell[sound]):
        here = np.flatnonzero(sound & (shell == number))
        beyond = np.flatnonzero(distance > _SHELL ** float(number) + _GAP)
        if not len(beyond):
            break
        tree = cKDTree(pieces.centres[here] / length[here, None])
        near = tree.query(direction[beyond], k=min(_CANDIDATES, len(here)))[1].reshape(len(beyond), -1)
        found = here[near]
        towards = np.einsum("ai,aki->ak", direction[beyond], pieces.normals[found])
        depth = height[found] / np.where(np.abs(towards) < 1e-6, 1e-6, towards)
        off = direction[beyond][:, None] * depth[..., None] - pieces.centres[found]
        inside = np.einsum("aki,aki->ak", off, off) < (_INSIDE * pieces.radius[found]) ** 2
        far = distance[beyond][:, None]
        hides = inside & (depth > 0) & (far > depth + _gap(far))
        pairs.append((beyond[np.nonzero(hides)[0]], found[hides], depth[hides]))
    behind, by, depths = zip(*pairs, strict=True)
    return np.concatenate(behind), np.concatenate(by), np.concatenate(depths)


def _on_a_plane(pieces: Neighbourhoods, by: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.bool_]:
    """Tell which of the hiding pieces lie on that plane, of some that are tried, that most of them lie on."""
    best = np.zeros(len(by), dtype=bool)
    centres, normals = pieces.centres[by], pieces.normals[by]
    most = _OFF + _OFF_SHARE * np.linalg.norm(centres, axis=1)
    for one in rng.integers(len(by), size=_DRAWS) if len(by) else ():
        off = (centres - centres[one]) @ normals[one]
        on = (np.abs(off) < most) & (np.abs(normals @ normals[one]) > _ALONG)
        best = on if on.sum() > best.sum() else best
    return best
