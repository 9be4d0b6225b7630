"""The probability of poses, and the verdict on them: closed forms, and what must not be believed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support import links
from support.room import room_scan
from trihedral.errors import OptionError
from trihedral.model.link import LinkEvidence, LinkVerdict, PoseEstimate
from trihedral.scan.preparation import prepare
from trihedral.verdict.agreement import STATIC_SCALE, Agreement
from trihedral.verdict.appearance import AppearanceOptions, Similarity
from trihedral.verdict.blocks import BlockCounts
from trihedral.verdict.evidence import (
    BEYOND_DOUBT,
    CONSTANT,
    WEIGHTS,
    EvidenceOptions,
    evidence_of,
    gather,
    probabilities,
    worst,
)
from trihedral.verdict.judgement import Judgement, JudgementOptions, judge, likeliest

AREAS = (400.0, 300.0)
HOLD, COPIES, LOOK, BUILDING, FURNITURE, THINGS, MISFIT = WEIGHTS


def agreement(holding: tuple[float, float] = (0.4, 0.4), solid: float = 0.0) -> Agreement:
    """Of one pose under which half of the first scan agrees, and 0.3 of the second."""
    return Agreement(
        agreeing=np.array([[0.5, 0.3]]),
        conflicting=np.array([[0.02, 0.03]]),
        near=np.full((1, 2), 0.02),
        holding=np.array([holding]),
        static_conflict=np.array([solid]),
        small_conflict=np.zeros(1),
        agreeing_of=np.zeros((1, 2, 3)),
        conflicting_of=np.zeros((1, 2, 3)),
    )


BLOCKS = BlockCounts(np.array([100.0, 200.0, 300.0]), np.array([1.0, 2.0, 3.0]), misfit=0.07)


def estimate(sigma: float = 1e-4, turn: float = 1e-5) -> PoseEstimate:
    """A pose known so well (1 sigma, m and rad) in each direction and about each axis."""
    return PoseEstimate(np.eye(4), np.diag([turn**2] * 3 + [sigma**2] * 3))


def log_odds(of: LinkEvidence) -> float:
    """Of a pose against none, written out; its appearance is known or not, its covariance is."""
    assert of.redundancy is not None
    (loose, loose_against), (patch, patch_against) = of.loose_blocks, of.patch_blocks
    return (
        CONSTANT
        + WEIGHTS[HOLD] * np.log10(of.redundancy)
        + WEIGHTS[COPIES] * (of.enclosed and of.appearance_similarity is None)
        # Appearance counts from what speaks neither for a pose nor against it.
        + WEIGHTS[LOOK] * (0.0 if of.appearance_similarity is None else of.appearance_similarity - 0.65)
        + WEIGHTS[BUILDING] * of.solid_conflict / STATIC_SCALE
        + WEIGHTS[FURNITURE] * np.log((patch_against + 0.5) / (patch + patch_against + 1.0))
        + WEIGHTS[THINGS] * np.log((loose_against + 0.5) / (loose + loose_against + 1.0))
        + WEIGHTS[MISFIT] * of.misfit
    )


def of_odds(odds: float, **what: Any) -> LinkEvidence:
    """Evidence held so much by its surfaces that the pose has these odds against none."""
    found = links.evidence(redundancy=1.0, **what)
    return replace(found, redundancy=10 ** float((np.log(odds) - log_odds(found)) / WEIGHTS[HOLD]))


def of_probability(probability: float, **what: Any) -> LinkEvidence:
    """The same of a pose that has no rival."""
    return of_odds(probability / (1 - probability), **what)


def judged(*evidence: LinkEvidence, **precision: float) -> Judgement:
    """Judge the first of some poses."""
    return judge([estimate(**precision)] * len(evidence), evidence)


@pytest.mark.parametrize(
    "what",
    [
        {"redundancy": 2.5},
        {"enclosed": True},
        {"appearance_similarity": 0.72, "enclosed": True},
        {"appearance_similarity": 0.5},
        {"solid_conflict": 0.015, "patch_blocks": (80.5, 6.25)},
        {"loose_blocks": (12.0, 7.5), "misfit": 0.3},
    ],
)
def test_one_pose_has_the_logistic_probability_of_its_weighted_evidence(what: dict[str, Any]) -> None:
    found = links.evidence(**what)
    assert probabilities([found])[0] == pytest.approx(1 / (1 + np.exp(-log_odds(found))), rel=1e-12)


def test_several_poses_and_none_share_what_is_certain() -> None:
    odds = np.array([30.0, 4.0, 0.5])
    found = [of_odds(one) for one in odds.tolist()]
    assert probabilities(found) == pytest.approx(odds / (1 + 30.0 + 4.0 + 0.5))
    assert probabilities([found[1], found[1]]) == pytest.approx([4 / 9, 4 / 9])


# Each of what speaks for a pose, and the same gone bad: so far that it alone is what speaks most against it.
BAD: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    (HOLD, {"redundancy": 5.0}, {"redundancy": 0.3}),
    (COPIES, {"enclosed": False}, {"enclosed": True}),
    (LOOK, {"appearance_similarity": 0.7}, {"appearance_similarity": 0.46}),
    (BUILDING, {"solid_conflict": 0.0}, {"solid_conflict": 0.02}),
    (FURNITURE, {"patch_blocks": (200.0, 0.0)}, {"patch_blocks": (200.0, 20.0)}),
    (FURNITURE, {"patch_blocks": (200.0, 1.0)}, {"patch_blocks": (10.0, 1.0)}),
    (THINGS, {"loose_blocks": (100.0, 1.0)}, {"loose_blocks": (100.0, 60.0)}),
    (THINGS, {"loose_blocks": (100.0, 1.0)}, {"loose_blocks": (3.0, 1.0)}),
    (MISFIT, {"misfit": 0.05}, {"misfit": 0.5}),
]


@pytest.mark.parametrize(("name", "good", "bad"), BAD)
def test_each_piece_of_evidence_that_gets_worse_makes_a_pose_less_likely(
    name: str, good: dict[str, Any], bad: dict[str, Any]
) -> None:
    better, worse = links.evidence(**good), links.evidence(**bad)
    assert probabilities([worse])[0] < probabilities([better])[0]
    assert worst(worse) == name


def test_what_is_not_known_speaks_neither_for_a_pose_nor_against_it() -> None:
    def chance(**what: Any) -> float:
        return float(probabilities([links.evidence(**what)])[0])

    assert chance(appearance_similarity=None) == pytest.approx(chance(appearance_similarity=0.65))
    assert chance(redundancy=None) == pytest.approx(chance(redundancy=10 ** BEYOND_DOUBT[0]))
    # Rooms have copies; one that looks the same is none.
    assert chance(enclosed=True) < chance() == chance(enclosed=False)
    assert chance(enclosed=True, appearance_similarity=0.9) == chance(appearance_similarity=0.9)


def test_what_is_not_known_is_not_blamed() -> None:
    # Of little that speaks against it, the most is that its surfaces hold it less than most.
    assert worst(links.evidence(redundancy=3.5)) == HOLD


def test_far_beyond_doubt_more_of_the_same_tells_no_more() -> None:
    def chance(**what: Any) -> float:
        return float(probabilities([links.evidence(**what)])[0])

    assert chance(appearance_similarity=-0.3) == chance(appearance_similarity=0.45)
    assert chance(appearance_similarity=1.4) == chance(appearance_similarity=1.0)
    assert chance(solid_conflict=0.5) == chance(solid_conflict=3 * STATIC_SCALE) < chance(solid_conflict=0.08)


def test_evidence_is_of_the_station_that_is_worse_off_and_of_each_kind_by_itself() -> None:
    found = evidence_of(
        agreement(holding=(0.1, 0.5), solid=0.012), BLOCKS, AREAS, Similarity(0.8, "color"), redundancy=3.0
    )
    assert found.held_area_m2 == pytest.approx(min(0.1 * 400, 0.5 * 300))
    assert found.holding == pytest.approx(0.3)
    assert found.score == pytest.approx(0.3 * np.exp(-0.012 / STATIC_SCALE))
    assert (found.loose_blocks, found.patch_blocks) == ((100.0, 1.0), (200.0, 2.0))
    assert (found.misfit, found.redundancy, found.solid_conflict) == (0.07, 3.0, 0.012)
    assert (found.overlap_from, found.overlap_to) == (0.5, 0.3)
    assert found.free_space_conflict == pytest.approx(max(0.02 / 0.52, 0.03 / 0.33))
    assert (found.appearance_similarity, found.by_intensity) == (0.8, False)
    # More than a fifth of the surface holds the pose: half of what is beyond is asked besides.
    assert found.least_similarity == pytest.approx(0.45 + 0.5 * (0.3 - 0.2))
    by_intensity = evidence_of(agreement(), BLOCKS, AREAS, Similarity(0.8, "intensity"))
    assert by_intensity.by_intensity and by_intensity.redundancy is None
    unknown = evidence_of(agreement(), BLOCKS, AREAS, None, enclosed=True)
    assert unknown.appearance_similarity is None and not unknown.by_intensity and unknown.unseen


def test_surfaces_hold_a_pose_as_many_times_over_as_its_weakest_sigma_is_below_their_noise() -> None:
    fine, rough = (prepare(room_scan(step=0.5, noise=noise)) for noise in (0.002, 0.006))

    def redundancy(known: PoseEstimate) -> float | None:
        return gather(fine, rough, known, EvidenceOptions()).redundancy

    along = np.array([1.0, 2.0, 2.0]) / 3
    covariance = 1e-10 * np.eye(6)
    covariance[3:, 3:] += 0.004**2 * np.outer(along, along)
    found = redundancy(PoseEstimate(np.eye(4), covariance))
    assert rough.noise.surface_noise > 1.5 * fine.noise.surface_noise
    assert found == pytest.approx(rough.noise.surface_noise / 0.004, rel=1e-4)
    # A metre is as good as open, and a tenth of a millimetre as good as certain.
    assert redundancy(estimate(sigma=50.0)) == pytest.approx(rough.noise.surface_noise / 1.0)
    assert redundancy(estimate(sigma=1e-9)) == pytest.approx(rough.noise.surface_noise / 1e-4)
    assert redundancy(PoseEstimate(np.eye(4))) is None


def test_a_pose_that_nothing_speaks_against_is_accepted() -> None:
    judgement = judged(links.evidence())
    assert (judgement.verdict, judgement.reason) == (LinkVerdict.ACCEPTED, None)
    assert judgement.evidence is not None and not judgement.evidence.contradicted
    assert judgement.evidence.probability == pytest.approx(1 / (1 + np.exp(-log_odds(links.evidence()))))
    assert judged(links.evidence(enclosed=True, appearance_similarity=0.9)).verdict is LinkVerdict.ACCEPTED


@pytest.mark.parametrize(
    ("verdict", "what", "said"),
    [
        (LinkVerdict.REFUSED, {"solid_conflict": 0.05}, "5% of the building's surfaces stand"),
        (LinkVerdict.DOUBTFUL, {"solid_conflict": 0.03}, "3.0% of the building's surfaces stand"),
        (LinkVerdict.REFUSED, {"held_area_m2": 4.0}, "too little shared surface: 4.0 m2"),
        # A room one storey up, a copy in shape and in half of its appearance.
        (
            LinkVerdict.REFUSED,
            {"enclosed": True, "appearance_similarity": 0.55, "least_similarity": 0.8},
            "do not look the same: similarity of colour 0.55",
        ),
        # A room beside it, a copy but for a poster.
        (
            LinkVerdict.REFUSED,
            {"cells_compared": 600, "cells_different": 7},
            "7 of 600 small places differ in colour",
        ),
        # The law of intensity may change from scan to scan.
        (
            LinkVerdict.DOUBTFUL,
            {
                "enclosed": True,
                "appearance_similarity": 0.55,
                "least_similarity": 0.8,
                "by_intensity": True,
            },
            "do not look the same: similarity of intensity 0.55",
        ),
    ],
)
def test_what_is_not_believed_has_its_reason(verdict: LinkVerdict, what: dict[str, Any], said: str) -> None:
    # Whatever else the pose has for it.
    judgement = judged(of_probability(0.9999, **what))
    assert judgement.verdict is verdict
    assert judgement.reason is not None and said in judgement.reason
    assert judgement.evidence is not None
    assert judgement.evidence.contradicted is (what.get("solid_conflict", 0.0) > 0.02)


@pytest.mark.parametrize(
    "what", [{"solid_conflict": 0.019}, {"held_area_m2": 5.5}, {"cells_compared": 600, "cells_different": 6}]
)
def test_limits_are_where_they_are_stated(what: dict[str, Any]) -> None:
    assert judged(of_probability(0.9999, **what)).verdict is LinkVerdict.ACCEPTED


@pytest.mark.parametrize("by_intensity", [False, True])
def test_outdoors_surfaces_may_look_otherwise(by_intensity: bool) -> None:
    found = of_probability(
        0.9999, appearance_similarity=0.55, least_similarity=0.8, by_intensity=by_intensity
    )
    assert judged(found).verdict is LinkVerdict.ACCEPTED


@pytest.mark.parametrize(("name", "good", "bad"), BAD)
def test_a_pose_that_is_not_likely_enough_is_doubted_for_what_speaks_most_against_it(
    name: str, good: dict[str, Any], bad: dict[str, Any]
) -> None:
    least = JudgementOptions(probability=0.999999, unseen_probability=0.999999)
    found = links.evidence(**bad)
    judgement = judge([estimate()], [found], least)
    percent = 100 / (1 + np.exp(-log_odds(found)))
    assert judgement.verdict is LinkVerdict.DOUBTFUL
    assert judgement.reason == f"{percent:.0f}% that it is right: {name} (100 m2 hold the pose)"


def test_a_pose_is_believed_from_a_probability_on() -> None:
    assert judged(of_probability(0.965)).verdict is LinkVerdict.DOUBTFUL
    assert judged(of_probability(0.975)).verdict is LinkVerdict.ACCEPTED


def test_more_is_asked_under_a_ceiling_where_nothing_is_known_of_the_appearance() -> None:
    assert judged(of_probability(0.975, enclosed=True)).verdict is LinkVerdict.DOUBTFUL
    assert judged(of_probability(0.985, enclosed=True)).verdict is LinkVerdict.ACCEPTED
    assert (
        judged(of_probability(0.975, enclosed=True, appearance_similarity=0.9)).verdict
        is LinkVerdict.ACCEPTED
    )


def test_little_shared_surface_may_look_less_alike_than_much() -> None:
    options = AppearanceOptions()
    assert options.least(0.1) == options.least(0.2) == options.refused_similarity
    assert options.least(0.3) < 0.55 < options.least(0.5)
    # Scans from one place that are held by all of their surface, as right poses have it, are far above.
    assert options.least(1.0) < 0.94


def test_two_poses_that_explain_the_scans_alike_are_ambiguous() -> None:
    # Two halves of a hall that is the same turned by half a circle.
    judgement = judged(links.evidence(), links.evidence())
    assert judgement.verdict is LinkVerdict.AMBIGUOUS
    assert judgement.reason == "another pose explains the scans too: 50% against 50% that this one is right"


def test_a_likelier_pose_does_not_hide_another_that_stands_on_its_own() -> None:
    # A hall that half a turn takes nearly onto itself: unlike shares of surface, and nothing contradicts either pose.
    def verdict(standing: float) -> LinkVerdict:
        rival = standing / (1 - standing)
        # Odds of which 0.98 come to this pose beside the other.
        judgement = judged(of_odds(0.98 / 0.02 * (1 + rival)), of_odds(rival))
        assert judgement.evidence is not None
        assert judgement.evidence.probability == pytest.approx(0.98)
        return judgement.verdict

    assert verdict(0.995) is LinkVerdict.AMBIGUOUS
    assert verdict(0.98) is LinkVerdict.ACCEPTED


def test_what_is_missing_to_a_pose_is_of_another_or_of_none() -> None:
    # Odds of 10 to 4 to 1: what is missing is of the other pose; 10 to 0.5 to 1: it is of none.
    other = judged(of_odds(10.0), of_odds(4.0))
    assert (other.verdict, other.reason) == (
        LinkVerdict.AMBIGUOUS,
        "another pose explains the scans too: 27% against 67% that this one is right",
    )
    none = judged(of_odds(10.0), of_odds(0.5))
    assert none.verdict is LinkVerdict.DOUBTFUL
    assert none.reason is not None and none.reason.startswith("87% that it is right: ")


def test_others_are_kept_where_they_are_not_out_of_the_question() -> None:
    others = [estimate(sigma=2e-4), estimate(sigma=3e-4)]
    # Beside odds of 100, those of 4 are a probability of 0.038 and those of 1 of 0.0094: 0.02 is asked.
    judgement = judge([estimate(), *others], [of_odds(odds) for odds in (100.0, 4.0, 1.0)])
    assert judgement.alternatives == (others[0],)


@pytest.mark.parametrize("precision", [{"sigma": 0.003}, {"turn": np.radians(0.05)}, {"sigma": 0.049}])
def test_precision_is_not_belief(precision: dict[str, float]) -> None:
    assert judged(links.evidence(), **precision).verdict is LinkVerdict.ACCEPTED


@pytest.mark.parametrize(
    ("precision", "said"),
    [
        ({"sigma": 0.08}, "it can slide: 80 mm (1 sigma) in the weakest direction"),
        ({"turn": 0.01}, "it can turn: 0.57 deg (1 sigma) about the weakest axis"),
    ],
)
def test_a_pose_that_nothing_holds_in_a_direction_is_doubtful(precision: dict[str, float], said: str) -> None:
    judgement = judged(links.evidence(), **precision)
    assert (judgement.verdict, judgement.reason) == (LinkVerdict.DOUBTFUL, said)


def test_a_pose_that_is_open_along_no_axis_of_its_frame_is_open_all_the_same() -> None:
    # 60 mm along a corridor that runs between x and y: 42 mm along each of them.
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    for place, said in ((slice(3, 6), "slide: 60 mm"), (slice(0, 3), "turn: 3.44 deg")):
        covariance = 1e-10 * np.eye(6)
        covariance[place, place] += 0.06**2 * np.outer(along, along)
        judgement = judge([PoseEstimate(np.eye(4), covariance)], [links.evidence()])
        assert judgement.verdict is LinkVerdict.DOUBTFUL
        assert judgement.reason is not None and said in judgement.reason


def test_a_pose_without_a_covariance_is_not_asked_how_well_it_is_known() -> None:
    assert judge([PoseEstimate(np.eye(4))], [links.evidence(redundancy=None)]).verdict is LinkVerdict.ACCEPTED


def test_without_a_pose_a_pair_is_refused() -> None:
    judgement = judge([], [])
    assert (judgement.verdict, judgement.reason) == (LinkVerdict.REFUSED, "no pose was found")
    assert judgement.estimate is judgement.evidence is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"probability": 1.0, "unseen_probability": 1.0},
        {"probability": 0.99},
        {"rival": 0.0},
        {"solid_conflict": 0.1},
        {"refused_held": 0.0},
        {"open_translation": 0.0},
        {"open_rotation": -0.1},
    ],
)
def test_limits_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(OptionError, match="must"):
        JudgementOptions(**wrong)


def test_the_likeliest_pose_is_one_that_would_not_be_refused() -> None:
    options = JudgementOptions()
    fair, good = of_odds(5.0), of_odds(50.0)
    assert likeliest([fair, good], options) == 1
    assert likeliest([good, fair], options) == 0
    # However likely, a pose that puts a wall into empty space is not the one to show.
    wrong = replace(of_odds(500.0), solid_conflict=0.05)
    assert likeliest([fair, wrong], options) == 0
    assert likeliest([wrong, fair], options) == 1
    assert likeliest([wrong, wrong], options) == 0


def test_a_rival_that_would_be_refused_stands_beside_nothing() -> None:
    strange = {"enclosed": True, "appearance_similarity": 0.3}
    found = of_odds(100.0, enclosed=True, appearance_similarity=0.9)
    rival = replace(of_odds(1000.0), **strange)
    assert judged(found, of_odds(1000.0)).verdict is LinkVerdict.AMBIGUOUS
    assert judged(found, rival).verdict is LinkVerdict.ACCEPTED
    assert (
        judged(found, of_odds(1000.0, cells_compared=600, cells_different=30)).verdict is LinkVerdict.ACCEPTED
    )
    # Intensity may follow another law: it does not rule a rival out.
    assert judged(found, replace(rival, by_intensity=True)).verdict is LinkVerdict.AMBIGUOUS


def test_where_little_was_compared_nothing_is_blamed_for_standing_in_empty_space() -> None:
    reason = judged(links.evidence(patch_blocks=(0.0, 0.0), loose_blocks=(0.0, 0.0))).reason
    assert reason is not None and "little is seen by both" in reason and "stand where" not in reason
