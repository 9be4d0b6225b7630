"""Points by which a scan is known again, whatever file, order, frame or rounding it comes in.

How far a point is from the scanner does not depend on the frame, so the farthest points of a scan are the farthest of
each copy of it, and of the part of them that a thinned copy keeps. Two scans that were taken apart have no points in
common: their beams meet other places, and what they measure has noise of its own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trihedral.geometry.arrays import Float32, Float64
from trihedral.geometry.kabsch import kabsch

# Beacons are the farthest points of all, and below each of these ranges (metres): a copy may be cut at a range.
_BANDS = tuple(4.0 * 1.5**k for k in range(8))
_OF_ALL, _OF_BAND = 1500, 300
# Metres: beacons of a band that lie closer in range than this are shuffled by rounding.
_THICK = 0.02
# Metres: rounding to a millimetre on either side moves a point by less.
_ROUNDING = 0.002
# Trials of two beacons as a first alignment, the sine of the least angle between them, candidates of each.
_TRIALS, _APART, _CANDIDATES = 20, 0.35, 60
# Beacons that a first alignment is tried with.
_SOME = 200
# A range that by chance (this at most, from those within so many metres) would not be met tells scans apart.
_RARE, _AROUND = 0.15, 0.05
# Share of beacons that a first alignment brings near, and that a copy has in common; the fewest.
_GLANCE, _COMMON, _LEAST = 0.05, 0.3, 20
# Metres: exact copies, and the median of rounded ones.
_EXACT, _ROUNDED = 5e-5, 1e-3
# Rounding goes all ways alike; noise of a second measurement is along the beam.
_ALONG = 2.5


def beacons(points: Float32) -> Float32:
    """Choose beacons among points (N, 3) centred on the scanner; (M, 3), by falling range."""
    distance = np.einsum("ij,ij->i", points, points)
    chosen = [_farthest(distance, _OF_ALL)]
    for band in _BANDS:
        inside = np.flatnonzero(distance < np.float32(band * band))
        if len(inside) in (0, len(points)):
            continue
        own = inside[_farthest(distance[inside], _OF_BAND)]
        if band - np.sqrt(distance[own].min()) > _THICK:
            chosen.append(own)
    index = np.unique(np.concatenate(chosen))
    return np.asarray(points[index[np.argsort(-distance[index], kind="stable")]], dtype=np.float32)


def _farthest(square: Float32, count: int) -> NDArray[np.int64]:
    if len(square) <= count:
        return np.arange(len(square))
    return np.argpartition(square, len(square) - count)[len(square) - count :]


@dataclass(frozen=True)
class _Known:
    """Beacons with their ranges, which fall."""

    points: Float64
    ranges: Float64

    @classmethod
    def of(cls, points: Float32) -> "_Known":
        exact = points.astype(np.float64)
        return cls(exact, np.linalg.norm(exact, axis=1))

    def count_near(self, ranges: Float64, within: float) -> NDArray[np.int64]:
        """Count those of about each of the ranges (K,)."""
        low = np.searchsorted(-self.ranges, -(ranges + within))
        return np.asarray(np.searchsorted(-self.ranges, -(ranges - within)) - low, dtype=np.int64)

    def at(self, range_: float) -> NDArray[np.int64]:
        """Those of about that range."""
        low, high = np.searchsorted(-self.ranges, [-(range_ + _ROUNDING), -(range_ - _ROUNDING)])
        return np.arange(low, high)


def same_scan(a: Float32, b: Float32) -> bool:
    """Tell whether beacons of two scans are points of one."""
    if min(len(a), len(b)) < _LEAST:
        return False
    dense, sparse = _Known.of(a), _Known.of(b)
    if _spacing(dense) > _spacing(sparse):
        dense, sparse = sparse, dense
    shared = dense.count_near(sparse.ranges, _ROUNDING) > 0
    if shared.sum() < _LEAST or (_strangers(dense, sparse) and _strangers(sparse, dense)):
        return False
    rng = np.random.default_rng(len(a) + len(b))
    tree = cKDTree(dense.points)
    for i, j in _trials(sparse, shared, rng):
        for rotation in _alignments(dense, sparse, i, j):
            if _coincide(dense, sparse, tree, rotation):
                return True
    return False


def _strangers(whole: _Known, part: _Known) -> bool:
    """Whether ranges alone tell that one scan is no part of another: most pairs of a job are told apart here."""
    chance = whole.count_near(part.ranges, _AROUND) * (_ROUNDING / _AROUND)
    rare = _covered(whole, part) & (chance < _RARE)
    shared = whole.count_near(part.ranges[rare], _ROUNDING) > 0
    return len(shared) >= _LEAST and float(shared.mean()) < _COMMON


def _spacing(known: _Known) -> float:
    """Of ranges, the median between neighbours."""
    return float(np.median(-np.diff(known.ranges)))


def _trials(sparse: _Known, shared: NDArray[np.bool_], rng: np.random.Generator) -> list[tuple[int, int]]:
    """Pairs of beacons in other directions, those whose ranges are rare first."""
    usable = np.flatnonzero(shared)
    direction = sparse.points[usable] / sparse.ranges[usable, None]
    found: list[tuple[int, int]] = []
    for _ in range(20 * _TRIALS):
        i, j = rng.integers(len(usable), size=2)
        if np.linalg.norm(np.cross(direction[i], direction[j])) > _APART:
            found.append((int(usable[i]), int(usable[j])))
        if len(found) == _TRIALS:
            break
    return found


def _alignments(dense: _Known, sparse: _Known, i: int, j: int) -> list[Float64]:
    """Rotations about the scanner that lay two sparse beacons on dense ones."""
    first, second = dense.at(sparse.ranges[i]), dense.at(sparse.ranges[j])
    if not 0 < len(first) <= _CANDIDATES or not 0 < len(second) <= _CANDIDATES:
        return []
    apart = np.linalg.norm(sparse.points[i] - sparse.points[j])
    between = np.linalg.norm(dense.points[first][:, None] - dense.points[second], axis=2)
    fitting = np.argwhere(np.abs(between - apart) < 2.0 * _ROUNDING)
    own = _triad(sparse.points[i], sparse.points[j])
    return [_triad(dense.points[first[m]], dense.points[second[n]]) @ own.T for m, n in fitting[:_CANDIDATES]]


def _triad(first: Float64, second: Float64) -> Float64:
    """Columns: three directions that two vectors define."""
    x = first / np.linalg.norm(first)
    z = np.cross(first, second)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _coincide(dense: _Known, sparse: _Known, tree: cKDTree, rotation: Float64) -> bool:
    """Whether beacons that a rotation brings together are the same points."""
    # A rotation by two beacons is off by their rounding over their ranges.
    turned = sparse.points @ rotation.T
    glance = tree.query(turned[:: -(-len(turned) // _SOME)], distance_upper_bound=10.0 * _ROUNDING)[0]
    if np.isfinite(glance).mean() < _GLANCE:
        return False
    distance, index = tree.query(turned, distance_upper_bound=10.0 * _ROUNDING)
    near = np.isfinite(distance)
    if near.sum() < max(_LEAST, _GLANCE * len(near)):
        return False
    pose = kabsch(sparse.points[near], dense.points[index[near]])
    moved = sparse.points @ pose[:3, :3].T + pose[:3, 3]
    distance, index = tree.query(moved, distance_upper_bound=_ROUNDING)
    near = np.isfinite(distance)
    covered = _covered(dense, sparse)
    if near.sum() < max(_LEAST, _COMMON * covered.sum()):
        return False
    left = moved[near] - dense.points[index[near]]
    beam = moved[near] / sparse.ranges[near, None]
    along = np.einsum("ij,ij->i", left, beam)
    across = np.sqrt(np.maximum(np.einsum("ij,ij->i", left, left) - along**2, 0.0) / 2.0)
    if np.median(distance[near]) < _EXACT:
        return True
    return bool(
        np.median(distance[near]) < _ROUNDED
        and np.sqrt(np.mean(along**2)) < _ALONG * np.sqrt(np.mean(across**2))
    )


def _covered(dense: _Known, sparse: _Known) -> NDArray[np.bool_]:
    """Which sparse beacons a copy's dense ones would hold: those among the farthest of all of both."""
    whole = min(_OF_ALL, len(dense.ranges)) - 1
    return np.asarray((sparse.ranges >= dense.ranges[whole]) & (sparse.ranges <= dense.ranges[0] + _ROUNDING))
