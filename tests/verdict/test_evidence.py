"""The probability of poses, and the verdict on them: closed forms, and what must not be believed."""

from dataclasses import replace

import numpy as np
import pytest

from support import links
from trihedral.model.link import LinkEvidence, LinkVerdict, PoseEstimate
from trihedral.verdict.agreement import SMALL_SCALE, STATIC_SCALE, Agreement
from trihedral.verdict.appearance import AppearanceOptions
from trihedral.verdict.evidence import CONSTANT, WEIGHTS, evidence_of, probabilities
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
        static_conflict=np.array([solid]),
        small_conflict=np.array([small]),
        agreeing_of=of,
        conflicting_of=conflicting,
    )


def estimate(sigma: float = 1e-4, turn: float = 1e-5, chi_square: float = 2.0) -> PoseEstimate:
    """A pose known so well (1 sigma, m and rad) in each direction and about each axis."""
    return PoseEstimate(np.eye(4), np.diag([turn**2] * 3 + [sigma**2] * 3), chi_square=chi_square)


def judged(
    found: Agreement, *, rivals: int = 0, similarity: float | None = None, **precision: float
) -> tuple[LinkVerdict, str | None]:
    """Judge a pose and others that explain the scans just as well."""
    evidence = evidence_of(found, AREAS, similarity)
    judgement = judge([estimate(**precision)] * (1 + rivals), [evidence] * (1 + rivals))
    return judgement.verdict, judgement.reason


def of_odds(odds: float, evidence: LinkEvidence) -> LinkEvidence:
    """The same evidence, so pure that the pose has these odds against none."""
    against = float(np.log(probabilities([evidence])[0] / (1 - probabilities([evidence])[0])))
    weight = WEIGHTS["much of the surface that both scans saw does not agree"]
    return replace(evidence, purity=evidence.purity + (np.log(odds) - against) / weight)


def of_probability(probability: float, evidence: LinkEvidence) -> LinkEvidence:
    """The same of a pose that has no rival."""
    return of_odds(probability / (1 - probability), evidence)


def test_one_pose_has_the_logistic_probability_of_its_weighted_evidence() -> None:
    found = links.evidence(
        held_area_m2=120.0,
        purity=0.9,
        solid_conflict=0.5 * STATIC_SCALE,
        small_conflict=0.4 * SMALL_SCALE,
        loose_conflict_damped=0.05,
        appearance_similarity=0.9,
    )
    # Appearance counts from what speaks neither for a pose nor against it, 0.65.
    features = (np.log1p(120.0), 0.5, 0.4, 0.05, 0.9, 0.9 - 0.65)
    odds = np.exp(CONSTANT + sum(w * f for w, f in zip(WEIGHTS.values(), features, strict=True)))
    assert probabilities([found])[0] == pytest.approx(odds / (1 + odds))


def test_equal_poses_share_what_none_leaves() -> None:
    found = evidence_of(agreement(), AREAS, 1.0)
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
    better = probabilities([evidence_of(agreement(), AREAS, None)])[0]
    assert probabilities([evidence_of(worse, AREAS, None)])[0] < better


def test_the_appearance_counts_where_it_is_known() -> None:
    chances = [probabilities([evidence_of(agreement(), AREAS, v)])[0] for v in (0.2, None, 1.0)]
    assert chances[0] < chances[1] < chances[2]


def test_areas_are_of_the_station_that_has_less_and_of_the_conflict_that_is_larger() -> None:
    found = replace(
        agreement(), holding=np.array([[0.1, 0.5]]), conflicting_of=np.array([[[0.05, 0, 0], [0.02, 0, 0]]])
    )
    evidence = evidence_of(found, AREAS, None)
    assert evidence.held_area_m2 == pytest.approx(min(0.1 * 400, 0.5 * 300))
    assert evidence.loose_conflict == pytest.approx(0.05 / 0.10)
    assert evidence.loose_conflict_m2 == pytest.approx(0.05 * 400)
    # 20 m2 each way, of which half is in conflict, and 2 m2 more.
    assert evidence.loose_conflict_damped == pytest.approx(20 / (20 + 20 + 2))


def test_a_pose_that_nothing_speaks_against_is_accepted() -> None:
    assert judged(agreement()) == (LinkVerdict.ACCEPTED, None)
    assert judged(agreement(), similarity=0.9) == (LinkVerdict.ACCEPTED, None)


