"""The names that scans have in a job, for those that constraints call them by."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from trihedral.errors import InputError
from trihedral.model.station import Station
from trihedral.network.constraints.constraints import Constraints, UserPair


def resolve(constraints: Constraints, stations: Iterable[Station]) -> Constraints:
    """Give the scans of the constraints the names that they have in the job; a file's name stands for its scan."""
    names = {s.name: (s.header.source.name, s.header.source.stem, s.header.name) for s in stations}
    return resolved(constraints, names)


def resolved(constraints: Constraints, names: Mapping[str, Sequence[str]]) -> Constraints:
    """Give the scans that the constraints speak of the names that they have in the job.

    Parameters
    ----------
    names
        Of each station of the job: its name, and what else it may be called by.

    Raises
    ------
    InputError
        A scan is not in the job, or a name stands for several; the message gives the nearest name.
    """
    called: dict[str, set[str]] = {}
    for name, others in names.items():
        for other in others:
            called.setdefault(other, set()).add(name)

    def name_of(given: str, place: str) -> str:
        meant = {given} if given in names else called.get(given, set())
        if len(meant) == 1:
            return meant.pop()
        source = constraints.source or "constraints"
        if meant:
            several = ", ".join(sorted(meant))
            raise InputError(source, f"{given!r} stands for several scans: {several}", place=place)
        raise InputError(
            source, f"no scan is called {given!r}", place=place, advice=nearest(given, names, "Scans are")
        )

    def pairs(kind: str) -> tuple[UserPair, ...]:
        return tuple(
            replace(
                pair,
                from_station=name_of(pair.from_station, f"{kind}[{number}].from"),
                to_station=name_of(pair.to_station, f"{kind}[{number}].to"),
            )
            for number, pair in enumerate(getattr(constraints, kind), start=1)
        )

    level, control = constraints.level, constraints.control
    if level is not None and level.stations is not None:
        level = replace(level, stations=tuple(name_of(name, "level.stations") for name in level.stations))
    here = called.keys() | names.keys()
    fixed = [one for one in constraints.fixed if one.station in here or one.needed]
    measured = (replace(m, station=name_of(m.station, "control.measurements")) for m in control.measurements)
    return replace(
        constraints,
        level=level,
        fixed=tuple(replace(one, station=name_of(one.station, "fixed")) for one in fixed),
        forced=pairs("forced"),
        forbidden=pairs("forbidden"),
        locked=pairs("locked"),
        control=replace(control, measurements=tuple(measured)),
    )


def nearest(name: str, known: Iterable[str], intro: str) -> str:
    """Advice that gives the known name most like one that is not known, or the first few."""
    known = list(known)
    near = difflib.get_close_matches(name, known, 1)
    return f"Is it {near[0]}?" if near else f"{intro} {', '.join(known[:8])}"
