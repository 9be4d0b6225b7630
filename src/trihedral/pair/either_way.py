"""Pairs of scans of which one may be upside down: a scanner that hangs beside one that stands."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trihedral.model.link import LinkVerdict, PairResult
from trihedral.scan.prepared import Prepared


def either_way_up(
    a: Prepared, b: Prepared, register: Callable[[Prepared, Prepared], PairResult], least: float
) -> PairResult:
    """Register a pair as its scans are mounted and, if that leads nowhere, with one of them turned over.

    `least` is the probability from which a pose with one scan turned over is believed, against the one without: a scan
    that may hang hangs as often as not, since hardly any that stands looks so.
    """
    found = register(a, b)
    over = turned_over(a, b)
    if over is None or found.verdict in (LinkVerdict.ACCEPTED, LinkVerdict.AMBIGUOUS):
        return found
    other = register(*over)
    seconds = {step: spent + other.seconds.get(step, 0.0) for step, spent in found.seconds.items()}
    against = 0.0 if found.verdict is LinkVerdict.REFUSED else _odds(found)
    for_it = _odds(other)
    believed = other.verdict is LinkVerdict.ACCEPTED and for_it / (1.0 + for_it + against) >= least
    return replace(other if believed else found, seconds=seconds)


def turned_over(a: Prepared, b: Prepared) -> tuple[Prepared, Prepared] | None:
    """The pair with one of its scans upside down; None where both are known to stand."""
    if a.mounting.either_way:
        return a.turned_over, b
    return (a, b.turned_over) if b.mounting.either_way else None


def _odds(result: PairResult) -> float:
    probability = 0.0 if result.evidence is None else result.evidence.probability or 0.0
    return probability / max(1.0 - probability, float(np.finfo(np.float64).tiny))
