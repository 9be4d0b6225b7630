"""Matching against OpenCV's brute force, and its edge cases."""

import cv2
import numpy as np
import pytest

from trihedral.errors import OptionError
from trihedral.initial.visual.matching import MatchOptions, match


def descriptors(seed, count, size=64):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(count, size))
    return np.rint(512 * values / np.linalg.norm(values, axis=1, keepdims=True)).astype(np.float32)


def test_opencv_matches_the_same():
    a = descriptors(1, 300)
    b = np.concatenate(
        [a[100:250] + np.rint(np.random.default_rng(2).normal(0, 35, (150, 64))), descriptors(3, 200)]
    )
    b = b.astype(np.float32)
    found = match(a, b, MatchOptions(ratio=0.8))
    brute = cv2.BFMatcher(cv2.NORM_L2)

    def passed(one, other):
        return {
            m[0].queryIdx: m[0].trainIdx
            for m in brute.knnMatch(one, other, k=2)
            if m[0].distance < 0.8 * m[1].distance
        }

    there, back = passed(a, b), passed(b, a)
    theirs = {(i, j) for i, j in there.items() if back.get(j) == i}
    assert len(theirs) > 80
    assert set(zip(found.a.tolist(), found.b.tolist(), strict=True)) == theirs


def test_the_most_distinct_match_comes_first_and_none_twice():
    a = descriptors(1, 200)
    b = (a + np.rint(np.random.default_rng(2).normal(0, 30, a.shape))).astype(np.float32)
    found = match(a, b)
    assert (np.diff(found.ratio) >= 0).all() and found.ratio[-1] < 0.8
    assert len(set(found.a.tolist())) == len(set(found.b.tolist())) == len(found)


def test_the_other_way_round_is_the_same():
    a = descriptors(1, 150)
    b = (a[:100] + np.rint(np.random.default_rng(5).normal(0, 40, (100, 64)))).astype(np.float32)
    there, back = match(a, b), match(b, a)
    assert np.array_equal(there.a, back.b) and np.array_equal(there.b, back.a)


def test_two_copies_of_a_keypoint_match_nothing():
    a = descriptors(1, 20)
    assert 0 not in match(a, np.concatenate([a, a[:1]])).a


def test_keypoints_of_different_kinds_do_not_match():
    a = descriptors(1, 20)
    kinds = np.ones(20, dtype=np.int8)
    other = kinds.copy()
    other[3] = -1
    assert set(match(a, a, signs=(kinds, other)).a.tolist()) == set(range(20)) - {3}


@pytest.mark.parametrize(("n", "m"), [(0, 0), (0, 9), (1, 9), (9, 1)])
def test_too_few_to_compare_match_nothing(n, m):
    assert len(match(descriptors(1, n), descriptors(1, m))) == 0


def test_descriptors_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="cannot be compared"):
        match(descriptors(1, 9, 64), descriptors(1, 9, 128))


@pytest.mark.parametrize("ratio", [0.0, -1.0, 1.1, float("nan")])
def test_ratios_that_make_no_sense_are_refused(ratio):
    with pytest.raises(OptionError, match="ratio"):
        MatchOptions(ratio=ratio)
