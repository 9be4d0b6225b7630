"""What jobs gave when the record was made, they give now: to the bit, or to what another processor explains.

The jobs that take seconds; `python -m tests.record --check` runs all, and its docstring says what is kept and when the
record is made anew.
"""

import copy
import json
from collections.abc import Callable
from typing import Any

import pytest
from tests.record.__main__ import RECORD
from tests.record.comparison import changes, departures
from tests.record.jobs import JOBS
from tests.record.machine import machine
from tests.record.outcome import Entry, run

QUICK = ("demo", "facade", "office", "constraints", "paper-icp", "paper-planes")
WHOLE: dict[str, Any] = json.loads(RECORD.read_text())


@pytest.fixture(scope="module")
def given(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Entry]:
    """Run a job, once."""
    work = tmp_path_factory.mktemp("record")
    known: dict[str, Entry] = {}

    def now(name: str) -> Entry:
        if name not in known:
            shared = request.getfixturevalue("shared") if WHOLE["jobs"][name]["found"] else work
            known[name] = run(name, work, shared)
        return known[name]

    return now


def test_every_job_is_in_the_record() -> None:
    assert list(WHOLE["jobs"]) == list(JOBS)


@pytest.mark.parametrize("name", QUICK)
def test_not_a_bit_has_changed(given: Callable[[str], Entry], name: str) -> None:
    other = [key for key, value in machine().items() if value != WHOLE["machine"][key]]
    if other:
        pytest.skip(f"bits may differ: the record was made with other {', '.join(other)}")
    recorded, now = WHOLE["jobs"][name], given(name)
    if recorded["found"] and recorded["inputs"] != now["inputs"]:
        pytest.skip("the real scans are not those of the record")
    # Scans that are made here are the same on the same machine, or the simulator has changed.
    assert not changes(recorded, now)


@pytest.mark.parametrize("name", QUICK)
def test_verdicts_are_the_same_and_poses_near(given: Callable[[str], Entry], name: str) -> None:
    recorded, now = WHOLE["jobs"][name], given(name)
    if recorded["inputs"] != now["inputs"]:
        pytest.skip("the scans are not those of the record: they are made, or given, otherwise here")
    assert not departures(recorded, now)


def changed(entry: Entry, value: Any, *place: Any) -> Entry:
    """The entry with another value in one place."""
    result = copy.deepcopy(entry)
    inside = result
    for key in place[:-1]:
        inside = inside[key]
    assert inside[place[-1]] != value
    inside[place[-1]] = value
    return result


def test_a_difference_anywhere_is_found_and_named() -> None:
    entry = WHOLE["jobs"]["constraints"]
    station, link, loop = (next(iter(entry[key])) for key in ("stations", "links", "loops"))
    assert changes(entry, entry, aside=True) == departures(entry, entry) == []
    places = [
        ("inputs", "trihedral.toml"),
        ("exit",),
        *(("stations", station, key) for key in ("status", "part", "pose", "sigmas")),
        *(
            ("links", link, key)
            for key in ("verdict", "transform", "covariance", "alternatives", "figures", "network")
        ),
        *(("loops", loop, key) for key in ("ok", "figures")),
        ("frame", "figures"),
    ]
    for place in places:
        (said,) = changes(entry, changed(entry, "other", *place))
        assert said.startswith(" / ".join(place))
    for place in (("stations", station), ("links", link)):
        fewer = copy.deepcopy(entry)
        del fewer[place[0]][place[1]]
        assert any(said.startswith(" / ".join(place)) for said in changes(entry, fewer))
        assert any(said.startswith(" / ".join(place)) for said in changes(fewer, entry))
    words = changed(entry, "other", "aside", "links", link)
    assert not changes(entry, words) and len(changes(entry, words, aside=True)) == 1


def test_verdicts_and_poses_that_differ_are_found_on_any_processor() -> None:
    entry = WHOLE["jobs"]["constraints"]
    station, link, loop = (next(iter(entry[key])) for key in ("stations", "links", "loops"))
    for place in (
        ("exit",),
        ("stations", station, "status"),
        ("links", link, "verdict"),
        ("loops", loop, "ok"),
    ):
        assert len(departures(entry, changed(entry, "other", *place))) == 1
    at = ("places", station, 0, 3)
    x = entry["places"][station][0][3]
    assert not departures(entry, changed(entry, x + 0.9e-4, *at))
    assert "0.110 mm" in departures(entry, changed(entry, x + 1.1e-4, *at))[0]
