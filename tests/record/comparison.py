"""Where two outcomes of a job differ: in any bit, or by more than another processor explains."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from tests.record.outcome import ASIDE, PLACES, Entry

#: What poses may differ by on another processor.
NEAR_M = 1e-4
NEAR_RAD = math.radians(1e-3)


def changes(recorded: Entry, now: Entry, *, aside: bool = False) -> list[str]:
    """Say each thing that is not the same, the input first.

    Parameters
    ----------
    aside
        Also words and evidence, which change when things get other names.
    """
    dropped = (PLACES,) if aside else (PLACES, ASIDE)
    old, new = ({key: value for key, value in e.items() if key not in dropped} for e in (recorded, now))
    return list(_differences("", old, new))


def _differences(place: str, old: Any, new: Any) -> Iterator[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *(key for key in new if key not in old)]:
            inside = f"{place} / {key}" if place else key
            if key not in new:
                yield f"{inside}: no longer there"
            elif key not in old:
                yield f"{inside}: was not there"
            else:
                yield from _differences(inside, old[key], new[key])
    elif old != new:
        yield f"{place}: {old} is now {new}"


def departures(recorded: Entry, now: Entry) -> list[str]:
    """Say which verdicts differ, and which poses by more than a tenth of a millimetre or a thousandth of a degree."""
    found = list(_differences("", _verdicts(recorded), _verdicts(now)))
    placed, placed_now = (entry.get(PLACES, {}) for entry in (recorded, now))
    for name in placed.keys() & placed_now.keys():
        a, b = np.array(placed[name]), np.array(placed_now[name])
        metres = float(np.linalg.norm(a[:, 3] - b[:, 3]))
        # The chord between two rotations tells small angles better than the trace does.
        chord = float(np.linalg.norm(a[:, :3] - b[:, :3])) / math.sqrt(8.0)
        radians = 2.0 * math.asin(min(1.0, chord))
        if metres > NEAR_M or radians > NEAR_RAD:
            found.append(f"{name}: {1e3 * metres:.3f} mm and {math.degrees(radians):.4f} degrees away")
    return found


def _verdicts(entry: Entry) -> Entry:
    """Give what holds on any processor."""
    return {
        "exit": entry.get("exit"),
        "placed": sorted(entry.get(PLACES, {})),
        "stations": {name: [s["status"], s["part"]] for name, s in entry.get("stations", {}).items()},
        "links": {name: [k["verdict"], k["method"]] for name, k in entry.get("links", {}).items()},
        "loops": {name: loop["ok"] for name, loop in entry.get("loops", {}).items()},
        "trials": {name: [t["method"], t["verdict"]] for name, t in entry.get("trials", {}).items()},
    }
