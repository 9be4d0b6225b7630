import csv
import io

import numpy as np
import pytest

from trihedral.geometry.deviation import deviation_angles, displacement_rmse
from trihedral.geometry.se3 import motion
from trihedral.reproduce.experiment import COARSE_M, Trial, coarse_start, paper_tables, wanted
from trihedral.reproduce.plots import figure_5
from trihedral.reproduce.tables import angle_table, as_csv, as_markdown, summary_2, table_2, trial_rows


def trial(
    pair: tuple[int, int], icp: float, planes: float | None, seed: int = 1, testbed: str = "testbed1"
) -> Trial:
    def way(rmse: float | None) -> dict[str, object]:
        angles = None if rmse is None else [0.1, -0.2, 0.3]
        return {
            "final_rmse_m": rmse,
            "final_deg": angles,
            "original_deg": [1.0, 2.0, 3.0],
            "initial_deg": [4.0, 5.0, 6.0],
            "initial_rmse_m": 2.5,
            "reason": None if rmse is not None else "no three planes",
            "verdict": "accepted",
            "method": "plane-matching",
        }

    found = {"coarse-icp": way(icp), "coarse-planes": way(planes), "coarse-rule": way(planes)}
    transforms = {name: None if f["final_rmse_m"] is None else np.eye(4) for name, f in found.items()}
    return Trial(seed, testbed, pair, 9.5, 0.85, found, transforms, {})


def test_the_papers_tables_are_whole_and_every_pair_is_run() -> None:
    tables = paper_tables()
    pairs = {tuple(int(n) for n in row["pair"].split("-")) for row in tables["table2"]}
    assert len(pairs) == 15 and pairs == set(wanted([2])["testbed1"])
    assert set(wanted([3, 4, 5, 6])) == {"testbed1", "testbed2", "testbed3"}
    assert wanted([2, 3, 6])["testbed1"] == wanted([2])["testbed1"]


def test_coarse_starts_are_as_wrong_as_the_papers() -> None:
    points = np.random.default_rng(1).uniform(-25, 25, (3000, 3)) * [1, 1, 0.1]
    true = motion(translation=np.array([20.0, 5.0, 0.0]))
    for key in "abcdefgh":
        start = coarse_start(true, points, key)
        rmse = displacement_rmse(points, start, true)
        assert 0.8 * COARSE_M[0] < rmse < 2.5 * COARSE_M[1]
        angles = np.abs(deviation_angles(start, true))
        assert (angles < [8.5, 5.5, 13.0]).all() and angles.max() > 2.0
        assert np.isclose(np.linalg.det(start[:3, :3]), 1.0)
    assert np.array_equal(coarse_start(true, points, "a"), coarse_start(true, points, "a"))
    assert not np.array_equal(coarse_start(true, points, "a"), coarse_start(true, points, "b"))


def test_table_2_sets_the_median_beside_the_papers_figure_and_names_refusals() -> None:
    trials = [trial((1, 2), 0.1, 0.05, 1), trial((1, 2), 0.3, None, 2), trial((1, 2), 0.2, 0.07, 3)]
    (row,) = table_2(trials)
    assert row["paper ICP m"] == 0.059 and row["ICP m"] == pytest.approx(0.2)
    assert row["planes m"] == pytest.approx(0.06) and row["seeds"] == 3
    assert row["refused"] == "seed 2: no three planes"
    assert summary_2(trials)["planes, median m"] == pytest.approx(0.06)


def test_csv_and_markdown_hold_the_same_rows() -> None:
    rows = table_2([trial((1, 2), 0.1, 0.05), trial((1, 6), 4.0, 0.1)])
    read = list(csv.DictReader(io.StringIO(as_csv(rows))))
    assert [row["pair"] for row in read] == ["1-2", "1-6"] and float(read[1]["ICP m"]) == 4.0
    lines = as_markdown(rows).splitlines()
    assert len(lines) == 4 and all(line.count("|") == lines[0].count("|") for line in lines)
    assert as_csv([]) == "" and as_markdown([]) == ""


def test_angle_tables_begin_with_the_paper() -> None:
    rows = angle_table(5, [trial((10, 11), 0.05, 0.04, testbed="testbed3")])
    assert [row["who"] for row in rows] == ["paper", "seed 1, from a coarse start"]
    assert rows[0]["final deg"] == "0.092, 0.049, -0.127" and rows[1]["final deg"] == "0.100, -0.200, 0.300"


def test_the_figure_draws_every_trial_and_every_figure_of_the_paper() -> None:
    trials = [trial((1, 2), 0.1, 0.05), trial((1, 6), 4.0, None)]
    for against in ("overlap", "distance"):
        drawn = figure_5(trials, against)
        assert drawn.count("<title>paper") == 30
        assert drawn.count("seed 1:") == 3
        assert drawn.count("<svg") == 1 and drawn.rstrip().endswith("</svg>")
    assert len(trial_rows(trials)) == 6
