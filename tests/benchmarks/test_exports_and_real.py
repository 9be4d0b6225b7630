"""What the tables of exports and of real pairs count, on results whose errors are put in."""

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks.exports import BY_NAME, errors, extra, row
from benchmarks.real_places import pairs_of_different_places, pairs_of_one_place, real_places
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import inverse, motion

TRUE = {
    "a": motion(None, np.array([1.0, 2.0, 0.0])),
    "b": motion(Rotation.from_euler("z", 40, degrees=True).as_matrix(), np.array([5.0, 0.0, 0.1])),
    "c": motion(Rotation.from_euler("x", 180, degrees=True).as_matrix(), np.array([9.0, 3.0, 0.0])),
}


def record(frame: np.ndarray, off_mm: dict[str, float], parts: dict[str, int]) -> dict:
    """Poses in any frame, off by so many millimetres along x."""
    poses = {
        name: frame @ motion(None, np.array([off_mm.get(name, 0.0) / 1e3, 0.0, 0.0])) @ TRUE[name]
        for name in parts
    }
    return {
        "tied": {name: {"part": parts[name], "pose": pose.tolist()} for name, pose in poses.items()},
        "true": {name: pose.tolist() for name, pose in TRUE.items()},
        "links": [
            {"wrong": False, "accepted": True},
            {"wrong": False, "accepted": False},
            {"wrong": True, "accepted": True},
        ],
        "wrong_stations": 1,
        "seconds": 5.0,
    }


GRID = record(np.eye(4), {"b": 0.1}, {"a": 0, "b": 0, "c": 0})
ELSEWHERE = motion(Rotation.from_euler("y", 90, degrees=True).as_matrix(), np.array([0.0, 7.0, 0.0]))


def test_errors_are_told_from_one_station_whatever_the_frame() -> None:
    here = record(ELSEWHERE, {"b": 0.4, "c": 2.0}, {"a": 0, "b": 0, "c": 0})
    assert errors(here, ["a", "b", "c"]) == pytest.approx({"b": 0.4, "c": 2.0}, abs=1e-6)
    assert extra(here, GRID) == pytest.approx([0.3, 2.0], abs=1e-6)


def test_a_station_in_another_part_is_tied_but_has_no_error_from_the_first() -> None:
    apart = record(ELSEWHERE, {}, {"a": 0, "b": 0, "c": 1})
    assert set(errors(apart, ["a", "b", "c"])) == {"b"}


def test_the_row_counts_what_is_tied_of_the_reference_and_what_is_believed() -> None:
    fewer = record(ELSEWHERE, {"b": 0.4}, {"a": 0, "b": 0})
    cells = row(BY_NAME["no grid"], [fewer], [GRID])
    assert cells[2] == "2 of 3 (67 %)"
    assert cells[4:6] == ["0.30", "0.30"]
    assert cells[7:11] == ["2", "1", "1", "1"]


def test_motions_of_rooms_are_chained_to_all_pairs_of_one_place(tmp_path: Path) -> None:
    folder = tmp_path / "rooms-tilting-sick"
    folder.mkdir()
    for name in ("a", "b", "c", "d", "e"):
        (folder / f"{name}.pcd").touch()
    known = [
        {"to": to, "from": other, "to_from_from": (inverse(TRUE[to]) @ TRUE[other]).tolist()}
        for to, other in (("b", "a"), ("b", "c"))
    ]
    (folder / "truth.json").write_text(json.dumps({"same_place": known}))
    places = real_places(tmp_path, tmp_path)
    same = list(pairs_of_one_place(places))
    assert {(p.a.stem, p.b.stem) for p in same} == {("a", "b"), ("a", "c"), ("b", "c")}
    for pair in same:
        assert pair.b_from_a == pytest.approx(inverse(TRUE[pair.b.stem]) @ TRUE[pair.a.stem], abs=1e-12)
    different = pairs_of_different_places(places, 40)
    ends = {frozenset((p.a.stem, p.b.stem)) for p in different}
    assert ends == {frozenset(pair) for pair in ("ad", "bd", "cd", "ae", "be", "ce", "de")}
    assert all(pair.b_from_a is None for pair in different)
