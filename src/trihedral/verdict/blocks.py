"""Surface that two stations compare under a pose, counted in blocks of space: neighbours do not see independently."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.geometry.arrays import Bool, Float32, Float64
from trihedral.geometry.se3 import inverse
from trihedral.scan.pieces import numbered
from trihedral.scan.prepared import Prepared

# Metres: edge of a block.
BLOCK = 0.5
# Of a block's surfels, the share and the number that the other station must have an opinion on.
_KNOWN_SHARE, _KNOWN = 0.5, 2
# Outcomes and kinds of `_core.compare_surfels`.
_AGREEING, _CONFLICTING, _NEAR = 1, 2, 4
_LOOSE, _KINDS = 0, 3
# Standard deviations beyond which surfaces that agree are not quite the same; metres that are forgiven besides.
_MISFIT, _SETTLED = 3.0, 0.001
# Loose surfels that agree, below which their misfit is not told, and what is assumed then: more than the 0.17 that
# wrong poses have in the mean.
_LEAST_LOOSE, _UNTOLD_MISFIT = 20, 0.4


@dataclass(frozen=True)
class BlockCounts:
    """Blocks of both stations; of each, the share that agrees and that is in space which the other saw through."""

    #: (3,) of each kind: loose, of a patch, static.
    agreeing: Float64
    conflicting: Float64
    #: Share of the loose surfels that agree and are off by more than noise explains.
    misfit: float


def count_blocks(
    a: Prepared, b: Prepared, pose: Float64, *, offset: float, margin: float, samples: int
) -> BlockCounts:
    """Count what becomes of the surface of both stations under ``b_from_a`` (scanner-centred).

    Parameters are those of `agreement.compare`.
    """
    agreeing, conflicting, misfits = np.zeros(_KINDS), np.zeros(_KINDS), []
    for one, other, other_from_one in ((a, b, pose), (b, a, inverse(pose))):
        found = _core.compare_surfels(
            one.surfel_map, other.surfel_map, other_from_one, offset=offset, margin=margin, samples=samples
        )
        for kind in range(_KINDS):
            of_kind = found.kind == kind
            shares = _shares(found.points[of_kind], found.outcome[of_kind])
            agreeing[kind] += shares[0]
            conflicting[kind] += shares[1]
        agrees = (found.kind == _LOOSE) & (found.outcome == _AGREEING) & np.isfinite(found.sigma)
        misfits.append(_misfit(found.offset[agrees], found.sigma[agrees]))
    return BlockCounts(agreeing, conflicting, float(np.mean(misfits)))


def _shares(points: Float32, outcome: NDArray[np.uint8]) -> tuple[float, float]:
    """Sums over blocks of the shares that agree and that are in conflict, of (N,) surfels at (N, 3) points."""
    if not len(points):
        return 0.0, 0.0
    block = numbered(np.floor(points / BLOCK).astype(np.int64))
    number = np.bincount(block)

    def counted(which: Bool) -> Float64:
        return np.bincount(block, which).astype(np.float64)

    agreeing, conflicting = counted(outcome == _AGREEING), counted(outcome == _CONFLICTING)
    known = agreeing + conflicting + counted(outcome == _NEAR)
    told = (known >= _KNOWN_SHARE * number) & (known >= _KNOWN)
    return float(np.sum(agreeing[told] / known[told])), float(np.sum(conflicting[told] / known[told]))


def _misfit(offset: Float32, sigma: Float32) -> float:
    if len(offset) <= _LEAST_LOOSE:
        return _UNTOLD_MISFIT
    return float(np.mean(np.abs(offset) > _MISFIT * np.hypot(sigma, _SETTLED)))
