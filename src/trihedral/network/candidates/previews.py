"""Pairs to preview."""

from collections.abc import Mapping

import numpy as np

from trihedral.geometry.arrays import Int64
from trihedral.network.candidates.state import Pair, Reasons, SearchState, ordered


def first_previews(state: SearchState) -> Reasons:
    """Each scan with those of the most similar plans."""
    count = state.options.first_previews
    wanted = {
        ordered(i, j): f"its plan is among the {count} most like that of the other"
        for i, others in enumerate(state.ranked)
        for j in others[:count]
    }
    return _new(state, wanted)


def more_previews(state: SearchState) -> Reasons:
    """For each component but the largest, the pairs with the most similar plans that lead out of it.

    Pairs between two components are the less promising the more previews between them found nothing. Of a component of
    several scans those come first whose scans were not yet previewed in vain: the plans of some are like many others.
    """
    options, component = state.options, state.component
    vain = _vain_between(state)
    counts: dict[Pair, int] = {}
    for a, b in vain:
        between = ordered(int(component[a]), int(component[b]))
        counts[between] = counts.get(between, 0) + 1
    vain_of: Int64 = np.bincount(np.array(vain, dtype=np.intp).ravel(), minlength=len(state.stations))
    promise = state.similarity.copy()
    for (p, q), count in counts.items():
        of_p, of_q = np.flatnonzero(component == p), np.flatnonzero(component == q)
        promise[np.ix_(of_p, of_q)] -= options.vain_preview * count
        promise[np.ix_(of_q, of_p)] -= options.vain_preview * count
    for a, b in (*state.previews, *state.links):
        promise[a, b] = promise[b, a] = -np.inf
    wanted: dict[Pair, str] = {}
    for label, left in previews_left(state).items():
        if left <= 0:
            continue
        inside, outside = np.flatnonzero(component == label), np.flatnonzero(component != label)
        leading = promise[np.ix_(inside, outside)]
        # A scan that nothing ties would be lost.
        hopeless = len(inside) > 1 and len(vain) >= options.patience
        least = options.least_promise if hopeless else np.finfo(np.float64).min
        spent = options.vain_preview_of_scan * np.add.outer(vain_of[inside], vain_of[outside])
        order = leading - spent if len(inside) > 1 else leading
        pairs = [
            (order[i, j], ordered(int(inside[i]), int(outside[j]))) for i, j in np.argwhere(leading >= least)
        ]
        pairs.sort(key=lambda item: (-item[0], state.content(item[1])))
        for _, pair in pairs[: min(options.more_previews, left)]:
            wanted[pair] = "nothing ties the part that one of them is in to the largest so far"
    return _new(state, wanted)


def previews_left(state: SearchState) -> dict[int, int]:
    """How many previews each component but the largest may still ask for, by its label."""
    vain = [{int(state.component[a]), int(state.component[b])} for a, b in _vain_between(state)]
    largest = np.bincount(state.component).argmax()
    return {
        int(label): state.options.most_previews
        + int(np.count_nonzero(state.component == label))
        - 1
        - sum(label in between for between in vain)
        for label in np.unique(state.component)
        if label != largest
    }


def _vain_between(state: SearchState) -> list[Pair]:
    """Pairs of two components of which a preview found nothing."""
    return [
        (a, b)
        for (a, b), preview in state.previews.items()
        if state.component[a] != state.component[b] and not state.bears_out(preview)
    ]


def _new(state: SearchState, wanted: Mapping[Pair, str]) -> Reasons:
    return sorted(
        (pair, why) for pair, why in wanted.items() if pair not in state.previews and pair not in state.links
    )
