"""The probability of poses, and the verdict on them: closed forms, and what must not be believed."""

from dataclasses import replace

import numpy as np
import pytest

from trihedral.model.link import LinkVerdict
from trihedral.verdict.agreement import Agreement
from trihedral.verdict.evidence import (
    CONSTANT,
    WEIGHTS,
    evidence,
    held_area,
    loose_conflict,
    probabilities,
)
from trihedral.verdict.judgement import JudgementOptions, judge

AREAS = (400.0, 300.0)


def agreement(holding: float = 0.4, solid: float = 0.0, small: float = 0.0, loose: float = 0.0) -> Agreement:
    """Of one pose under which half of each scan agrees; `loose` is the share of each scan in conflict."""
    of = np.array([[[0.05, 0.15, 0.3]] * 2])
    conflicting = np.array([[[loose, 0.0, 0.0]] * 2])
    return Agreement(
        agreeing=of.sum(axis=2),
        conflicting=conflicting.sum(axis=2),
        near=np.full((1, 2), 0.02),
        holding=np.full((1, 2), holding),
        solid_conflict=np.array([solid]),
        small_conflict=np.array([small]),
        agreeing_of=of,
        conflicting_of=conflicting,
    )


def judged(
    found: Agreement,
    *,
    rivals: int = 0,
    sigma: float = 1e-4,
    turn: float = 1e-5,
    chi_square: float = 2.0,
    similarity: float = np.nan,
) -> tuple[LinkVerdict, str | None]:
    chances = probabilities([evidence(found, AREAS, similarity)] * (1 + rivals))
    standing = probabilities([evidence(found, AREAS, similarity)])[0] if rivals else 0.0
    return judge(found, AREAS, chances[0], chances[1:].sum(), standing, sigma, turn, chi_square, similarity)


def test_one_pose_has_the_logistic_probability_of_its_weighted_evidence() -> None:
    found = evidence(agreement(small=0.1), AREAS, 0.9)
    odds = np.exp(CONSTANT + sum(w * f for w, f in zip(WEIGHTS.values(), found, strict=True)))
    assert probabilities([found])[0] == pytest.approx(odds / (1 + odds))


def test_equal_poses_share_what_none_leaves() -> None:
    found = evidence(agreement(), AREAS, 1.0)
    alone = probabilities([found])[0]
    both = probabilities([found, found])
    assert both[0] == both[1] < 0.5
    # Odds against "none" do not change because there is another pose.
    assert both[0] / (1 - both.sum()) == pytest.approx(alone / (1 - alone))


@pytest.mark.parametrize(
    "worse",
    [
        agreement(holding=0.05),
        agreement(solid=0.03),
        agreement(small=0.3),
        agreement(loose=0.05),
        replace(agreement(), near=np.full((1, 2), 0.4)),
    ],
)
def test_less_surface_and_more_conflict_make_a_pose_less_likely(worse: Agreement) -> None:
    better = probabilities([evidence(agreement(), AREAS, np.nan)])[0]
    assert probabilities([evidence(worse, AREAS, np.nan)])[0] < better


def test_looks_count_where_they_are_known() -> None:
    chances = [probabilities([evidence(agreement(), AREAS, v)])[0] for v in (0.2, np.nan, 1.0)]
    assert chances[0] < chances[1] < chances[2]


def test_areas_are_of_the_station_that_has_less_and_of_the_conflict_that_is_larger() -> None:
    found = replace(
        agreement(), holding=np.array([[0.1, 0.5]]), conflicting_of=np.array([[[0.05, 0, 0], [0.02, 0, 0]]])
    )
    assert held_area(found, AREAS) == pytest.approx(min(0.1 * 400, 0.5 * 300))
    share, area = loose_conflict(found, AREAS)
    assert share == pytest.approx(0.05 / 0.10)
    assert area == pytest.approx(0.05 * 400)


def test_a_pose_that_nothing_speaks_against_is_accepted() -> None:
    assert judged(agreement()) == (LinkVerdict.ACCEPTED, None)
    assert judged(agreement(), similarity=0.9) == (LinkVerdict.ACCEPTED, None)


