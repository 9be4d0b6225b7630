"""`colorize` and `calibrate` as commands: from files to files, and what they say when they cannot."""

import math
import re
import subprocess
import sys
from pathlib import Path

import cv2
import laspy
import numpy as np
import pytest

from trihedral.io import read_headers, read_photos, read_scan
from trihedral.io.camera import read_camera, write_camera
from trihedral.simulate import RigOptions, make_testbed, write_testbed


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "trihedral", *map(str, arguments)], capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rigs")
    survey = make_testbed("testbed3", 1, RigOptions(points=20_000, picture_size=(160, 120), pictures=4))
    for _ in write_testbed(survey, folder):
        pass
    return folder


def test_a_rig_to_every_format(rigs: Path, tmp_path: Path) -> None:
    done = run("colorize", rigs, "-o", tmp_path / "out", "-q")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 2
    assert re.search(r"scan-10.e57: [\d,]+ of [\d,]+ points coloured \(\d+%\) from 4 pictures", lines[0])
    plain = read_scan(read_headers(rigs / "scan-10.toml")[0])
    colored = read_scan(read_headers(tmp_path / "out" / "scan-10.e57")[0])
    assert np.array_equal(colored.xyz, plain.xyz)
    assert colored.color is not None
    share = (colored.color > 0).any(axis=1).mean()
    assert 0.2 < share < 1.0
    for name in ("one.ply", "one.laz"):
        done = run("colorize", rigs / "scan-10.toml", "-o", tmp_path / name, "-q")
        assert done.returncode == 0, done.stderr
        (header,) = read_headers(tmp_path / name)
        assert header.points == len(plain)
        assert header.has_color
    stored = laspy.read(tmp_path / "one.laz")
    assert np.array_equal(np.asarray(stored.red) >> 8 > 0, colored.color[:, 0] > 0)


def test_loose_pictures_with_a_camera_file(rigs: Path, tmp_path: Path) -> None:
    (header,) = read_headers(rigs / "scan-11.toml")
    photos = read_photos(header)
    for photo in photos:
        (tmp_path / f"{photo.name}.jpg").write_bytes(photo.data)
    camera = tmp_path / "camera.toml"
    # The body's angle is zero in the first picture.
    write_camera(camera, "camera", photos[0].camera, photos[0].station_from_camera)
    with camera.open("a") as stream:
        for k, photo in enumerate(photos):
            stream.write(f"[[picture]]\nfile = '{photo.name}.jpg'\nbody_angle_deg = {90 * k}\n")
    bare = tmp_path / "bare.toml"
    text = (rigs / "scan-11.toml").read_text()
    bare.write_text(text[: text.index("[[camera]]")].replace('"scan-11-line', f'"{rigs}/scan-11-line'))
    done = run("colorize", bare, "-o", tmp_path / "all.ply", "--camera", camera, "-q")
    assert done.returncode == 0, done.stderr
    own = run("colorize", rigs / "scan-11.toml", "-o", tmp_path / "own.ply", "-q")
    assert own.returncode == 0
    first, second = (read_scan(read_headers(tmp_path / name)[0]) for name in ("all.ply", "own.ply"))
    # Matrices went through text and back.
    assert np.abs(first.color.astype(int) - second.color).mean() < 0.05
    one = tmp_path / f"{photos[1].name}.jpg"
    done = run("colorize", bare, "-o", tmp_path / "one.ply", "--camera", camera, "--photos", one, "-q")
    assert "from 1 picture" in done.stdout


def test_what_cannot_be_coloured_is_said(rigs: Path, tmp_path: Path) -> None:
    write_camera(tmp_path / "camera.toml", "c", read_photos(read_headers(rigs / "scan-10.toml")[0])[0].camera)
    picture = rigs / "scan-10-00.jpg"
    points = tmp_path / "points.xyz"
    points.write_text("\n".join(f"{math.cos(k)} {math.sin(k)} {k % 7}" for k in range(100)) + "\n")
    cases: list[tuple[list[object], str]] = [
        ([points, "-o", tmp_path / "x.ply"], "points.xyz, scan points: it holds no pictures"),
        ([points, "-o", tmp_path / "x.ply", "--photos", picture], "need the file of their camera"),
        (
            [points, "-o", tmp_path / "x.ply", "--photos", picture, "--camera", tmp_path / "camera.toml"],
            "it does not say where scan-10-00.jpg was taken",
        ),
        ([rigs, "-o", tmp_path / "x.ply"], "x.ply holds one scan; 2 were given"),
    ]
    for arguments, reason in cases:
        done = run("colorize", *arguments, "-q")
        assert done.returncode == 2, (arguments, done.stdout)
        assert reason in done.stderr
        assert not (tmp_path / "x.ply").exists()
    existing = tmp_path / "there.ply"
    existing.write_text("keep")
    done = run("colorize", rigs / "scan-10.toml", "-o", existing, "-q")
    assert done.returncode == 2
    assert "it exists already" in done.stderr
    assert existing.read_text() == "keep"


