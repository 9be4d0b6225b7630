"""Links compared anew where all scans together put them: the surfaces of all scans adjusted at once.

A link's own pose is where its two scans alone fit best, which may be some way off, or not quite reached, along what
they hardly know. So each link's surfaces are compared at the adjusted poses, and what they want there takes the link's
place; all poses are adjusted again, until they rest: Gauss and Newton's iteration over all shared surface.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import distance, inverse
from trihedral.model.link import PoseEstimate
from trihedral.network.adjustment.adjustment import adjust
from trihedral.network.adjustment.systematic import Systematic
from trihedral.network.graph.edge import Edge
from trihedral.network.visiting_order import visiting_order
from trihedral.parallel import ordered_map, processors
from trihedral.progress import Progress, Silent

# Of two stations by number, where their surfaces want to be from a motion ``b_from_a`` between scanners.
Surfaces = Callable[[int, int, Float64], PoseEstimate]

ROUNDS = 10
_RESTS = 1e-4  # metres that no station moves any more
# Metres and radians by which a motion must have changed for its surfaces to be compared once more.
_STAYS, _STAYS_TURN = 5e-5, 1e-5
# Metres and radians from a link's own pose beyond which its surfaces are not compared anew: they have nothing to say.
_REACH, _REACH_TURN = 0.02, float(np.radians(0.1))


def compared_anew(
    components: Sequence[Sequence[Edge]],
    surfaces: Surfaces,
    systematic: Systematic,
    names: Sequence[str],
    progress: Progress | None = None,
    threads: int | None = None,
) -> list[list[Edge]]:
    """Edges of connected components as their surfaces have them at the poses that fit all of a component best.

    Parameters
    ----------
    components
        Edges as the pairs alone have them; those that a person gave stay.
    systematic
        What links err by beside what their own covariances say.
    names
        Of the stations.
    progress
        Is told of each comparison; each iteration is a phase.
    threads
        Comparisons at once; by default as many as there are processors.
    """
    progress = progress or Silent()

    def done(item: tuple[_Component, int, Float64], _: object) -> None:
        edge = item[0].edges[item[1]]
        progress.advance(f"{names[edge.a]} - {names[edge.b]}", 1.0)

    found = [_Component(edges, systematic) for edges in components]
    moving = found
    for number in range(1, ROUNDS + 1):
        asked = [(component, k, pose) for component in moving for k, pose in component.asked().items()]
        if not asked:
            break
        progress.phase(f"Comparing surfaces, round {number}", len(asked), "links", len(asked), "")
        answers = ordered_map(
            lambda item: surfaces(*item[0].edges[item[1]].ends, item[2]),
            asked,
            threads or processors(),
            done,
        )
        for (component, k, pose), answer in zip(asked, answers, strict=True):
            component.take(k, pose, answer)
        moving = [component for component in moving if component.moved() >= _RESTS]
    return [component.current for component in found]


class _Component:
    """One connected component while its surfaces are compared."""

    def __init__(self, edges: Sequence[Edge], systematic: Systematic) -> None:
        self.edges = edges
        self.current = list(edges)
        self._systematic = systematic
        self._compared: dict[int, Float64] = {}
        self._order = visiting_order([edge.ends for edge in edges])
        self._poses = self._adjusted()

    def asked(self) -> dict[int, Float64]:
        """Edges to compare, in the order in which few scans are loaded, and the motions to compare them at."""
        asked: dict[int, Float64] = {}
        for k in self._order:
            edge = self.edges[k]
            if edge.locked:
                continue
            between = inverse(self._poses[edge.b]) @ self._poses[edge.a]
            if k in self._compared:
                metres, radians = distance(self._compared[k], between)
                if metres <= _STAYS and radians <= _STAYS_TURN:
                    continue
            metres, radians = distance(edge.transform, between)
            if metres <= _REACH and radians <= _REACH_TURN:
                asked[k] = between
        return asked

    def take(self, k: int, compared: Float64, wanted: PoseEstimate) -> None:
        """Put what an edge's surfaces want, where they were compared, in its place."""
        self._compared[k] = compared
        if wanted.covariance is not None:
            covariance = self._systematic.scale * wanted.covariance + self._systematic.covariance
            self.current[k] = replace(self.edges[k], transform=wanted.transform, covariance=covariance)

    def moved(self) -> float:
        """Adjust anew; metres that the station moves that moves most."""
        before, self._poses = self._poses, self._adjusted()
        return float(max(np.linalg.norm((self._poses[s] - before[s])[:3, 3]) for s in before))

    def _adjusted(self) -> Mapping[int, Float64]:
        return adjust(self.edges[0].a, self.current, poses_only=True).poses
