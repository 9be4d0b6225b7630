"""Tolerance profiles: what passes and what does not."""

import math

import pytest

from trihedral.errors import OptionError
from trihedral.verdict.profile import DEFAULT_PROFILE, PROFILES, Profile, profile_named


@pytest.mark.parametrize(
    ("name", "p90_mm", "p95_mm", "passes"),
    [
        ("exterior", None, 15.0, True),
        ("exterior", None, 15.1, False),
        ("interior", None, 10.0, True),
        ("interior", None, 10.1, False),
        ("under-6mm", 5.9, 30.0, True),
        ("under-6mm", 6.1, 30.0, False),
        # Not recorded: P95 stands in, and 90 % can only lie lower.
        ("under-6mm", None, 5.9, True),
        ("under-6mm", None, 6.1, False),
        ("loa20", None, 50.0, True),
        ("loa30", None, 15.1, False),
        ("loa40", None, 5.1, False),
        ("loa50", None, 1.0, True),
        ("none", None, 1e6, True),
    ],
)
def test_limits_on_links(name, p90_mm, p95_mm, passes):
    p90 = None if p90_mm is None else p90_mm / 1e3
    assert (profile_named(name).link_problem(p90, p95_mm / 1e3) is None) is passes


@pytest.mark.parametrize("name", [name for name in PROFILES if name != "none"])
@pytest.mark.parametrize("figure", [None, math.nan, math.inf])
def test_what_was_not_measured_has_not_passed(name, figure):
    assert profile_named(name).link_problem(figure, figure) is not None


def test_levels_of_accuracy_ask_for_the_position_too():
    loa30 = profile_named("loa30")
    # 15 mm at 95 % of a normal distribution is a sigma of 7.65 mm.
    assert loa30.station_problem((0.0076, 0.001, 0.001)) is None
    assert loa30.station_problem((0.001, 0.0077, 0.001)) is not None
    assert loa30.station_problem(None) is not None
    assert profile_named("exterior").station_problem(None) is None


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(OptionError) as caught:
        profile_named("basement")
    assert all(name in str(caught.value) for name in PROFILES)
    assert profile_named(DEFAULT_PROFILE.name) is DEFAULT_PROFILE


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan])
def test_a_limit_that_makes_no_sense_is_refused(limit):
    with pytest.raises(OptionError):
        Profile("own", "own", link_p95_mm=limit)