@pytest.mark.parametrize(
    ("verdict", "found", "said", "more"),
    [
        (LinkVerdict.REFUSED, agreement(solid=0.05), "building's surfaces", {}),
        (LinkVerdict.REFUSED, agreement(holding=0.01), "too little shared surface", {}),
        (LinkVerdict.REFUSED, agreement(), "do not look the same", {"likeness": 0.3}),
        # A room one storey up, a copy in shape and in half of its looks, from the same place in it.
        (LinkVerdict.REFUSED, agreement(holding=0.9), "do not look the same", {"likeness": 0.55}),
        # Two halves of a hall that is the same turned by half a circle.
        (LinkVerdict.AMBIGUOUS, agreement(), "another pose", {"rivals": 1}),
        (LinkVerdict.DOUBTFUL, agreement(solid=0.03), "building's surfaces", {}),
        # The flight of stairs that one storey has and the other has not: 10 m2 of few that are loose.
        (LinkVerdict.DOUBTFUL, agreement(loose=0.025), "10 m2 of stairs", {"likeness": 1.0}),
        (LinkVerdict.DOUBTFUL, agreement(holding=0.025), "little shared surface", {}),
        (LinkVerdict.DOUBTFUL, agreement(small=0.5), "things stand", {}),
        (LinkVerdict.DOUBTFUL, agreement(), "can slide: 3.0 mm", {"sigma": 0.003}),
        (LinkVerdict.DOUBTFUL, agreement(), "can turn: 0.057 deg", {"turn": 0.001}),
        (LinkVerdict.DOUBTFUL, agreement(), "10.0 times their noise", {"chi_square": 100.0}),
        (LinkVerdict.DOUBTFUL, agreement(), "times their noise", {"chi_square": np.nan}),
    ],
)
def test_what_is_not_believed_has_its_reason(
    verdict: LinkVerdict, found: Agreement, said: str, more: dict[str, float]
) -> None:
    given, reason = judged(found, **more)  # type: ignore[arg-type]
    assert given is verdict
    assert reason is not None and said in reason


def test_little_shared_surface_may_look_less_alike_than_much() -> None:
    options = JudgementOptions()
    assert options.least_similarity(0.1) == options.refused_similarity
    assert options.least_similarity(0.3) < 0.55 < options.least_similarity(0.5)
    # Scans from one place that are held by all of their surface, as right poses have it, are far above.
    assert options.least_similarity(1.0) < 0.94
    assert "do not look" not in (judged(agreement(holding=0.25), similarity=0.5)[1] or "")


def test_a_likelier_pose_does_not_hide_another_that_stands_on_its_own() -> None:
    # A hall that half a turn takes nearly onto itself: unlike shares of surface, and nothing contradicts either pose.
    assert judge(agreement(), AREAS, 0.87, 0.13, 0.99, 1e-4, 1e-5, 2.0)[0] is LinkVerdict.AMBIGUOUS
    assert judge(agreement(), AREAS, 0.87, 0.13, 0.90, 1e-4, 1e-5, 2.0)[0] is LinkVerdict.ACCEPTED


def test_more_is_asked_under_a_ceiling_where_nothing_is_known_of_the_looks() -> None:
    def verdict(probability: float, similarity: float, enclosed: bool) -> LinkVerdict:
        args = (agreement(), AREAS, probability, 0.0, 0.0, 1e-4, 1e-5, 2.0, similarity)
        return judge(*args, enclosed=enclosed)[0]

    assert verdict(0.85, np.nan, True) is LinkVerdict.DOUBTFUL
    assert verdict(0.95, np.nan, True) is LinkVerdict.ACCEPTED
    assert verdict(0.85, 0.9, True) is LinkVerdict.ACCEPTED
    assert verdict(0.85, np.nan, False) is LinkVerdict.ACCEPTED


@pytest.mark.parametrize(
    ("small", "loose", "enclosed", "likeness", "expected"),
    [
        (0.10, 0.008, True, 0.95, LinkVerdict.DOUBTFUL),
        (0.10, 0.008, False, np.nan, LinkVerdict.ACCEPTED),  # a street, on which people and cars move
        (0.04, 0.003, True, 0.95, LinkVerdict.DOUBTFUL),  # 2.4 m2 of other furniture in a copy of a storey
        (0.04, 0.002, True, np.nan, LinkVerdict.ACCEPTED),  # 1.6 m2: a chair and a door
        (0.025, 0.003, True, 0.95, LinkVerdict.ACCEPTED),  # people beside the scanner
        (0.025, 0.003, True, np.nan, LinkVerdict.DOUBTFUL),  # the same, and nothing says that it is no copy
        (0.015, 0.003, True, np.nan, LinkVerdict.ACCEPTED),
    ],
)
def test_things_in_empty_space_count_for_more_under_a_ceiling(
    small: float, loose: float, enclosed: bool, similarity: float, expected: LinkVerdict
) -> None:
    found = agreement(small=small, loose=loose)
    verdict, reason = judge(
        found, (800.0, 600.0), 0.95, 0.0, 0.0, 1e-4, 1e-5, 2.0, similarity, enclosed=enclosed
    )
    assert verdict is expected
    assert expected is LinkVerdict.ACCEPTED or "of what is not of the building stands" in (reason or "")


def test_limits_that_make_no_sense_are_refused() -> None:
    for wrong in ({"probability": 1.0}, {"solid_conflict": 0.1}, {"weakest_sigma": 0.0}):
        with pytest.raises(Exception, match="must"):
            JudgementOptions(**wrong)