def board(turn: np.ndarray, path: Path) -> None:
    """A picture of a board with 7 x 5 inner corners of 40 mm by a camera of focal length 500."""
    flat = np.full((700, 900), 255, np.uint8)
    for i in range(8):
        for j in range(6):
            if (i + j) % 2 == 0:
                flat[50 + 100 * j : 150 + 100 * j, 50 + 100 * i : 150 + 100 * i] = 0
    matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    metres = np.array([[0.0004, 0, -0.18], [0, 0.0004, -0.14], [0, 0, 1]])
    rotation = cv2.Rodrigues(turn)[0]
    onto = matrix @ np.column_stack([rotation[:, :2], [0.0, 0.0, 0.45]]) @ metres
    image = cv2.warpPerspective(flat, onto, (640, 480), flags=cv2.INTER_AREA, borderValue=200)
    cv2.imwrite(str(path), cv2.GaussianBlur(image, (0, 0), 0.8))


def test_calibrate_from_pictures_and_then_from_pairs(tmp_path: Path) -> None:
    turns = [(0.4, 0, 0), (-0.4, 0.1, 0), (0, 0.45, 0.2), (0.1, -0.4, 0), (0.3, 0.3, 0.1), (0, 0, 0)]
    for k, turn in enumerate(turns):
        board(np.array(turn, np.float64), tmp_path / f"board{k}.png")
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((480, 640), 90, np.uint8))
    camera = tmp_path / "camera.toml"
    pictures = sorted(tmp_path.glob("*.png"))
    done = run("calibrate", tmp_path, "-o", camera, "--pattern", "7x5", "--square-mm", 40)
    assert done.returncode == 0, done.stderr
    assert "empty.png: no whole board of 7 x 5 inner corners found" in done.stderr
    for k in range(len(turns)):
        assert re.search(rf"board{k}.png: 0\.\d+ px", done.stdout)
    assert re.search(r"all: 0\.\d+ px RMS reprojection error of 6 pictures", done.stdout)
    found = read_camera(camera)
    assert found.model.focal == pytest.approx((500, 500), rel=0.02)
    assert found.model.centre == pytest.approx((320, 240), abs=8)
    assert found.body_from_camera is None

    pairs = tmp_path / "pairs.csv"
    points = np.random.default_rng(0).uniform([-2, -1.5, 4], [2, 1.5, 8], (8, 3))
    fx, fy = found.model.focal
    matrix = np.array([[fx, 0, found.model.centre[0]], [0, fy, found.model.centre[1]], [0, 0, 1]])
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(found.model.distortion))[0]
    rows = np.column_stack([points + np.array([10.0, 20.0, 1.0]), pixels[:, 0]])
    pairs.write_text("x,y,z,column,row\n" + "\n".join(",".join(map(str, row)) for row in rows))
    posed = tmp_path / "posed.toml"
    done = run("calibrate", "--camera", camera, "--pairs", pairs, "-o", posed)
    assert done.returncode == 0, done.stderr
    assert "pair 8: 0.00 px" in done.stdout
    assert read_camera(posed).body_from_camera[:3, 3] == pytest.approx([10, 20, 1], abs=1e-4)

    done = run("calibrate", *pictures[:2], "-o", tmp_path / "two.toml", "--pattern", "7x5")
    assert done.returncode == 2
    assert "2 of the pictures show a whole board; at least 3 are needed" in done.stderr
    assert not (tmp_path / "two.toml").exists()
    pairs.write_text("1,2,3,4,5\n2,3,4,5,6\n")
    done = run("calibrate", "--camera", camera, "--pairs", pairs, "-o", tmp_path / "bad.toml")
    assert done.returncode == 2
    assert "2 pairs are given; at least 4" in done.stderr


def test_pictures_of_two_sizes_are_refused(tmp_path: Path) -> None:
    for name, size in (("a.png", (480, 640)), ("b.png", (240, 320))):
        cv2.imwrite(str(tmp_path / name), np.zeros(size, np.uint8))
    done = run("calibrate", tmp_path / "a.png", tmp_path / "b.png", "-o", tmp_path / "c.toml")
    assert done.returncode == 2
    assert "b.png: it has 320 x 240 pixels, a.png has 640 x 480" in done.stderr
    done = run("calibrate", tmp_path / "nowhere.png", "-o", tmp_path / "c.toml")
    assert done.returncode == 2
    assert "nowhere.png: there is no such file" in done.stderr
