"""Whether poses are borne out by what both scanners saw."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trihedral import _core
from trihedral.geometry.arrays import Float64
from trihedral.scan.prepared import Prepared

# Shares of surface in conflict that make a pose e times less believable (docs/method/verdict.md). Static structure: at
# most 0.011 under right poses on real scans with vehicles and trees; 0.037 and more under most wrong ones in rooms
# alike.
STATIC_SCALE = 0.03
# Everything else: at most 0.16 under right poses; 0.34 and more under most wrong ones, but 0.2 was seen.
SMALL_SCALE = 0.25


@dataclass(frozen=True)
class Agreement:
    """What becomes of the surface of two stations under N poses; shares of each station's surface.

    A point that was seen too thinly for a plane of its own counts as a loose surfel; it agrees where the other
    station's surface faces its scanner.
    """

    #: (N, 2) for `a` seen by `b` and for `b` seen by `a`: on the other's surface and facing alike; in space that the
    #: other saw through; where the other saw a surface but another one.
    agreeing: Float64
    conflicting: Float64
    near: Float64
    #: (N, 2) agreeing surface, weighed so that surfaces of every facing count alike: ground on ground alone holds
    #: nothing.
    holding: Float64
    #: (N,) the larger, over both ways, of conflicting over compared surface, counting only planar patches too large to
    #: be of something that moves.
    static_conflict: Float64
    #: (N,) the same over everything else.
    small_conflict: Float64
    #: (N, 2, 3) agreeing and conflicting of each kind: loose, of a patch, static.
    agreeing_of: Float64
    conflicting_of: Float64

    def score(self, leniency: float = 1.0) -> Float64:
        """(N,) surface that holds the pose, less believable the more surface is in conflict.

        A leniency of more than 1 forgives as many times more conflict: a pose that is still half a metre off puts parts
        of walls into free space.
        """
        doubt = self.static_conflict / STATIC_SCALE + self.small_conflict / SMALL_SCALE
        score: Float64 = self.holding.mean(axis=1) * np.exp(-doubt / leniency)
        return score

    def balance(self, price: float) -> Float64:
        """(N,) surface that holds the pose less `price` times that in conflict, of the station that has more of it."""
        balance: Float64 = self.holding.mean(axis=1) - price * self.conflicting.max(axis=1)
        return balance

    @property
    def overlap(self) -> tuple[float, float]:
        """Share of each station's surface that the other one has too, under the first pose."""
        a, b = self.agreeing[0].tolist()
        return a, b

    @property
    def conflict(self) -> Float64:
        """(N,) the larger, over both ways, of conflicting over agreeing and conflicting surface of every kind."""
        compared = np.maximum(self.agreeing + self.conflicting, 1e-9)
        conflict: Float64 = (self.conflicting / compared).max(axis=1)
        return conflict

    @property
    def purity(self) -> Float64:
        """(N,) agreeing over all surface where the other station saw one or saw through."""
        agreeing = self.agreeing.sum(axis=1)
        seen = agreeing + self.conflicting.sum(axis=1) + self.near.sum(axis=1)
        purity: Float64 = agreeing / np.maximum(seen, 1e-9)
        return purity


def compare(
    a: Prepared, b: Prepared, poses: Sequence[Float64], *, offset: float, margin: float, samples: int
) -> Agreement:
    """Compare both stations under each pose ``b_from_a`` (scanner-centred).

    Parameters
    ----------
    offset
        Metres along the normal within which two surfaces are one.
    margin
        Metres before a surface from which space counts as seen through.
    samples
        Surfels of each station that are compared, and thin points in the same proportion.
    """
    found = _core.agreement(
        a.surfel_map,
        b.surfel_map,
        np.array(poses).reshape(-1, 4, 4),
        offset=offset,
        margin=margin,
        samples=samples,
    )
    agreeing, conflicting = found.agreeing_of, found.conflicting_of
    return Agreement(
        agreeing=found.agreeing,
        conflicting=found.conflicting,
        near=found.near,
        holding=found.holding,
        static_conflict=_conflict(agreeing[..., 2], conflicting[..., 2]),
        small_conflict=_conflict(agreeing[..., :2].sum(axis=2), conflicting[..., :2].sum(axis=2)),
        agreeing_of=agreeing,
        conflicting_of=conflicting,
    )


def _conflict(agreeing: Float64, conflicting: Float64) -> Float64:
    """Conflicting over compared surface, the larger of both ways; (N, 2) each to (N,)."""
    compared = agreeing + conflicting
    # Under half a per cent of a station says nothing of conflicts.
    ratio = np.where(compared > 0.005, conflicting / np.maximum(compared, 1e-9), 0.0)
    larger: Float64 = ratio.max(axis=1)
    return larger
