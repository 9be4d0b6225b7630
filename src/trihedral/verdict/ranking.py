"""Worst first: the order in which links and loops are shown."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

Entry = Mapping[str, Any]

# Times that loops may miss more than expected before the sigmas are called too small.
SIGMAS_TOO_SMALL = 2.0


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


def checked_worst_first(document: Entry) -> list[Entry]:
    """List the links that the adjustment checked, largest standardised residual first; unchecked ones last."""
    checked = [link for link in document["links"] if link.get("network")]
    return sorted(checked, key=lambda link: link["network"]["standardised"] or -1.0, reverse=True)


def control_worst_first(document: Entry) -> list[Entry]:
    """List the residuals of control points: checks first, the largest standardised one at the top of either."""
    return sorted(document.get("control") or [], key=lambda miss: (not miss["check"], -miss["standardised"]))


def passed_over_first_missed(document: Entry) -> list[Entry]:
    """List the pairs that were previewed and not registered, the highest score first.

    Those that could have tied a scan or a part that the result leaves apart come before all others.
    """
    part = {s["name"]: s["component"] for s in document["stations"] if s["pose"] is not None}

    def together(preview: Entry) -> bool:
        ends = part.get(preview["from"]), part.get(preview["to"])
        return ends[0] is not None and ends[0] == ends[1]

    previews = [
        {**k, "together": together(k)} for k in document.get("looks") or () if k["decision"] != "registered"
    ]
    return sorted(previews, key=lambda k: (k["together"], -(k["score"] or 0.0)))


def loop_factor(document: Entry) -> float | None:
    """By how many times loops miss more than their links' covariances lead one to expect, root mean square.

    About 1 where the sigmas are honest; None without loops. Loops that share links say partly the same.
    """
    return _root_mean_square(document["loops"])


def loop_factors(document: Entry) -> dict[frozenset[str], float]:
    """Give the same for the loops that each link takes part in: the link that spoils loops stands out."""
    through: dict[frozenset[str], list[Entry]] = {}
    for loop in document["loops"]:
        for pair in loop_pairs(loop["stations"]):
            through.setdefault(pair, []).append(loop)
    factors = {pair: _root_mean_square(loops) for pair, loops in through.items()}
    return {pair: factor for pair, factor in factors.items() if factor is not None}


def loop_pairs(stations: Sequence[str]) -> set[frozenset[str]]:
    """List the pairs that a loop walks through, whether or not its start is repeated at its end."""
    walk = [*stations, stations[0]] if stations else []
    return {frozenset(pair) for pair in itertools.pairwise(walk) if pair[0] != pair[1]}


def _root_mean_square(loops: Sequence[Entry]) -> float | None:
    pairs = [(loop["translation_m"], loop.get("expected_translation_m")) for loop in loops]
    ratios = [missed / expected for missed, expected in pairs if missed is not None and expected]
    return math.sqrt(math.fsum(ratio**2 for ratio in ratios) / len(ratios)) if ratios else None


def scaled_sigma(document: Entry, station: Entry) -> tuple[float, float, float] | None:
    """Sigmas of a station's position, metres, enlarged where loops show that they are too small."""
    sigma = station.get("sigma_translation_m")
    factor = max(1.0, loop_factor(document) or 1.0)
    return None if sigma is None else (factor * sigma[0], factor * sigma[1], factor * sigma[2])


def percentile(values: list[float], share: float) -> float:
    """Smallest value that at least `share` of the values do not exceed; no interpolation."""
    return sorted(values)[max(0, math.ceil(share * len(values)) - 1)]
