"""Refused links that agree with each other: another way to join the scans, which has to be outvoted clearly."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from trihedral.geometry.arrays import Bool, Float64
from trihedral.geometry.se3 import inverse, rotation_angles
from trihedral.network.decision.state import ComponentPose
from trihedral.network.graph.edge import Edge

# Refused links mean one other way to join the scans if they differ by less than this: metres and radians.
_ALIKE, _ALIKE_ROTATION = 0.15, float(np.radians(1.0))
# Links that hold the scans as they are, for each one that joins them otherwise, from which the matter is decided.
DECISIVE = 2
# Capacities of links: of one that holds by itself, of one that a person decided on, of what is no link.
_STRONG, _FIRM, _ENDLESS = 1_000, 1_000_000, 100_000_000


@dataclass(frozen=True)
class CoherentOutliers:
    """Two ways to join some stations with the others, neither of them clearly outvoted."""

    #: Those that would move.
    stations: frozenset[int]
    #: Where to, in the frame of the poses.
    motion: Float64
    #: Edges that hold them where they are, and that would have them there.
    kept: list[Edge]
    refused: list[Edge]


def coherent_outliers(
    count: int,
    kept: Sequence[Edge],
    refused: Sequence[Edge],
    poses: Mapping[int, ComponentPose],
    weak: Sequence[bool],
) -> list[CoherentOutliers]:
    """Other ways to join the stations of one component for which it is not decided; no edge is in two of them.

    Errors of single links are anything; those that repeated bays or storeys make are the same for several links. Of
    such a group, the kept links that would have to go for it are the fewest that part its two sides (Ford and
    Fulkerson 1956). A single refused link is a group of its own.

    Parameters
    ----------
    weak
        Of each kept edge, whether it was accepted only because others agree with it: it holds nothing by itself.
    """
    inside = [
        e for e in refused if e.a in poses and e.b in poses and poses[e.a].component == poses[e.b].component
    ]
    if not inside:
        return []
    hold = Hold(count, kept, weak)
    found = []
    for group, motion in _coherent(inside, poses):
        moved, still = {s for _, s, _ in group}, {s for _, _, s in group}
        for holding, side in [hold.around(moved), hold.around(still), hold.cut(moved, still)]:
            strong = [k for k in holding if not weak[k]]
            if len(strong) <= DECISIVE * len(group) and not any(kept[k].locked for k in holding):
                there = motion if side & moved else inverse(motion)
                edges = [kept[k] for k in holding]
                found.append(CoherentOutliers(frozenset(side), there, edges, [edge for edge, _, _ in group]))
                break
    found.sort(key=lambda one: (-len(one.refused) / max(len(one.kept), 1), min(one.stations)))
    taken: set[int] = set()
    chosen = []
    for one in found:
        edges_of = {id(edge) for edge in one.kept}
        if not edges_of & taken:
            taken |= edges_of
            chosen.append(one)
    return chosen


def _coherent(
    edges: Sequence[Edge], poses: Mapping[int, ComponentPose]
) -> list[tuple[list[tuple[Edge, int, int]], Float64]]:
    """Groups of edges that ask for one motion: each with the station that moves and the one that stays."""
    at = np.array([[poses[e.a].pose, poses[e.b].pose] for e in edges])
    forth = at[:, 1] @ np.array([e.transform for e in edges]) @ np.linalg.inv(at[:, 0])
    back = np.linalg.inv(forth)
    taken = np.zeros(len(edges), dtype=bool)
    groups = []
    for first in range(len(edges)):
        # What asks for next to no motion is an error of measurement, not another place.
        if taken[first] or _alike(forth[first][None], np.eye(4), at[first, :1])[0]:
            continue
        alike = _alike(forth, forth[first], at[:, 0]) & ~taken
        turned = _alike(back, forth[first], at[:, 1]) & ~taken & ~alike
        group = [(edges[k], edges[k].a, edges[k].b) for k in np.flatnonzero(alike).tolist()]
        group += [(edges[k], edges[k].b, edges[k].a) for k in np.flatnonzero(turned).tolist()]
        chosen = {id(edge) for edge, _, _ in group}
        taken |= np.array([id(edge) in chosen for edge in edges])
        groups += [(some, forth[first]) for some in _split(group)]
    return groups


def _split(group: list[tuple[Edge, int, int]]) -> list[list[tuple[Edge, int, int]]]:
    """Subsets of a group that may each be right or wrong: all of it, then edges of one station, then single ones."""
    found: list[list[tuple[Edge, int, int]]] = []
    # A station cannot both move and stay.
    if len(group) > 1 and not {s for _, s, _ in group} & {s for _, _, s in group}:
        found.append(group)
    left = group
    while left:
        count: dict[tuple[int, int], int] = {}
        for _, moved, still in left:
            for key in ((moved, 1), (still, 2)):
                count[key] = count.get(key, 0) + 1
        (station, side), most = max(count.items(), key=lambda item: (item[1], item[0]))
        if most == 1:
            return found + [[entry] for entry in left]
        star = [entry for entry in left if entry[side] == station]
        if len(star) < len(group) or not found:
            found.append(star)
        left = [entry for entry in left if entry[side] != station]
    return found


def _alike(motions: Float64, motion: Float64, at: Float64) -> Bool:
    """Whether motions (N, 4, 4) take poses (N, 4, 4) where another motion takes them."""
    apart = (motions @ at)[:, :3, 3] - (motion @ at)[:, :3, 3]
    rotation = rotation_angles(inverse(motion) @ motions)
    near: Bool = (np.linalg.norm(apart, axis=1) < _ALIKE) & (rotation < _ALIKE_ROTATION)
    return near


class Hold:
    """The kept edges as a network of flows."""

    def __init__(self, count: int, kept: Sequence[Edge], weak: Sequence[bool]) -> None:
        self.count = count
        self.ends = np.array([edge.ends for edge in kept], dtype=np.int64).reshape(-1, 2)
        # Weak ones count for next to nothing but are cut with the others.
        capacity = np.where(np.array(weak, dtype=bool), 1, _STRONG)
        capacity[[edge.locked for edge in kept]] = _FIRM
        self.capacity = capacity.astype(np.int32)

    def around(self, stations: set[int]) -> tuple[list[int], set[int]]:
        """Kept edges that lead away from some stations, and these."""
        inside = np.isin(self.ends, sorted(stations))
        return np.flatnonzero(inside[:, 0] != inside[:, 1]).tolist(), stations

    def cut(self, moved: set[int], still: set[int]) -> tuple[list[int], set[int]]:
        """Fewest kept edges between two sets of stations, and the side of the first."""
        source, sink = self.count, self.count + 1
        a, b = self.ends.T
        rows = np.concatenate([a, b, [source] * len(moved), sorted(still)])
        columns = np.concatenate([b, a, sorted(moved), [sink] * len(still)])
        ties = np.full(len(moved) + len(still), _ENDLESS, dtype=np.int32)
        flows = np.concatenate([self.capacity, self.capacity, ties])
        shape = (self.count + 2, self.count + 2)
        graph = coo_array((flows, (rows, columns)), shape=shape).tocsr()
        left = graph - maximum_flow(graph, source, sink).flow
        left.data[left.data < 0] = 0
        left.eliminate_zeros()
        reached = np.zeros(self.count + 2, dtype=bool)
        reached[breadth_first_order(left, source, return_predecessors=False)] = True
        holding = np.flatnonzero(reached[a] != reached[b]).tolist()
        return holding, set(np.flatnonzero(reached[: self.count]).tolist())
