"""The short summary for standard output: verdict, worst link, worst loop, P95, then means."""

import math
from collections.abc import Mapping
from typing import Any

from trihedral.errors import printable
from trihedral.verdict.ranking import (
    SIGMAS_TOO_SMALL,
    control_worst_first,
    loop_factor,
    loops_worst_first,
    percentile,
    used_links,
    weakest_sigma,
)

FIT = "fit, not accuracy"
_MOST_PROBLEMS = 12


def summary(document: Mapping[str, Any]) -> str:
    """Say in a few lines what may be believed of a result; worst first, no mean while a scan is missing."""
    verdict = document["verdict"]
    links, loops = used_links(document), loops_worst_first(document)
    lines = [
        verdict["text"],
        _row("worst link", _link(links[0]) if links else "no link was accepted"),
        _row("worst loop", _loop(loops[0]) if loops else "no closed loop of links: nothing checks them"),
    ]
    p95 = [link["p95_m"] for link in links if link.get("p95_m") is not None]
    if p95:
        share = f"95 % of {_count(len(p95), 'link')} have P95 at most {mm(percentile(p95, 0.95))} ({FIT})"
        lines.append(_row("P95", share))
    slack = max(links, key=lambda link: weakest_sigma(link) or 0.0, default=None)
    if slack is not None and weakest_sigma(slack):
        name = f"{slack['from']} - {slack['to']}"
        lines.append(_row("weakest", f"{name}: one direction known to {mm(weakest_sigma(slack))} (1 sigma)"))
    lines += [_row(label, text) for label, text in _control(document)]
    factor = loop_factor(document)
    if factor is not None and factor > SIGMAS_TOO_SMALL:
        lines.append(
            _row("sigmas", f"too small: loops miss by {factor:.1f} times what they lead one to expect")
        )
    if verdict["exit"] == 3:
        lines.append(_row("means", "not given while a scan is missing"))
    else:
        rms = [link["rmse_m"] for link in links if link.get("rmse_m") is not None]
        median = [link["median_m"] for link in links if link.get("median_m") is not None]
        if rms and median:
            text = f"of {_count(len(links), 'link')}: RMS {mm(mean(rms))}, median {mm(mean(median))} ({FIT})"
            lines.append(_row("means", text))
    problems = verdict.get("problems", [])
    lines += [
        _row("problem" if index == 0 else "", text) for index, text in enumerate(problems[:_MOST_PROBLEMS])
    ]
    if len(problems) > _MOST_PROBLEMS:
        lines.append(_row("", f"and {len(problems) - _MOST_PROBLEMS} more, all in report.html"))
    return "\n".join(printable(line) for line in lines)


def mm(metres: float | None) -> str:
    """Millimetres for people; a dash where there is no figure."""
    return "-" if metres is None else f"{metres * 1e3:.1f} mm"


def mean(values: list[float]) -> float:
    """Arithmetic mean, exactly rounded, so that it does not depend on the order."""
    return math.fsum(values) / len(values)


def _row(label: str, text: str) -> str:
    return f"{label:<11} {text}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _link(link: Mapping[str, Any]) -> str:
    figures = (
        f"P95 {mm(link.get('p95_m'))}, RMS {mm(link.get('rmse_m'))}, max {mm(link.get('max_m'))} ({FIT})"
    )
    overlap = link["overlap"]
    if overlap is not None:
        figures += f", overlap {overlap['from']:.2f} and {overlap['to']:.2f}"
    return f"{link['from']} - {link['to']}: {figures}"


def _loop(loop: Mapping[str, Any]) -> str:
    text = f"{' - '.join(loop['stations'])}: misses its start by {mm(loop['translation_m'])}"
    if loop["rotation_deg"] is not None:
        text += f" and {loop['rotation_deg']:.3f} deg"
    if loop.get("expected_translation_m") is not None:
        text += f" (expected {mm(loop['expected_translation_m'])}, 1 sigma)"
    return text if loop["ok"] else f"{text}: DOES NOT CLOSE"


def _control(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Checks first, since they say how accurate the result is; each with its worst point."""
    rows = []
    for check, label in ((True, "checks"), (False, "control")):
        misses = [miss for miss in control_worst_first(document) if miss["check"] is check]
        if misses:
            worst = misses[0]
            size = math.sqrt(math.fsum(value**2 for value in worst["residual_m"]))
            count = _count(len({miss["point"] for miss in misses}), "point")
            rows.append(
                (
                    label,
                    f"{count}; worst {worst['point']}, off by {mm(size)} ({worst['standardised']:.1f} sigma)",
                )
            )
    return rows
