"""What is believed of scans of places that have copies: whole pairs, and the network over them."""

from itertools import combinations

import numpy as np
import pytest
from benchmarks.bound import information, scan_cells
from benchmarks.truth import left_error, normalised_square

from support.places import bent_room, turned_hall
from support.visits import SCANNER, linked, solved, truth, visit
from trihedral.geometry.se3 import distance, inverse
from trihedral.model.link import LinkVerdict
from trihedral.model.station import StationStatus
from trihedral.simulate.tracer import Tracer


@pytest.fixture(scope="module")
def bare():
    """Scans of one room that note nothing of its appearance; the alcove is out of sight of the third."""
    room = bent_room()
    places = [(5.6, 4.6, 20), (5.0, 3.0, 200), (1.8, 2.6, -50), (3.2, 2.4, 100)]
    return [visit(f"r{k}", room, *place) for k, place in enumerate(places)]


@pytest.fixture(scope="module")
def bare_links(bare):
    return {(a.name, b.name): linked(a, b) for a, b in combinations(bare, 2)}


@pytest.fixture(scope="module")
def hall():
    """A scan in colour, one in intensity after a crate was moved, and one in both, which ties the other two."""
    before, after = turned_hall(moved=False), turned_hall(moved=True)
    return (
        visit("color", before, -2.2, -1.0, 10, ("color",)),
        visit("intensity", after, 1.3, 0.7, 50, ("intensity",)),
        visit("both", after, 0.3, -1.5, -100, ("color", "intensity")),
    )


@pytest.fixture(scope="module")
def two_ways(hall):
    """The pair whose appearance cannot be compared: it fits in two ways, and the crate speaks for the wrong one."""
    return linked(hall[0], hall[1])


def poses_of(link):
    """The one that it has, then the others that it may have."""
    return [link.transform, *(rival.transform for rival in link.alternatives)]


def among(poses, pose):
    """Numbers of the poses that are the given one, to 2 mm."""
    return [k for k, other in enumerate(poses) if distance(pose, other)[0] < 0.002]


def test_a_copy_of_a_room_is_not_tied_where_a_closet_stands_in_space_that_was_seen_empty(bare, bare_links):
    # The third scan does not see where the closet stands, so it cannot tell the copy from its own room.
    room, names = bare[:3], [v.name for v in bare[:3]]
    copy = visit("copy", bent_room(closet=True), 5.2, 4.0, 70)
    across = [linked(one, copy) for one in room]
    assert [link.verdict for link in across] == [
        LinkVerdict.DOUBTFUL, LinkVerdict.DOUBTFUL, LinkVerdict.ACCEPTED
    ]  # fmt: skip
    assert all("of the building's surfaces stand" in link.reason for link in across[:2])
    result = solved([*room, copy], [*(bare_links[pair] for pair in combinations(names, 2)), *across])
    *statuses, of_copy = [station.status for station in result.stations]
    assert statuses == [StationStatus.VERIFIED] * 3
    assert of_copy is StationStatus.NOT_PLACED
    assert not any(link.accepted for link in result.links[-3:]), "loops do not take back what was seen empty"


def test_loops_verify_nothing_in_a_job_that_has_copies_where_the_appearance_is_unknown(
    bare, bare_links, hall, two_ways
):
    room = bare[:3]
    links = [bare_links[pair] for pair in combinations([v.name for v in room], 2)]
    assert all(station.status is StationStatus.VERIFIED for station in solved(room, links).stations)
    stations = solved([*room, *hall[:2]], [*links, two_ways]).stations[:3]
    assert all(station.pose is not None for station in stations)
    assert not any(station.status is StationStatus.VERIFIED for station in stations)
    assert all("fit in copies of a place" in station.reason for station in stations)


def test_a_room_of_the_same_shape_with_other_pictures_is_refused_for_its_appearance():
    room, other = bent_room(), bent_room(pictures=1)
    here, again, there = (
        visit(name, place, x, y, heading, ("color",))
        for name, place, x, y, heading in (
            ("here", room, 5.6, 4.6, 20), ("again", room, 3.2, 2.4, 100), ("there", other, 5.2, 4.0, 70)
        )
    )  # fmt: skip
    same, another = linked(here, again), linked(here, there)
    assert same.accepted and same.appearance_similarity > 0.8
    assert another.verdict is LinkVerdict.REFUSED
    assert "do not look the same" in another.reason and another.appearance_similarity < 0.2
    # But for the appearance, nothing speaks against it.
    assert distance(another.transform, truth(here, there))[0] < 0.001
    assert another.free_space_conflict < 0.01


def test_a_room_that_is_a_copy_but_for_a_poster_is_refused():
    room, other = bent_room(), bent_room(poster=True)
    here, again, there = (
        visit(name, place, x, y, heading, ("color",))
        for name, place, x, y, heading in (
            ("here", room, 5.6, 4.6, 20), ("again", room, 3.2, 2.4, 100), ("there", other, 3.2, 2.4, 100)
        )
    )  # fmt: skip
    assert linked(here, again).accepted
    copy = linked(here, there)
    assert copy.verdict is LinkVerdict.REFUSED
    assert "small places differ in colour" in copy.reason and copy.appearance_similarity > 0.8


def test_loops_choose_the_right_pose_of_a_pair_that_fits_in_two_ways(hall, two_ways):
    one, other, both = hall
    right = truth(one, other)
    assert two_ways.verdict is LinkVerdict.AMBIGUOUS
    assert among(poses_of(two_ways), right) == [1], "the wrong one seems likelier"
    result = solved(hall, [two_ways, linked(one, both), linked(other, both)])
    chosen = result.links[0]
    assert [link.accepted for link in result.links] == [True] * 3
    assert among(poses_of(chosen), right) == [0]
    poses = [station.pose for station in result.stations]
    assert distance(inverse(poses[1]) @ poses[0], right)[0] < 0.001


def test_sigmas_of_pairs_go_with_their_errors_and_with_what_the_points_allow(bare, bare_links):
    tracer = Tracer(bent_room())
    cells = {v.name: scan_cells(SCANNER, tracer, v.pose, v.measured.xyz, v.measured.intensity) for v in bare}
    squares, excess = [], []
    for a, b in combinations(bare, 2):
        link = bare_links[a.name, b.name]
        error = left_error(truth(a, b), link.transform)
        squares.append(normalised_square(error, link.covariance) / 6)
        bound = information(cells[a.name], cells[b.name], inverse(b.pose))
        excess.append(np.trace(link.covariance @ bound) / 6)
    # Errors of surfels that err together are counted beside those that do not: about half is what to expect.
    assert 0.2 < np.mean(squares) < 1.0
    # No unbiased method is below 1.
    assert 1.0 < np.sqrt(np.mean(excess)) < 3.0
