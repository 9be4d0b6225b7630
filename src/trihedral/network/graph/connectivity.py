"""Stations and links as a graph: components, blocks, trees, triangles; every walk over it is linear in links.

Stations are numbers from 0; `ends` are the two stations of each link.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from trihedral.geometry.arrays import Int64

Ends = Sequence[tuple[int, int]]


def components(count: int, ends: Ends) -> list[list[int]]:
    """Connected components of `count` stations, the largest first, each in order."""
    pairs = np.array(ends, dtype=np.int64).reshape(-1, 2)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, labels = connected_components(links, directed=False)
    groups: dict[int, list[int]] = {}
    for station, label in enumerate(labels.tolist()):
        groups.setdefault(label, []).append(station)
    return sorted(groups.values(), key=lambda group: (-len(group), group))


def component_labels(count: int, ends: Ends) -> Int64:
    """(N,) label of the connected component of each station: its least station."""
    label = np.arange(count)
    for component in components(count, ends):
        label[component] = component[0]
    return label


def blocks(count: int, ends: Ends) -> list[list[int]]:
    """Groups of stations that stay connected whichever single link is taken away, the largest first."""
    single = bridges(count, ends)
    return components(count, [pair for index, pair in enumerate(ends) if index not in single])


def bridges(count: int, ends: Ends) -> dict[int, set[int]]:
    """Links that alone connect their sides, and the stations of one side (Tarjan 1974), without recursion."""
    around = _around(count, ends)
    entered = [-1] * count
    lowest = [0] * count
    single: dict[int, set[int]] = {}
    order: list[int] = []
    for first in range(count):
        if entered[first] >= 0:
            continue
        entered[first] = lowest[first] = len(order)
        order.append(first)
        stack = [(first, -1, iter(around[first]))]
        while stack:
            here, by, rest = stack[-1]
            for there, link in rest:
                if link == by:
                    continue
                if entered[there] >= 0:
                    lowest[here] = min(lowest[here], entered[there])
                    continue
                entered[there] = lowest[there] = len(order)
                order.append(there)
                stack.append((there, link, iter(around[there])))
                break
            else:
                stack.pop()
                if stack:
                    above = stack[-1][0]
                    lowest[above] = min(lowest[above], lowest[here])
                    if lowest[here] > entered[above]:
                        single[by] = set(order[entered[here] :])
    return single


def path(count: int, ends: Ends, start: int, end: int) -> list[int] | None:
    """Numbers of the fewest links that lead from one station to another; None if none do."""
    around = _around(count, ends)
    came: dict[int, tuple[int, int]] = {start: (-1, -1)}
    queue = [start]
    for here in queue:
        if here == end:
            break
        for there, link in around[here]:
            if there not in came:
                came[there] = (here, link)
                queue.append(there)
    if end not in came:
        return None
    found = []
    while end != start:
        end, link = came[end]
        found.append(link)
    return found


class Tree:
    """A spanning forest of the links that come first.

    Attributes
    ----------
    parent, link
        Of each station: the one above it and the link to there; -1 for roots, the first of their components.
    depth
        Links up to the root.
    inside
        For each link, whether it is one of the tree's.
    """

    def __init__(self, count: int, ends: Ends, order: Sequence[int]) -> None:
        label = list(range(count))

        def root(station: int) -> int:
            while label[station] != station:
                label[station] = label[label[station]]
                station = label[station]
            return station

        self.inside = np.zeros(len(ends), dtype=bool)
        for link in order:
            a, b = root(ends[link][0]), root(ends[link][1])
            if a != b:
                label[a] = b
                self.inside[link] = True
        chosen = [link for link in range(len(ends)) if self.inside[link]]
        around = _around(count, [ends[link] for link in chosen])
        self.parent = np.full(count, -1)
        self.link = np.full(count, -1)
        self.depth = np.zeros(count, dtype=np.int64)
        seen = np.zeros(count, dtype=bool)
        for first in range(count):
            if seen[first]:
                continue
            seen[first] = True
            queue = [first]
            for here in queue:
                for there, index in around[here]:
                    if not seen[there]:
                        seen[there] = True
                        self.parent[there], self.link[there] = here, chosen[index]
                        self.depth[there] = self.depth[here] + 1
                        queue.append(there)

    def meeting(self, a: Int64, b: Int64) -> Int64:
        """The stations (N,) where the ways up from two stations of one component meet, for many at once."""
        a, b = a.copy(), b.copy()
        while (apart := np.flatnonzero(a != b)).size:
            deeper = self.depth[a[apart]] >= self.depth[b[apart]]
            a[apart[deeper]] = self.parent[a[apart[deeper]]]
            b[apart[~deeper]] = self.parent[b[apart[~deeper]]]
        return a

    def walk(self, start: int, end: int) -> list[int]:
        """Stations from one to another of the same component, both included."""
        up, down = [start], [end]
        while up[-1] != down[-1]:
            if self.depth[up[-1]] >= self.depth[down[-1]]:
                up.append(int(self.parent[up[-1]]))
            else:
                down.append(int(self.parent[down[-1]]))
        return up + down[-2::-1]


def triangles(ends: Ends) -> Int64:
    """Every three stations with a link between each two, (N, 3) in order; links at most once a pair."""
    neighbours: dict[int, set[int]] = {}
    for a, b in ends:
        neighbours.setdefault(a, set()).add(b)
        neighbours.setdefault(b, set()).add(a)
    found = []
    for a, b in ends:
        low, high = min(a, b), max(a, b)
        found += [(low, high, c) for c in neighbours[a] & neighbours[b] if c > high]
    return np.array(sorted(found), dtype=np.int64).reshape(-1, 3)


def _around(count: int, ends: Ends) -> list[list[tuple[int, int]]]:
    """For each station, the stations beside it and the links to them."""
    around: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for link, (a, b) in enumerate(ends):
        around[a].append((b, link))
        around[b].append((a, link))
    return around
