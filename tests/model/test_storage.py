"""Results of pairs as text: every kind of them comes back to the bit, and other layouts are not taken for one."""

import json
import math
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trihedral.model.link import LinkEvidence, LinkVerdict, PairResult, PoseEstimate, Residuals
from trihedral.model.paper_evidence import (
    Ends,
    IcpEvidence,
    InitialOverlap,
    PaperEvidence,
    PictureMatches,
    PlaneEvidence,
    PlanesEvidence,
    VisualEvidence,
)
from trihedral.model.storage import from_text, to_text

NUMBERS = st.floats()  # NaN, infinities, -0.0 and those next to nothing among them
COUNTS = st.integers(0, 10**9)
TEXTS = st.text(max_size=20)
PAIRS = st.tuples(NUMBERS, NUMBERS)
TRIPLES = st.tuples(NUMBERS, NUMBERS, NUMBERS)


def maybe(values):
    return st.none() | values


def matrices(side):
    row = st.lists(NUMBERS, min_size=side, max_size=side)
    return st.lists(row, min_size=side, max_size=side).map(lambda rows: np.array(rows, dtype=np.float64))


def ends(values):
    return st.builds(Ends, values, values)


RESIDUALS = st.builds(Residuals, NUMBERS, NUMBERS, NUMBERS, NUMBERS, maybe(NUMBERS))
ESTIMATES = st.builds(
    PoseEstimate, matrices(4), maybe(matrices(6)), maybe(RESIDUALS), maybe(NUMBERS), maybe(COUNTS)
)
OF_TYPE = {
    float: NUMBERS,
    float | None: maybe(NUMBERS),
    bool: st.booleans(),
    tuple[float, float]: PAIRS,
    int: COUNTS,
}
EVIDENCE = st.builds(LinkEvidence, **{f.name: OF_TYPE[f.type] for f in fields(LinkEvidence)})
MATCHES = st.builds(
    PictureMatches,
    from_picture=TEXTS,
    to_picture=TEXTS,
    matches=COUNTS,
    planar=COUNTS,
    agreeing=COUNTS,
    from_pixels=st.lists(PAIRS, max_size=3).map(tuple),
    to_pixels=st.lists(PAIRS, max_size=3).map(tuple),
    drawn_agreeing=st.lists(st.booleans(), max_size=3).map(tuple),
)
VISUAL = st.builds(
    VisualEvidence,
    gate=TEXTS,
    note=TEXTS,
    picture_pairs=COUNTS,
    matches=COUNTS,
    planar=COUNTS,
    agreeing=COUNTS,
    rmse_m=maybe(NUMBERS),
    rendered=ends(st.booleans()),
    features=ends(COUNTS),
    pairs=st.lists(MATCHES, max_size=2).map(tuple),
)
PLANE = st.builds(PlaneEvidence, TRIPLES, NUMBERS, COUNTS, COUNTS, NUMBERS)
PLANES = st.builds(
    PlanesEvidence,
    st.tuples(PLANE, PLANE, PLANE),
    st.tuples(PLANE, PLANE, PLANE),
    corner_from=TRIPLES,
    corner_to=TRIPLES,
    segmented=ends(COUNTS),
    leftover_deg=st.lists(NUMBERS, max_size=3).map(tuple),
    tolerance_m=NUMBERS,
)
PAPER = st.builds(
    PaperEvidence,
    maybe(VISUAL),
    maybe(st.builds(InitialOverlap, NUMBERS, NUMBERS, NUMBERS)),
    maybe(NUMBERS),
    maybe(st.builds(IcpEvidence, NUMBERS, NUMBERS, COUNTS, COUNTS, st.booleans())),
    maybe(PLANES),
)
RESULTS = st.builds(
    PairResult,
    verdict=st.sampled_from(LinkVerdict),
    reason=maybe(TEXTS),
    method=maybe(st.sampled_from(["icp", "plane-matching", "refinement", "given"])),
    estimate=maybe(ESTIMATES),
    initial_transform=maybe(matrices(4)),
    overlap_from=maybe(NUMBERS),
    overlap_to=maybe(NUMBERS),
    free_space_conflict=maybe(NUMBERS),
    runner_up=maybe(NUMBERS),
    alternatives=st.lists(ESTIMATES, max_size=2).map(tuple),
    hypotheses=maybe(COUNTS),
    evidence=maybe(EVIDENCE),
    paper=maybe(PAPER),
    seconds=st.dictionaries(TEXTS, NUMBERS, max_size=3),
)


