"""The weights of the evidence are those that its table gives."""

import numpy as np
import pytest
from benchmarks.belief import SIGNS, Table, fit
from benchmarks.table import RESULTS

from trihedral.verdict.evidence import BEYOND_DOUBT, CONSTANT, WEIGHTS


@pytest.fixture(scope="module")
def table():
    return Table.read(RESULTS / "belief.csv")


def test_the_committed_table_gives_the_committed_weights(table):
    use = ~table.copy & ~table.gate
    found = fit(table.x[use], table.pair[use], table.right[use])
    assert found == pytest.approx([CONSTANT, *WEIGHTS.values()], rel=0.01)
    median = np.median(table.x[use & table.right], axis=0)
    assert median == pytest.approx(BEYOND_DOUBT, rel=0.01, abs=1e-3)


def test_each_weight_has_the_sign_of_its_meaning():
    assert np.sign(list(WEIGHTS.values())).tolist() == list(SIGNS)


def test_the_fit_finds_the_weights_that_made_the_choices():
    # 6,000 pairs of two poses each; one of them or none is right by the conditional logit's own probabilities.
    rng = np.random.default_rng(1)
    true = np.array([-0.5, *(np.array(SIGNS) * rng.uniform(0.5, 1.5, len(SIGNS)))])
    x = rng.normal(size=(6000, 2, len(SIGNS)))
    odds = np.exp(x @ true[1:] + true[0])
    chance = odds / (1 + odds.sum(axis=1, keepdims=True))
    drawn = rng.random((6000, 1))
    right = np.concatenate(
        [drawn < chance[:, :1], (drawn >= chance[:, :1]) & (drawn < chance.sum(1)[:, None])], 1
    )
    pair = np.repeat(np.arange(6000).astype(str), 2)
    assert fit(x.reshape(-1, len(SIGNS)), pair, right.ravel()) == pytest.approx(true, abs=0.12)