@pytest.mark.parametrize(
    ("verdict", "found", "said", "more"),
    [
        (LinkVerdict.REFUSED, agreement(solid=0.05), "building's surfaces", {}),
        (LinkVerdict.REFUSED, agreement(holding=0.01), "too little shared surface", {}),
        (LinkVerdict.REFUSED, agreement(), "do not look the same", {"similarity": 0.3}),
        # A room one storey up, a copy in shape and in half of its appearance, from the same place in it.
        (LinkVerdict.REFUSED, agreement(holding=0.9), "do not look the same", {"similarity": 0.55}),
        # Two halves of a hall that is the same turned by half a circle.
        (LinkVerdict.AMBIGUOUS, agreement(), "another pose", {"rivals": 1}),
        (LinkVerdict.DOUBTFUL, agreement(solid=0.03), "building's surfaces", {}),
        # The flight of stairs that one storey has and the other has not: 10 m2 of few that are loose.
        (LinkVerdict.DOUBTFUL, agreement(loose=0.025), "10 m2 of stairs", {"similarity": 1.0}),
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
    options = AppearanceOptions()
    assert options.least(0.1) == options.refused_similarity
    assert options.least(0.3) < 0.55 < options.least(0.5)
    # Scans from one place that are held by all of their surface, as right poses have it, are far above.
    assert options.least(1.0) < 0.94
    assert "do not look" not in (judged(agreement(holding=0.25), similarity=0.5)[1] or "")


def test_a_likelier_pose_does_not_hide_another_that_stands_on_its_own() -> None:
    # A hall that half a turn takes nearly onto itself: unlike shares of surface, and nothing contradicts either pose.
    def verdict(standing: float) -> LinkVerdict:
        found = evidence_of(agreement(), AREAS, None)
        rival = of_probability(standing, found)
        # Odds of which 0.87 come to this pose beside the other.
        first = of_odds(0.87 / 0.13 * (1 + standing / (1 - standing)), found)
        judgement = judge([estimate()] * 2, [first, rival])
        assert judgement.evidence is not None
        assert judgement.evidence.probability == pytest.approx(0.87)
        return judgement.verdict

    assert verdict(0.99) is LinkVerdict.AMBIGUOUS
    assert verdict(0.90) is LinkVerdict.ACCEPTED


def test_others_are_kept_where_they_are_not_out_of_the_question() -> None:
    found = evidence_of(agreement(), AREAS, None)
    others = [estimate(sigma=2e-4), estimate(sigma=3e-4)]
    # Beside odds of 100, those of 4 are a probability of 0.038 and those of 1 of 0.0094: 0.02 is asked.
    judgement = judge([estimate(), *others], [of_odds(odds, found) for odds in (100.0, 4.0, 1.0)])
    assert judgement.alternatives == (others[0],)


def test_more_is_asked_under_a_ceiling_where_nothing_is_known_of_the_appearance() -> None:
    def verdict(probability: float, similarity: float | None, enclosed: bool) -> LinkVerdict:
        found = evidence_of(agreement(), AREAS, similarity, enclosed=enclosed)
        return judge([estimate()], [of_probability(probability, found)]).verdict

    assert verdict(0.85, None, True) is LinkVerdict.DOUBTFUL
    assert verdict(0.95, None, True) is LinkVerdict.ACCEPTED
    assert verdict(0.85, 0.9, True) is LinkVerdict.ACCEPTED
    assert verdict(0.85, None, False) is LinkVerdict.ACCEPTED


@pytest.mark.parametrize(
    ("small", "loose", "enclosed", "similarity", "expected"),
    [
        (0.10, 0.008, True, 0.95, LinkVerdict.DOUBTFUL),
        (0.10, 0.008, False, None, LinkVerdict.ACCEPTED),  # a street, on which people and cars move
        (0.04, 0.003, True, 0.95, LinkVerdict.DOUBTFUL),  # 2.4 m2 of other furniture in a copy of a storey
        (0.04, 0.002, True, None, LinkVerdict.ACCEPTED),  # 1.6 m2: a chair and a door
        (0.025, 0.003, True, 0.95, LinkVerdict.ACCEPTED),  # people beside the scanner
        (0.025, 0.003, True, None, LinkVerdict.DOUBTFUL),  # the same, and nothing says that it is no copy
        (0.015, 0.003, True, None, LinkVerdict.ACCEPTED),
    ],
)
def test_things_in_empty_space_count_for_more_under_a_ceiling(
    small: float, loose: float, enclosed: bool, similarity: float | None, expected: LinkVerdict
) -> None:
    found = evidence_of(agreement(small=small, loose=loose), (800.0, 600.0), similarity, enclosed=enclosed)
    judgement = judge([estimate()], [of_probability(0.95, found)])
    assert judgement.verdict is expected
    assert expected is LinkVerdict.ACCEPTED or "of what is not of the building stands" in (
        judgement.reason or ""
    )


def test_without_a_pose_a_pair_is_refused() -> None:
    judgement = judge([], [])
    assert (judgement.verdict, judgement.reason) == (LinkVerdict.REFUSED, "no pose was found")
    assert judgement.estimate is judgement.evidence is None


def test_limits_that_make_no_sense_are_refused() -> None:
    for wrong in ({"probability": 1.0}, {"solid_conflict": 0.1}, {"weakest_sigma": 0.0}):
        with pytest.raises(Exception, match="must"):
            JudgementOptions(**wrong)