def bits(value):
    """A value with the type of everything in it and all bits of its numbers; one NaN is as good as another."""
    if is_dataclass(value):
        return type(value), [bits(getattr(value, f.name)) for f in fields(value)]
    if isinstance(value, np.ndarray):
        return "matrix", value.dtype, value.shape, [bits(number) for number in value.ravel().tolist()]
    if isinstance(value, tuple):
        return "tuple", [bits(item) for item in value]
    if isinstance(value, dict):
        return "dict", {key: bits(item) for key, item in value.items()}
    if isinstance(value, float):
        return "float", "nan" if math.isnan(value) else value.hex()
    return type(value), value


@settings(max_examples=200, deadline=None)
@given(RESULTS)
def test_a_result_comes_back_to_the_bit(result):
    assert bits(from_text(to_text(result))) == bits(result)


FULL_OF_TYPE = {
    float: 1 / 3,
    float | None: 1 / 7,
    bool: True,
    tuple[float, float]: (1 / 3, 2.0),
    int: 500,
}


def full():
    """A result in which everything is told."""
    plane = PlaneEvidence((0.0, 0.0, 1.0), -1.5, 1000, 1, 0.003)
    corner = (1.0, 2.0, 1 / 3)
    pose = np.eye(4) / 3
    return PairResult(
        verdict=LinkVerdict.DOUBTFUL,
        reason="thin",
        method="plane-matching",
        estimate=PoseEstimate(pose, np.eye(6) / 7, Residuals(0.1, 0.2, 0.3, 0.4, 0.5), 1.1, 12),
        initial_transform=pose,
        alternatives=(PoseEstimate(pose),),
        evidence=LinkEvidence(
            **{f.name: FULL_OF_TYPE[f.type] for f in fields(LinkEvidence)} | {"appearance_similarity": None}
        ),
        paper=PaperEvidence(
            planes=PlanesEvidence(
                (plane,) * 3, (plane,) * 3, corner, corner, Ends(9, 8), (0.1, 0.2, 0.3), 0.05
            )
        ),
        seconds={"final": 0.5},
    )


@pytest.mark.parametrize(
    "path",
    [
        ("verdict",),
        ("estimate", "transform"),
        ("evidence", "score"),
        ("evidence", "loose_blocks"),
        ("paper", "planes", "corner_to"),
    ],
)
def test_a_text_that_lacks_something_is_refused(path):
    document = json.loads(to_text(full()))
    place = document
    for key in path[:-1]:
        place = place[key]
    del place[path[-1]]
    with pytest.raises(Exception, match=r".+"):
        from_text(json.dumps(document))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("verdict", "certain"),
        ("estimate", [[1.0, 0.0], [0.0, 1.0]]),
        ("evidence", {"likeness": 0.9}),
        ("initial_transform", "identity"),
        ("alternatives", 7),
    ],
)
def test_a_text_of_another_layout_is_refused(key, value):
    document = json.loads(to_text(full())) | {key: value}
    with pytest.raises(Exception, match=r".+"):
        from_text(json.dumps(document))


@pytest.mark.parametrize("text", ["", "null", "[]", "{", '"accepted"'])
def test_what_is_no_result_is_refused(text):
    with pytest.raises(Exception, match=r".+"):
        from_text(text)


def test_two_results_that_differ_in_a_bit_are_told_apart():
    one = full()
    other = replace(one, estimate=replace(one.estimate, transform=np.nextafter(one.transform, 1.0)))
    assert bits(one) != bits(other) and to_text(one) != to_text(other)
