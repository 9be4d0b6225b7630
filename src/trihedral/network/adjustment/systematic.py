"""What links err by beside what their own covariances say, found from loops."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.network.adjustment.adjustment import adjust
from trihedral.network.graph.edge import Edge

# Weight of what is assumed against what loops show, in observations: those of one loop.
_ASSUMED = 3.0
_ROUNDS = 25
_CONVERGED = 0.02  # change of a variance as share of it


@dataclass(frozen=True)
class Systematic:
    """What links err by beside what their own covariances say, the same for all links of a job."""

    translation: float  # metres, one sigma in each direction, beside their own
    rotation: float  # radians, the same
    scale: float = 1.0  # their own covariances are too small by this factor

    @property
    def covariance(self) -> Float64:
        """(6, 6) of (omega, v), what is added."""
        return np.diag([self.rotation**2] * 3 + [self.translation**2] * 3)


def estimate(components: Sequence[Sequence[Edge]], assumed: Systematic) -> Systematic:
    """Variance components of all links, from how far they contradict each other.

    Each link's covariance is `scale` times its own plus ``translation**2`` and ``rotation**2``. Restricted maximum
    likelihood finds these by iterated almost unbiased estimation (Horn, Horn and Duncan 1975; Foerstner 1979), with
    what is assumed as if `_ASSUMED` more observations had shown it: one loop proves little. They are never less than is
    assumed, since what all links of a scan err by together closes every loop.

    Parameters
    ----------
    components
        Links of each connected component, `assumed` in their covariances; links that a person gave take no part.
    """
    found = assumed
    if min(assumed.translation, assumed.rotation) <= 0:
        return assumed
    looped = [
        edges for edges in components if edges and len(edges) >= len({end for e in edges for end in e.ends})
    ]
    prior = np.array([assumed.rotation**2, assumed.translation**2, assumed.scale])
    for _ in range(_ROUNDS if looped else 0):
        found_squares, expected_squares = np.zeros(3), np.zeros(3)
        for edges in looped:
            adjusted = adjust(edges[0].a, with_systematic(edges, assumed, found), checks=False)
            for k, edge in enumerate(edges):
                if edge.locked:
                    continue
                residual, spread = adjusted.weighted_residuals[k], adjusted.expected_residual_covariance[k]
                own = edge.covariance - assumed.covariance
                turn, shift = residual[:3], residual[3:]
                found_squares += [turn @ turn, shift @ shift, residual @ own @ residual]
                of_turn, of_shift = np.trace(spread[:3, :3]), np.trace(spread[3:, 3:])
                expected_squares += [of_turn, of_shift, np.sum(own * spread)]
        now = np.array([found.rotation**2, found.translation**2, found.scale])
        better = np.maximum(
            (now**2 * found_squares + _ASSUMED * prior) / (now * expected_squares + _ASSUMED), prior
        )
        found = Systematic(float(np.sqrt(better[1])), float(np.sqrt(better[0])), float(better[2]))
        if np.abs(np.log(better / now)).max() < _CONVERGED:
            break
    return found


def with_systematic(edges: Sequence[Edge], old: Systematic, new: Systematic) -> list[Edge]:
    """Edges with other errors in their covariances than those of `old`."""
    ratio = new.scale / old.scale
    more = new.covariance - ratio * old.covariance
    return [
        edge if edge.locked else replace(edge, covariance=ratio * edge.covariance + more) for edge in edges
    ]
