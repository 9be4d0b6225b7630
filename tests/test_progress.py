"""Rates and remaining times, against a clock that the test turns."""

import json
import os
import signal
import threading
import time

import pytest

from trihedral.errors import InputError
from trihedral.job.progress_file import ProgressFile, read_progress
from trihedral.progress import Pace, Silent, relayed


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


def test_a_progress_file_tells_where_a_run_is(tmp_path):
    file = ProgressFile(Silent(), tmp_path)
    assert read_progress(tmp_path) is None
    file.phase("Preparing scans", 3, "scans", 30.0, "points")
    file.advance("a", 10.0)
    file.note("b.e57: it is cut short")
    record = read_progress(tmp_path)
    assert (record.phases[0].done, record.phases[0].total, record.ended) == (1, 3, False)
    assert record.notes == ["b.e57: it is cut short"]
    file.end()
    assert read_progress(tmp_path).ended


def test_a_damaged_progress_file_is_said_so(tmp_path):
    (tmp_path / "progress.json").write_text(json.dumps({"phases": []})[:-3])
    with pytest.raises(InputError, match=r"progress\.json"):
        read_progress(tmp_path)


def test_a_watcher_is_told_by_the_thread_that_waits_and_in_order():
    here, heard = threading.current_thread(), []

    class Watcher:
        def phase(self, *of):
            heard.append(("phase", *of, threading.current_thread()))

        def advance(self, *of):
            heard.append(("advance", *of, threading.current_thread()))

        def note(self, *of):
            heard.append(("note", *of, threading.current_thread()))

    def step(progress):
        assert threading.current_thread() is not here
        progress.phase("Closing loops", 2, "links", 2.0, "")
        progress.advance("a", 1.0)
        progress.note("b is odd")
        progress.advance("b", 1.0)
        return "done"

    assert relayed(step, Watcher()) == "done"
    assert heard == [
        ("phase", "Closing loops", 2, "links", 2.0, "", here),
        ("advance", "a", 1.0, here),
        ("note", "b is odd", here),
        ("advance", "b", 1.0, here),
    ]


def test_what_a_step_raises_is_raised_after_what_it_told():
    heard = []

    class Watcher(Silent):
        def note(self, text):
            heard.append(text)

    def step(progress):
        progress.note("so far")
        raise ZeroDivisionError("ours")

    with pytest.raises(ZeroDivisionError, match="ours"):
        relayed(step, Watcher())
    assert heard == ["so far"]


def test_ctrl_c_does_not_wait_for_the_step():
    ended = threading.Event()
    # Where the runner ignores Ctrl-C, as in the background of a shell, so would this process.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            relayed(lambda progress: ended.wait(20.0), Silent())
        assert time.monotonic() - began < 10.0
    finally:
        signal.signal(signal.SIGINT, before)
        ended.set()
