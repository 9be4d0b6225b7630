"""Stations that links connect."""

from collections.abc import Sequence
from dataclasses import dataclass

from trihedral.network.graph.connectivity import components
from trihedral.network.graph.edge import Edge


@dataclass(frozen=True)
class Component:
    """A connected component; the largest has number 0."""

    number: int
    stations: list[int]
    edges: list[Edge]


def connected(count: int, edges: Sequence[Edge]) -> list[Component]:
    """Split `count` stations and the edges between them, the largest component first."""
    found = [
        Component(number, stations, [])
        for number, stations in enumerate(components(count, [edge.ends for edge in edges]))
    ]
    component_of = {station: component for component in found for station in component.stations}
    for edge in edges:
        component_of[edge.a].edges.append(edge)
    return found
