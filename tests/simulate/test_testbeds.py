"""The paper's testbeds: geometry of the rig's data, pictures that land where they should, what the paper states."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.errors import OptionError, OutputError
from trihedral.fusion.texture import colorize, views
from trihedral.io import find_inputs, read_headers, read_photos, read_scan
from trihedral.simulate import TESTBEDS, RigOptions, make_testbed, write_testbed
from trihedral.simulate.photograph import Exposure
from trihedral.simulate.survey import Survey

SMALL = RigOptions(points=60_000, picture_size=(256, 192))


@pytest.fixture(scope="module")
def indoors(tmp_path_factory: pytest.TempPathFactory) -> tuple[Survey, Path]:
    folder = tmp_path_factory.mktemp("testbed3")
    survey = make_testbed("testbed3", 1, SMALL)
    for _ in write_testbed(survey, folder):
        pass
    return survey, folder


def test_points_lie_on_the_scene(indoors: tuple[Survey, Path]) -> None:
    survey, folder = indoors
    for k, path in enumerate(find_inputs([folder])):
        scan = read_scan(read_headers(path)[0])
        assert len(scan) > 25_000
        pose = survey.poses[k]
        head = pose[:3, :3] @ scan.header.scanner_origin + pose[:3, 3]
        project = scan.xyz @ pose[:3, :3].T + pose[:3, 3]
        offset = project - head
        distance = np.linalg.norm(offset, axis=1)
        _, length = survey.still.cast(np.broadcast_to(head, offset.shape), offset / distance[:, None])
        # From the axis, not from the line scanners' own centres: some points are hidden there.
        off = np.abs(length - distance)
        assert np.median(off) == pytest.approx(0.0067, abs=0.003)  # 8 mm of noise, sigma
        assert np.mean(off < 0.05) > 0.9


def test_truth_is_what_the_tables_state(indoors: tuple[Survey, Path]) -> None:
    _, folder = indoors
    truth = json.loads((folder / "truth.json").read_text())
    first, second = (np.array(one["project_from_station"]) for one in truth["stations"])
    relative = second[:3, :3].T @ first[:3, :3]
    angles = Rotation.from_matrix(relative).as_euler("xyz", degrees=True)
    assert angles == pytest.approx((-17.404, -3.155, 29.899), abs=1e-6)
    (pair,) = truth["pairs"]
    assert pair["distance_m"] == pytest.approx(3.0, abs=0.01)
    assert pair["paper_overlap"] == 0.96
    assert pair["overlap"] > 0.85


def test_pictures_land_on_what_they_show(indoors: tuple[Survey, Path]) -> None:
    survey, folder = indoors
    (header,) = read_headers(folder / "scan-10.toml")
    scan, photos = read_scan(header), read_photos(header)
    assert len(photos) == 8
    found = views(scan, photos)
    pose = survey.poses[0]
    matrix = np.array(
        [
            [photos[0].camera.focal[0], 0, photos[0].camera.centre[0]],
            [0, photos[0].camera.focal[1], photos[0].camera.centre[1]],
            [0, 0, 1],
        ]
    )
    off = []
    for view, photo in zip(found, photos, strict=True):
        rows, columns = np.nonzero(np.isfinite(view.points[..., 0]) & ~view.edge)
        points = view.points[rows, columns].astype(np.float64)
        # The truth by OpenCV's lens model and rays into the scene.
        preview = cv2.undistortPoints(
            np.column_stack([columns, rows]).astype(np.float64)[:, None],
            matrix,
            np.array(photo.camera.distortion),
            P=np.eye(3),
        )[:, 0]
        rays = np.column_stack([preview, np.ones(len(preview))])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        place = pose @ photo.station_from_camera
        directions = rays @ place[:3, :3].T
        _, length = survey.still.cast(np.broadcast_to(place[:3, 3], directions.shape), directions)
        truth = (place[:3, 3] + directions * length[:, None] - pose[:3, 3]) @ pose[:3, :3]
        off.append(np.linalg.norm(points - truth, axis=1))
    off = np.concatenate(off)
    assert len(off) > 20_000
    assert np.median(off) < 0.012
    # People and chairs that moved are in the scan and the pictures, not in the standing scene.
    assert np.mean(off < 0.08) > 0.85


def test_colours_fit_better_than_with_the_camera_turned(indoors: tuple[Survey, Path]) -> None:
    """Pictures that overlap show the same thing in the same point only if the geometry is right."""
    _, folder = indoors
    (header,) = read_headers(folder / "scan-11.toml")
    scan, photos = read_scan(header), read_photos(header)

    def disagreement(turn: float) -> float:
        turned = Rotation.from_euler("z", turn, degrees=True).as_matrix()
        values = []
        for k, photo in enumerate(photos):
            pose = photo.station_from_camera.copy()
            # Every other camera is turned one way, the rest the other way.
            pose[:3, :3] = (turned if k % 2 else turned.T) @ pose[:3, :3]
            one = colorize(scan, [type(photo)(photo.name, photo.encoding, photo.data, photo.camera, pose)])
            values.append(np.where(one.colored[:, None], one.color.astype(float), np.nan).mean(axis=1))
        off = []
        for k in range(len(values)):
            ratio = np.log(values[k] + 1.0) - np.log(values[k - 1] + 1.0)
            ratio = ratio[np.isfinite(ratio)]
            # Exposures differ from picture to picture.
            off.append(np.abs(ratio - np.median(ratio)))
        return float(np.mean(np.concatenate(off)))

    straight, turned = disagreement(0.0), disagreement(2.0)
    assert straight < 0.7 * turned, (straight, turned)


def test_the_same_seed_gives_the_same_files(indoors: tuple[Survey, Path], tmp_path: Path) -> None:
    _, folder = indoors
    for _ in write_testbed(make_testbed("testbed3", 1, SMALL), tmp_path / "again"):
        pass
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted(path.name for path in (tmp_path / "again").iterdir())
    for name in names:
        assert (folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_what_an_earlier_run_wrote_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(OutputError, match="the folder is not empty"):
        next(write_testbed(make_testbed("testbed3", 1, SMALL), tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_full_density_is_the_papers() -> None:
    full = RigOptions(points=22_800_000)
    assert full.thinning == (1, 1)
    assert len(full.body_angles) == 5000
    assert np.degrees(np.diff(full.body_angles)[0]) == pytest.approx(0.072)
    assert np.degrees(np.diff(full.beam_angles)[0]) == pytest.approx(0.1667)
    assert np.degrees(np.ptp(full.beam_angles)) == pytest.approx(190.0, abs=0.2)
    thin = RigOptions()
    assert 4 * len(thin.body_angles) * len(thin.beam_angles) == pytest.approx(600_000, rel=0.05)


def test_the_plans_distances_are_the_papers_as_far_as_they_can_be() -> None:
    table = {(1, 2): 8, (2, 3): 6, (3, 4): 8, (4, 5): 10, (5, 6): 9, (1, 3): 14, (2, 4): 14, (3, 5): 18,
             (4, 6): 19, (1, 4): 24, (2, 5): 24, (3, 6): 27, (1, 5): 34, (2, 6): 32, (1, 6): 43}  # fmt: skip
    plan = np.array(TESTBEDS["testbed1"].plan)
    for (a, b), distance in table.items():
        assert math.dist(plan[a - 1], plan[b - 1]) == pytest.approx(distance, abs=1.25)
    for name, wanted in (("testbed2", (26.0, 37.0)), ("testbed3", (3.0,))):
        plan = np.array(TESTBEDS[name].plan)
        assert np.linalg.norm(np.diff(plan, axis=0), axis=1) == pytest.approx(wanted, abs=0.02)


@pytest.mark.parametrize(
    "arguments",
    [
        {"points": 10},
        {"fan_deg": 0.0},
        {"beam_step_deg": 200.0},
        {"body_step_deg": 0.0},
        {"lowest_deg": -91.0},
        {"min_range_m": 90.0},
        {"range_step_m": 0.0},
        {"pulse_length_m": 0.0},
        {"dropout_share": 1.0},
        {"pictures": -1},
        {"picture_size": (1, 1)},
        {"range_noise_m": -1.0},
        {"beam_divergence_rad": math.nan},
    ],
)
def test_options_that_make_no_sense(arguments: dict[str, object]) -> None:
    with pytest.raises(OptionError, match=next(iter(arguments)).split("_size")[0]):
        RigOptions(**arguments)


@pytest.mark.parametrize("arguments", [{"automatic": 1.5}, {"vignette": -0.1}, {"noise": math.nan}])
def test_exposures_that_make_no_sense(arguments: dict[str, float]) -> None:
    with pytest.raises(OptionError, match=next(iter(arguments))):
        Exposure(**arguments)


def test_no_such_testbed() -> None:
    with pytest.raises(OptionError, match="no testbed 'testbed9'"):
        make_testbed("testbed9", 1)
