"""The verdict on a whole job, and with it the exit code."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from trihedral.verdict.profile import Profile
from trihedral.verdict.ranking import loop_pairs, scaled_sigma

Exit = Literal[0, 3, 4]

# Sigmas that a control point may be off: of a thousand points one or two are by chance, in one of three axes.
CONTROL_SIGMAS = 3.5


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What a person reads first."""

    exit: Exit
    #: One line.
    text: str
    profile: Profile
    #: Each thing that keeps the exit code from 0, one line.
    problems: tuple[str, ...]


def judge(document: Mapping[str, Any], profile: Profile) -> Verdict:
    """Decide between exit 0 (passed), 3 (scans missing or ambiguous) and 4 (tolerance not kept).

    A scan that could not be read is missing. So is one that hangs together only with others apart from the
    main group: its pose is not in the project frame. A loop of accepted links that does not close breaks
    every profile but "none".
    """
    missing, broken = _missing(document), _broken(document, profile)
    stations = document["stations"]
    total = len(stations) + len(document.get("failures", ()))
    scans = "1 scan" if total == 1 else f"{total} scans"
    single = [s["name"] for s in stations if s["status"] == "single-linked"]
    held = f"; held by one path of links only: {_names(single)}" if single and total > 1 else ""
    if missing:
        placed = total - len(missing)
        text = f"INCOMPLETE: {placed} of {scans} placed; missing: {_names([name for name, _ in missing])}"
        if broken:
            text += f"; and tolerance profile {profile.name} is not met"
        text += held
        problems = (*(f"{name}: {reason}" for name, reason in missing), *broken)
        return Verdict(3, text, profile, problems)
    if broken:
        noun = "1 problem" if len(broken) == 1 else f"{len(broken)} problems"
        text = f"TOLERANCE NOT MET: all {scans} placed; {noun} with profile {profile.name} ({profile.text})"
        text += held
        return Verdict(4, text, profile, tuple(broken))

    if total == 1:
        text = "PASSED: 1 scan; it defines the frame, nothing could be checked against it"
    else:
        text = f"PASSED: all {scans} placed, tolerance profile {profile.name} met ({profile.text}){held}"
    return Verdict(0, text, profile, ())


def _missing(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Name and reason of every scan that has no trusted pose in the project frame."""
    missing = []
    for station in document["stations"]:
        name, reason = station["name"], station["reason"]
        if station["status"] == "not-placed" or station["pose"] is None:
            missing.append((name, f"not placed ({reason or 'no reason recorded'})"))
        elif station["status"] == "ambiguous":
            missing.append((name, f"ambiguous ({reason or 'two poses explain the data nearly as well'})"))
        elif station["component"] not in (0, None):
            missing.append(
                (name, f"placed only within separate group {station['component']}, not with the main one")
            )
    for failure in document.get("failures", ()):
        scan = "" if failure["scan_index"] is None else f" (scan {failure['scan_index'] + 1})"
        missing.append((f"{failure['path']}{scan}", f"not read ({failure['reason']})"))
    return missing


def _broken(document: Mapping[str, Any], profile: Profile) -> list[str]:
    """Every limit of the profile that is not kept."""
    broken = []
    accepted = [link for link in document["links"] if link["accepted"]]
    for link in accepted:
        if link["method"] == "given":
            continue  # a person vouches for it; there is no fit to judge
        problem = profile.link_problem(link.get("p90_m"), link.get("p95_m"))
        if problem:
            broken.append(f"link {link['from']} - {link['to']}: {problem}")
    for station in document["stations"]:
        # A scan on its own has no uncertainty: it defines the frame.
        problem = profile.station_problem(scaled_sigma(document, station)) if station["tied"] else None
        if problem:
            broken.append(f"scan {station['name']}: {problem}")
    for miss in document.get("control") or ():
        if profile.name != "none" and miss["standardised"] > CONTROL_SIGMAS:
            apart = 1e3 * max(map(abs, miss["residual_m"]))
            what = "check" if miss["check"] else "control"
            broken.append(
                f"{what} point {miss['point']}, as {miss['station']} shows it, is off by {apart:.1f} mm in one axis, "
                f"{miss['standardised']:.1f} times its sigma"
            )
    if profile.name != "none":
        pairs = {frozenset((link["from"], link["to"])) for link in accepted}
        broken += [
            f"loop {' - '.join(loop['stations'])} misses its start by {loop['translation_m'] * 1e3:.1f} mm"
            for loop in document["loops"]
            if not loop["ok"] and loop_pairs(loop["stations"]) <= pairs
        ]
    return broken


def _names(names: Sequence[str]) -> str:
    shown = ", ".join(names[:5])
    return shown if len(names) <= 5 else f"{shown} and {len(names) - 5} more"
