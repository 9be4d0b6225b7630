"""A street of random walls whose stations see some metres of it, and a job that answers out of the truth."""

from dataclasses import dataclass

import numpy as np

from support.links import link
from trihedral.geometry.se3 import inverse, rotation_about_z
from trihedral.initial.plan.descriptor import (
    CELL,
    CHANNELS,
    FACINGS,
    SIDE,
    PlanDescriptor,
)
from trihedral.model.link import LinkVerdict
from trihedral.model.pairs import PairHistory, PairPreview, PairRequest
from trihedral.network.candidates.options import CandidateOptions
from trihedral.network.candidates.search import CandidateSearch

SEEN = 14.0  # metres that a station sees


STEP = 7.0  # metres from one to the next


@dataclass(frozen=True)
class Header:
    scanner_origin: np.ndarray


@dataclass(frozen=True)
class Place:
    name: str
    content: str
    header: Header
    descriptor: PlanDescriptor
    pose: np.ndarray  # street_from_station


def street(count: int, seed: int = 3) -> list[Place]:
    """Stations in a row, each turned its own way, names without meaning."""
    rng = np.random.default_rng(seed)
    walls = np.column_stack(
        [rng.uniform(-SEEN, STEP * count + SEEN, 40 * count), rng.uniform(-SEEN, SEEN, 40 * count)]
    )
    facing = rng.integers(0, FACINGS, len(walls))
    names = rng.permutation([f"scan {k:03d}" for k in range(count)])
    places = []
    for k in range(count):
        here = np.array([STEP * k, 0.0])
        yaw = rng.uniform(-np.pi, np.pi)
        quarter = int(rng.integers(4))
        # Walls lie along the axes of the street: a plan is turned to them, to within quarters.
        plan_from_street = rotation_about_z(quarter * np.pi / 2)
        offset = (walls - here) @ plan_from_street[:2, :2].T
        near = np.linalg.norm(offset, axis=1) < SEEN
        cells = np.floor(offset[near] / CELL).astype(int) + SIDE // 2
        plan = np.zeros((CHANNELS, SIDE, SIDE), dtype=np.int8)
        plan[(facing[near] + quarter) % FACINGS, cells[:, 0], cells[:, 1]] = 1
        pose = np.eye(4)
        pose[:3, :3] = rotation_about_z(yaw)
        pose[:2, 3] = here
        origin = rng.uniform(-1, 1, 3)
        moved = np.eye(4)
        moved[:3, 3] = -origin
        descriptor = PlanDescriptor(plan, plan_from_street @ pose[:3, :3])
        places.append(
            Place(str(names[k]), f"content {k * 7919 % 1000}", Header(origin), descriptor, pose @ moved)
        )
    return sorted(places, key=lambda place: place.name)


def overlap(a: Place, b: Place) -> bool:
    return abs(scanner(a)[0] - scanner(b)[0]) < 2.5 * STEP


def scanner(place: Place) -> np.ndarray:
    return (place.pose @ np.append(place.header.scanner_origin, 1.0))[:3]


@dataclass
class Job:
    """Answers for a search out of the truth."""

    places: list[Place]
    blind: frozenset[str] = frozenset()  # previews of these find nothing
    lost: frozenset[str] = frozenset()  # no link of these is accepted

    def run(self, options: CandidateOptions) -> tuple[list[list[PairRequest]], PairHistory]:
        by_name = {place.name: place for place in self.places}
        search, links, previews, rounds = CandidateSearch(options), {}, {}, []
        while wanted := search(self.places, PairHistory(list(links.values()), previews)):
            rounds.append(wanted)
            for want in wanted:
                a, b = by_name[want.a], by_name[want.b]
                assert (want.a, want.b) not in links
                shared = overlap(a, b)
                if want.preview_only:
                    seen = shared and not self.blind & {want.a, want.b}
                    previews[want.a, want.b] = PairPreview(0.4 if seen else 0.0, None, 0.1)
                else:
                    accepted = shared and not self.lost & {want.a, want.b}
                    links[want.a, want.b] = link(
                        want.a,
                        want.b,
                        inverse(b.pose) @ a.pose,
                        verdict=LinkVerdict.ACCEPTED if accepted else LinkVerdict.REFUSED,
                    )
        return rounds, PairHistory(list(links.values()), previews)
