"""Links compared anew where all scans together put them: the surfaces of all scans adjusted at once.

A link's own pose is where its two scans alone fit best, which may be some way off, or not quite reached, along what
they hardly know. So each link's surfaces are compared at the adjusted poses, and what they want there takes the link's
place; all poses are adjusted again, until they rest: Gauss and Newton's iteration over all shared surface.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.motion import distance, inverse
from trihedral.network.adjustment import adjust
from trihedral.network.consistency import Edge
from trihedral.network.itinerary import itinerary
from trihedral.network.systematic import Systematic
from trihedral.parallel import ordered_map, processors

Float64 = NDArray[np.float64]

#: Of two stations by number, what their surfaces want at a motion ``b_from_a`` between scanners: motion and covariance.
Surfaces = Callable[[int, int, Float64], tuple[Float64, Float64]]

ROUNDS = 10
_RESTS = 1e-4  # metres that no station moves any more
# Metres and radians by which a motion must have changed for its surfaces to be compared once more.
_STAYS, _STAYS_TURN = 5e-5, 1e-5
# Metres and radians from a link's own pose beyond which its surfaces are not compared anew: they have nothing to say.
_REACH, _REACH_TURN = 0.02, float(np.radians(0.1))


def compared_anew(edges: Sequence[Edge], surfaces: Surfaces, systematic: Systematic) -> list[Edge]:
    """Edges of one connected part as their surfaces have them at the poses that fit all of them best.

    Parameters
    ----------
    edges
        As the pairs alone have them; those that a person gave stay.
    systematic
        What links err by beside what their own covariances say.
    """
    current = list(edges)
    compared: dict[int, Float64] = {}
    poses = adjust(edges[0].a, current, poses_only=True).poses
    order = itinerary([edge.ends for edge in edges])
    for _ in range(ROUNDS):
        asked: dict[int, Float64] = {}
        for k in order:
            edge = edges[k]
            if edge.locked:
                continue
            between = inverse(poses[edge.b]) @ poses[edge.a]
            if k in compared:
                metres, radians = distance(compared[k], between)
                if metres <= _STAYS and radians <= _STAYS_TURN:
                    continue
            metres, radians = distance(edge.transform, between)
            if metres <= _REACH and radians <= _REACH_TURN:
                asked[k] = between
        answers = ordered_map(
            lambda item: surfaces(edges[item[0]].a, edges[item[0]].b, item[1]),
            list(asked.items()),
            processors(),
        )
        for k, (wanted, covariance) in zip(asked, answers, strict=True):
            covariance = systematic.scale * covariance + systematic.covariance
            current[k] = replace(edges[k], transform=wanted, covariance=covariance)
        compared |= asked
        before, poses = poses, adjust(edges[0].a, current, poses_only=True).poses
        if max(np.linalg.norm((poses[s] - before[s])[:3, 3]) for s in poses) < _RESTS:
            break
    return current
