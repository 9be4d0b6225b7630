"""The order in which pairs are visited: few scans are loaded."""

from collections import OrderedDict

import numpy as np

from trihedral.network.visiting_order import HELD, visiting_order


def loads(pairs: list[tuple[int, int]], held: int) -> int:
    """How often a memory that forgets what was not used for longest has to load a scan."""
    memory: OrderedDict[int, None] = OrderedDict()
    count = 0
    for pair in pairs:
        for scan in pair:
            count += scan not in memory
            memory[scan] = None
            memory.move_to_end(scan)
            if len(memory) > held:
                memory.popitem(last=False)
    return count


def neighbours(count: int, near: int, seed: int) -> list[tuple[int, int]]:
    """Pairs of stations near each other in a plane; numbers say nothing of places."""
    places = np.random.default_rng(seed).uniform(0, 1, (count, 2))
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    return sorted(
        {tuple(sorted((i, int(j)))) for i in range(count) for j in np.argsort(apart[i])[1 : near + 1]}
    )


def test_every_pair_is_visited_once() -> None:
    pairs = neighbours(60, 4, 0)
    assert sorted(visiting_order(pairs)) == list(range(len(pairs)))
    assert visiting_order([]) == []


def test_stations_are_loaded_little_more_than_once() -> None:
    pairs = neighbours(100, 4, 1)
    in_order = [pairs[index] for index in visiting_order(pairs)]
    assert loads(in_order, HELD) < 140
    assert loads(pairs, HELD) > 250  # so that the bound above says something


def test_cost_grows_with_the_number_of_stations_and_not_faster() -> None:
    a_hundred, four_hundred = (
        loads([pairs[index] for index in visiting_order(pairs)], HELD)
        for pairs in (neighbours(100, 4, 2), neighbours(400, 4, 2))
    )
    assert four_hundred < 5 * a_hundred
