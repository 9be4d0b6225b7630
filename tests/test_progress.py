"""Rates and remaining times, against a clock that the test turns."""

import json

import pytest

from trihedral.errors import InputError
from trihedral.journal import Journal, read_journal
from trihedral.progress import Pace, Silent


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_nothing_is_claimed_before_there_is_something_to_tell_by():
    clock = Clock()
    pace = Pace(100.0, clock)
    assert pace.rate is None and pace.remaining is None
    for _ in range(10):
        clock.now += 0.1
        pace.advance(1.0)
    # Ten steps in a second: too short a time.
    assert pace.rate is None
    clock.now += 3.0
    pace.advance(1.0)
    assert pace.rate == pytest.approx(11 / 4.0)


def test_an_even_pace_is_told_as_it_is():
    clock = Clock()
    pace = Pace(200.0, clock)
    for k in range(1, 100):
        clock.now += 2.0
        pace.advance(2.0)
        if k > 4:
            assert pace.rate == pytest.approx(1.0)
            assert pace.remaining == pytest.approx(200.0 - 2.0 * k)
    clock.now += 1.0
    assert pace.remaining == pytest.approx(1.0)


def test_steps_found_done_are_soon_forgotten():
    clock = Clock()
    pace = Pace(100.0, clock)
    for _ in range(50):
        clock.now += 0.01
        pace.advance(1.0)
    errors = []
    for k in range(50):
        clock.now += 2.0
        pace.advance(1.0)
        if clock.now > 130.0:
            errors.append(abs(pace.remaining - 2.0 * (49 - k)))
    assert max(errors) < 4.0


def test_remaining_time_does_not_jump_about_when_steps_differ():
    clock = Clock()
    pace = Pace(1000.0, clock)
    told = []
    for k in range(1000):
        clock.now += 0.2 if k % 10 else 4.0
        pace.advance(1.0)
        if 100 <= k < 900:
            true = (999 - k) * 0.58
            told.append(pace.remaining / true)
    assert min(told) > 0.8 and max(told) < 1.25


def test_a_journal_tells_where_a_run_is(tmp_path):
    journal = Journal(Silent(), tmp_path)
    assert read_journal(tmp_path) is None
    journal.phase("Preparing scans", 3, "scans", 30.0, "points")
    journal.advance("a", 10.0)
    journal.note("b.e57: it is cut short")
    record = read_journal(tmp_path)
    assert (record.phases[0].done, record.phases[0].total, record.ended) == (1, 3, False)
    assert record.notes == ["b.e57: it is cut short"]
    journal.end()
    assert read_journal(tmp_path).ended


def test_a_damaged_journal_is_said_so(tmp_path):
    (tmp_path / "progress.json").write_text(json.dumps({"phases": []})[:-3])
    with pytest.raises(InputError, match=r"progress\.json"):
        read_journal(tmp_path)
