"""What is decided of the links of a job: rules take one state and give the next."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import distance, inverse
from trihedral.model.link import Link, LinkVerdict
from trihedral.model.station import Station
from trihedral.network.adjustment.adjustment import adjust
from trihedral.network.adjustment.systematic import Systematic
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.decision.loop_closure import LoopClosure
from trihedral.network.graph.component import Component, connected
from trihedral.network.graph.scanner_frames import between_scanners
from trihedral.network.options import NetworkOptions


@dataclass(frozen=True)
class ComponentPose:
    """A scanner's adjusted pose in the frame of its connected component."""

    component: int
    pose: Float64


@dataclass(frozen=True)
class NetworkState:
    """The links of a job while they are judged together."""

    stations: tuple[Station, ...]
    #: Each with the verdict that it has so far; rules speak of them by their numbers.
    links: tuple[Link, ...]
    options: NetworkOptions
    #: Stations whose pose is given, ``project_from_station``.
    fixed: Mapping[int, Float64]
    #: What all links err by beside what their own covariances say.
    systematic: Systematic
    #: Whether the place has copies of rooms or storeys, since a pair's scans fit in two ways: ones whose appearance
    #: could not be compared, and ones that look the same.
    has_copies: bool
    has_lookalikes: bool
    #: Which of the accepted links agree with each other, as `close_loops` found last.
    loops: LoopClosure = field(default_factory=LoopClosure)
    #: Links of which nobody can tell whether they are right.
    given_up: frozenset[int] = frozenset()
    #: Links that loops gave another pose than their scans make likely.
    outvoted: frozenset[int] = frozenset()

    @classmethod
    def initial(
        cls,
        stations: Sequence[Station],
        links: Sequence[Link],
        options: NetworkOptions,
        constraints: Constraints,
    ) -> Self:
        """Links as their pairs and the person left them; the constraints name stations as the job does."""
        number = {station.name: index for index, station in enumerate(stations)}
        return cls(
            tuple(stations),
            tuple(links),
            options,
            {number[fixed.station]: np.array(fixed.pose) for fixed in constraints.fixed},
            options.systematic,
            any(link.verdict is LinkVerdict.AMBIGUOUS and link.unseen for link in links),
            any(link.verdict is LinkVerdict.AMBIGUOUS and link.looks_alike for link in links),
        )

    @cached_property
    def number(self) -> dict[str, int]:
        """Of each station, by its name."""
        return {station.name: index for index, station in enumerate(self.stations)}

    @cached_property
    def link_at(self) -> dict[tuple[int, int], int]:
        """Number of the link between two stations."""
        return {self.ends(link): index for index, link in enumerate(self.links)}

    @cached_property
    def components(self) -> list[Component]:
        """What links that agree connect."""
        return connected(len(self.stations), self.loops.kept)

    @cached_property
    def poses(self) -> dict[int, ComponentPose]:
        """Of each station that a link connects, as links that agree put it."""
        poses: dict[int, ComponentPose] = {}
        for component in self.components:
            if len(component.stations) > 1:
                adjusted = adjust(component.stations[0], component.edges, poses_only=True).poses
                poses |= {
                    station: ComponentPose(component.number, pose) for station, pose in adjusted.items()
                }
        return poses

    def ends(self, link: Link) -> tuple[int, int]:
        """Numbers of its stations."""
        return self.number[link.from_station], self.number[link.to_station]

    def between_scanners(self, link: Link, pose: Float64) -> Float64:
        """A pose of the link, between scanner-centred frames."""
        a, b = self.ends(link)
        return between_scanners(pose, self.stations[a], self.stations[b])

    def offset(self, a: int, b: int, b_from_a: Float64) -> tuple[float, float] | None:
        """How far a pose between scanners is from what `poses` say (m, rad); None if they say nothing of it."""
        at_a, at_b = self.poses.get(a), self.poses.get(b)
        if at_a is None or at_b is None or at_a.component != at_b.component:
            return None
        return distance(inverse(at_b.pose) @ at_a.pose, b_from_a)

    def offset_of(self, link: Link) -> tuple[float, float] | None:
        """The same of a link's own pose."""
        if link.transform is None:
            return None
        return self.offset(*self.ends(link), self.between_scanners(link, link.transform))

    def closes(self, offset: tuple[float, float] | None) -> bool:
        """Whether a loop closes by so much whatever is expected of it."""
        limits = self.options.closure
        return within(offset, limits.translation, limits.rotation)

    def with_links(self, links: Mapping[int, Link]) -> Self:
        """Put links in the place of those with their numbers."""
        return replace(self, links=tuple(links.get(index, link) for index, link in enumerate(self.links)))


def within(offset: tuple[float, float] | None, translation: float, rotation: float) -> bool:
    """Whether an offset is known and no larger than the limits."""
    return offset is not None and offset[0] <= translation and offset[1] <= rotation


@dataclass(frozen=True)
class RuleOutcome:
    """What a rule leaves: the same state if it has nothing to change, and why stations are in doubt, by number."""

    state: NetworkState
    doubts: Mapping[int, str] = field(default_factory=dict)
    #: Those of them that may as well stand in a copy of their place: no loop can tell.
    in_copies: frozenset[int] = frozenset()


Rule = Callable[[NetworkState], RuleOutcome]
