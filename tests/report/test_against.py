import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.errors import InputError
from trihedral.geometry.se3 import motion, transform
from trihedral.report.against import measures, read_poses


def test_measures_of_a_shifted_and_turned_pose() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-5, 5, (4000, 3))
    turn = Rotation.from_euler("xyz", [-15.334, 3.922, 168.125], degrees=True).as_matrix()
    true = motion(turn, np.array([3.0, 4.0, 0.0]))
    shifted = motion(translation=np.array([0.0, 0.3, 0.4])) @ true
    found = measures(true, shifted, true, points, transform(true, points))
    assert found["distance_m"] == pytest.approx(5.0)
    np.testing.assert_allclose(found["original_deg"], [-15.334, 3.922, 168.125], atol=1e-9)
    np.testing.assert_allclose(found["initial_deg"], 0.0, atol=1e-9)
    assert found["initial_rmse_m"] == pytest.approx(0.5)
    assert found["final_rmse_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["overlap"] == {"from": 1.0, "to": 1.0}


def test_rmse_is_over_the_surface_that_both_share() -> None:
    """A turn moves far points more: those that the other scan did not see do not count."""
    near = np.random.default_rng(2).uniform(-2, 2, (2000, 3))
    far = near + np.array([200.0, 0.0, 0.0])
    turned = motion(Rotation.from_euler("z", 1.0, degrees=True).as_matrix())
    both = measures(turned, None, np.eye(4), np.concatenate([near, far]), near)
    alone = measures(turned, None, np.eye(4), near, near)
    assert both["final_rmse_m"] == pytest.approx(alone["final_rmse_m"]) and both["final_rmse_m"] < 0.05
    assert both["initial_deg"] is None and both["initial_rmse_m"] is None
    assert both["overlap"]["from"] == pytest.approx(0.5)


def test_poses_are_read_from_truth_and_from_a_result(tmp_path: Path) -> None:
    pose = motion(translation=np.array([1.0, 2.0, 3.0])).tolist()
    truth, result = tmp_path / "truth.json", tmp_path / "registration.json"
    truth.write_text(json.dumps({"stations": [{"name": "a", "project_from_station": pose}]}))
    result.write_text(json.dumps({"stations": [{"name": "a", "pose": pose}, {"name": "b", "pose": None}]}))
    for path in (truth, result):
        found = read_poses(path)
        assert list(found) == ["a"]
        np.testing.assert_array_equal(found["a"], pose)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"stations": 3}',
        '{"stations": []}',
        '{"stations": [{"name": "a", "pose": [[1, 2], [3, 4]]}]}',
        '{"stations": [{"name": "a", "pose": [[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]}]}',
        "\u0000\u0001",
    ],
)
def test_files_without_poses_are_refused_by_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "truth.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"truth\.json"):
        read_poses(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_poses(tmp_path / "none.json")
