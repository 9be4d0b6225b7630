"""An order of pairs in which few scans have to be loaded: only some are held in memory at once."""

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from typing import TypeVar

T = TypeVar("T", bound=Hashable)

# Prepared scans held in memory at once. With as many, two hundred pairs of a hundred scans load each 1.2 times.
HELD = 8


def visiting_order(pairs: Sequence[tuple[T, T]], held: int = HELD) -> list[int]:
    """Give the indices of the pairs in an order in which pairs that share scans follow each other.

    Pairs whose scans are both held come first; then the scan that has most pairs with those held is taken next. The
    order depends on that of the pairs, and on nothing else.
    """
    left: dict[T, dict[int, None]] = {}
    for index, pair in enumerate(pairs):
        for scan in pair:
            left.setdefault(scan, {})[index] = None
    rank = {scan: place for place, scan in enumerate(left)}
    memory: OrderedDict[T, None] = OrderedDict()
    order: list[int] = []
    while len(order) < len(pairs):
        near = sorted({index for scan in memory for index in left[scan]})
        both = [index for index in near if pairs[index][0] in memory and pairs[index][1] in memory]
        if both:
            chosen = both[0]
        elif near:
            with_held: dict[T, list[int]] = {}
            for index in near:
                a, b = pairs[index]
                with_held.setdefault(a if b in memory else b, []).append(index)
            # Of equals the one that has fewest pairs besides: it is done with sooner.
            scan = min(with_held, key=lambda s: (-len(with_held[s]), len(left[s]), rank[s]))
            chosen = with_held[scan][0]
        else:
            scan = min((s for s in left if left[s]), key=lambda s: (len(left[s]), rank[s]))
            chosen = next(iter(left[scan]))
        for scan in pairs[chosen]:
            left[scan].pop(chosen, None)
            memory[scan] = None
            memory.move_to_end(scan)
            while len(memory) > held:
                memory.popitem(last=False)
        order.append(chosen)
    return order
