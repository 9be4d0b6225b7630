import json
from pathlib import Path

import numpy as np
import pye57
import pytest

from trihedral.errors import OutputError
from trihedral.simulate import ScannerOptions, demo_site, make_site, write_site

SMALL = ScannerOptions().with_beams(20_000)


def test_files_hold_what_the_scans_hold_and_the_truth_names_them(tmp_path: Path) -> None:
    site = make_site("office", 3, 2, SMALL)
    scans = list(write_site(site, tmp_path))
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert [s["name"] for s in truth["stations"]] == [s.name for s in scans]
    assert truth["scene"] == "office" and truth["seed"] == 3
    assert truth["scanner"]["range_noise_m"] == SMALL.range_noise_m
    for entry, one in zip(truth["stations"], scans, strict=True):
        assert np.array_equal(entry["project_from_station"], one.project_from_station)
        read = pye57.E57(str(tmp_path / entry["file"])).read_scan_raw(entry["scan_index"])
        valid = read["cartesianInvalidState"] == 0
        assert valid.sum() == len(one) == entry["points"]
        rows, columns = one.grid
        assert len(valid) == rows * columns
        xyz = np.stack([read[f"cartesian{a}"] for a in "XYZ"], axis=1)[valid]
        order = np.lexsort((one.row, one.column))
        assert np.array_equal(xyz.astype(np.float32), one.xyz[order])
        assert np.array_equal(read["rowIndex"][valid], one.row[order])
        assert np.array_equal(read["columnIndex"][valid], one.column[order])


def test_a_folder_with_other_things_is_refused_and_an_earlier_run_replaced(tmp_path: Path) -> None:
    site = make_site("office", 3, 1, SMALL)
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.txt").write_text("mine")
    with pytest.raises(OutputError, match="not empty"):
        list(write_site(site, other))
    assert [p.name for p in other.iterdir()] == ["thesis.txt"]
    again = tmp_path / "again"
    list(write_site(site, again))
    list(write_site(make_site("office", 4, 1, SMALL), again))
    assert len(list(again.glob("*.e57"))) == 1
    assert json.loads((again / "truth.json").read_text())["seed"] == 4


def test_demo_site_is_small_and_needs_no_choices(tmp_path: Path) -> None:
    truth = json.loads(demo_site(tmp_path / "demo").read_text())
    assert 4 <= len(truth["stations"]) <= 5
    assert all(250_000 < s["points"] < 400_000 for s in truth["stations"])
    linked = {n for p in truth["pairs"] if p["overlap"] > 0.3 for n in (p["a"], p["b"])}
    assert linked == {s["name"] for s in truth["stations"]}
