"""Worst first: the order in which links and loops are shown."""

import math
from collections.abc import Mapping
from typing import Any

Entry = Mapping[str, Any]


def used_links(document: Entry) -> list[Entry]:
    """List the accepted links, largest 95th percentile first; one without that figure counts as largest."""
    return sorted((link for link in document["links"] if link["accepted"]), key=_badness, reverse=True)


def unused_links(document: Entry) -> list[Entry]:
    """List the links that were not accepted: ambiguous, doubtful, refused."""
    order = {"ambiguous": 0, "doubtful": 1, "refused": 2}
    return sorted(
        (link for link in document["links"] if not link["accepted"]), key=lambda k: order[k["verdict"]]
    )


def _badness(link: Entry) -> tuple[float, float]:
    p95, weakest = link.get("p95_m"), weakest_sigma(link)
    return (math.inf if p95 is None else p95, math.inf if weakest is None else weakest)


def weakest_sigma(link: Entry) -> float | None:
    """Sigma of the translation that the link knows least, metres; None where it was not computed."""
    weakest = link.get("weakest_direction")
    sigma = None if weakest is None else weakest.get("sigma_m")
    return None if sigma is None else float(sigma)


def loops_worst_first(document: Entry) -> list[Entry]:
    """List the loops: those that do not close first, then by how far they miss their start."""
    return sorted(document["loops"], key=lambda loop: (loop["ok"], -(loop["translation_m"] or 0.0)))


def percentile(values: list[float], share: float) -> float:
    """Smallest value that at least `share` of the values do not exceed; no interpolation."""
    return sorted(values)[max(0, math.ceil(share * len(values)) - 1)]
