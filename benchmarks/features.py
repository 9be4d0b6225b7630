"""SURF of ours against OpenCV's SIFT on pairs of views whose true pose is known.

    python -m benchmarks.features --seeds 1-2

Sites are simulated once and kept in benchmarks/work/. A match is right when its two 3D points are the same place within
5 cm under the true pose.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.table import RESULTS, WORK, machine, markdown
from trihedral.final.point_to_point import IcpOptions, align
from trihedral.fusion.rendering import RenderingOptions, rendered_views
from trihedral.fusion.texture import views
from trihedral.geometry.se3 import transform
from trihedral.initial.visual.features import FeatureOptions, detect, find_features
from trihedral.initial.visual.matching import match
from trihedral.io.readers import find_inputs, read_headers, read_photos, read_scan
from trihedral.scan.view import View

COMMAND = Path(sys.executable).with_name("trihedral")
RIGHT = 0.05  # metres
# Pairs of pictures are taken by what they show alike, which features have no part in: the share of one picture's points
# that lie within 10 cm of one of the other's.
NEAR, LEAST_SHARED, MOST_PAIRS = 0.10, 0.25, 8
RGBD = Path(__file__).resolve().parents[2] / "shared" / "data" / "rgbd360"
# Metres up to which its depths are good to a few centimetres; share by which a depth edge bends the inverse depth.
SHARP_DEPTH, BEND = 3.0, 0.03
KINDS = {
    "SIFT": FeatureOptions("sift"),
    "SURF": FeatureOptions("surf"),
    "SURF upright": FeatureOptions("surf", surf_upright=True),
    "SURF 128": FeatureOptions("surf", surf_extended=True),
}


@dataclass(frozen=True)
class Pair:
    """Two views and ``b_from_a``."""

    a: View
    b: View
    b_from_a: NDArray[np.float64]


@dataclass
class Tally:
    """What became of one kind of features on one set of pairs."""

    keypoints: int = 0
    matches: int = 0
    right: int = 0
    wall: float = 0.0
    cpu: float = 0.0

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(*(getattr(self, name) + getattr(other, name) for name in vars(self)))


def simulated(scene: str, seed: int, *options: str) -> list[tuple[Path, NDArray[np.float64]]]:
    """Files of the first two stations of a site and their true poses; simulated if they are not there."""
    folder = WORK / "features" / f"{scene}-{seed}"
    if not (folder / "truth.json").exists():
        command = [
            str(COMMAND),
            "simulate",
            scene,
            "--seed",
            str(seed),
            "--quiet",
            *options,
            "-o",
            str(folder),
        ]
        subprocess.run(command, check=True)
    stations = json.loads((folder / "truth.json").read_text())["stations"]
    poses = {station["file"]: np.array(station["project_from_station"]) for station in stations}
    inputs = {str(path.relative_to(folder)): path for path in find_inputs([folder])}
    return [(inputs[name], poses[name]) for name in sorted(poses)[:2]]


def stations(seeds: list[int]) -> Iterator[tuple[str, list[tuple[list[View], NDArray[np.float64]]]]]:
    """Name of a set; views and pose of each of two stations."""
    taken = real()
    if taken:
        yield "real pictures, RGB-D rig", taken
    for seed in seeds:
        rig = simulated("testbed3", seed)
        taken = []
        for path, pose in rig:
            header = read_headers(path)[0]
            taken.append((views(read_scan(header), read_photos(header)), pose))
        yield "rig's pictures, testbed 3", taken
        for scene in ("facade", "warehouse"):
            options = ("--stations", "2", "--points", "2000000", "--overlap", "0.75", "0.97")
            site = [
                (read_scan(read_headers(path)[0]), pose) for path, pose in simulated(scene, seed, *options)
            ]
            for paint in ("color", "intensity"):
                rendering = RenderingOptions(paint=paint)
                yield f"rendered {paint}, {scene}", [(rendered_views(s, rendering), pose) for s, pose in site]


def real() -> list[tuple[list[View], NDArray[np.float64]]]:
    """Two stations of an RGB-D rig, if they are there; the pose between them is that of ICP of their depths alone."""
    found = [_depth_views(RGBD / name) for name in ("station1", "station2") if (RGBD / name).is_dir()]
    if len(found) < 2:
        return []
    clouds = [np.concatenate([_some_points(view, 160) for view in taken]) for taken in found]
    clouds = [cloud[np.linalg.norm(cloud, axis=1) < SHARP_DEPTH] for cloud in clouds]
    b_from_a = np.eye(4)
    for reach in (0.5, 0.2, 0.1, 0.05):
        b_from_a = align(clouds[0], clouds[1], b_from_a, IcpOptions(max_correspondence_distance=reach)).pose
    return [(found[0], b_from_a), (found[1], np.eye(4))]


def _depth_views(folder: Path) -> list[View]:
    taken = []
    for camera in json.loads((folder / "cameras.json").read_text())["cameras"]:
        image = cv2.imread(str(folder / camera["image"]), cv2.IMREAD_GRAYSCALE)
        depth = cv2.imread(str(folder / camera["depth"]), cv2.IMREAD_UNCHANGED) / 1000.0
        depth[depth == 0] = np.nan
        y, x = np.mgrid[: camera["height"], : camera["width"]]
        rays = np.stack(
            [(x - camera["cx"]) / camera["fx"], (y - camera["cy"]) / camera["fy"], np.ones_like(depth)],
            axis=2,
        )
        points = transform(np.array(camera["station_from_camera"]), (rays * depth[..., None]).reshape(-1, 3))
        edge = np.zeros(depth.shape, dtype=bool)
        edge[:, 1:-1] |= np.abs(np.diff(1 / depth, 2, axis=1)) * depth[:, 1:-1] > BEND
        edge[1:-1] |= np.abs(np.diff(1 / depth, 2, axis=0)) * depth[1:-1] > BEND
        points = np.where(edge.reshape(-1, 1), np.nan, points).reshape(rays.shape)
        taken.append(View(camera["image"], np.asarray(image, np.uint8), points.astype(np.float32), edge))
    return taken


def pairs(taken: list[tuple[list[View], NDArray[np.float64]]]) -> list[Pair]:
    (views_a, pose_a), (views_b, pose_b) = taken
    b_from_a = np.linalg.inv(pose_b) @ pose_a
    trees = [cKDTree(_some_points(view)) for view in views_b]
    shared = []
    for i, a in enumerate(views_a):
        moved = transform(b_from_a, _some_points(a))
        for j, tree in enumerate(trees):
            distance, _ = tree.query(moved, distance_upper_bound=NEAR)
            shared.append((float(np.isfinite(distance).mean()), i, j))
    best = [entry for entry in sorted(shared, reverse=True) if entry[0] >= LEAST_SHARED][:MOST_PAIRS]
    return [Pair(views_a[i], views_b[j], b_from_a) for _, i, j in best]


def _some_points(view: View, across: int = 100) -> NDArray[np.float64]:
    step = max(1, round(view.edge.shape[1] / across))
    points = view.points[::step, ::step].reshape(-1, 3).astype(np.float64)
    return points[np.isfinite(points).all(axis=1)]


def tally(found: list[Pair], options: FeatureOptions, rounds: int) -> Tally:
    """Matches over all pairs; time is that of detection and description of every picture, the least of the rounds."""
    total = Tally()
    pictures = {id(view): view for pair in found for view in (pair.a, pair.b)}
    features = {}
    for key, view in pictures.items():
        times = []
        for _ in range(rounds):
            wall, cpu = time.perf_counter(), time.process_time()
            detect(view.image, None, options)
            times.append((time.perf_counter() - wall, time.process_time() - cpu))
        total.wall += min(wall for wall, _ in times)
        total.cpu += min(cpu for _, cpu in times)
        features[key] = find_features(view, options)
        total.keypoints += len(features[key])
    for pair in found:
        a, b = features[id(pair.a)], features[id(pair.b)]
        matches = match(a.descriptors, b.descriptors, signs=(a.sign, b.sign))
        off = np.linalg.norm(transform(pair.b_from_a, a.points[matches.a]) - b.points[matches.b], axis=1)
        total.matches += len(matches)
        total.right += int((off < RIGHT).sum())
    return total


def rows(name: str, count: int, found: dict[str, Tally]) -> Iterator[list[object]]:
    sift = found["SIFT"]
    for kind, one in found.items():
        share = f"{100 * one.right / one.matches:.1f}" if one.matches else "-"
        speed = [
            f"{one.wall:.2f}",
            f"{one.cpu:.2f}",
            f"{sift.wall / one.wall:.1f}",
            f"{sift.cpu / one.cpu:.1f}",
        ]
        yield [name, count, kind, one.keypoints, one.matches, one.right, share, *speed]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", default="1-2", help="such as 1-3")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=RESULTS / "features.md")
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    stated = machine()
    counts: dict[str, int] = {}
    results: dict[str, dict[str, Tally]] = {}
    for name, taken in stations(list(range(int(first), int(last or first) + 1))):
        found = pairs(taken)
        for kind, settings in KINDS.items():
            one = tally(found, settings, options.rounds)
            before = results.setdefault(name, {}).get(kind, Tally())
            results[name][kind] = before + one
            print(name, kind, len(found), one, flush=True)
        counts[name] = counts.get(name, 0) + len(found)
    total = {kind: sum((r[kind] for r in results.values()), Tally()) for kind in KINDS}
    lines = [line for name in results if counts[name] for line in rows(name, counts[name], results[name])]
    lines += rows("all", sum(counts.values()), total)
    head = ["views", "pairs", "features", "keypoints", "matches", "right", "right, %"]
    head += ["wall s", "CPU s", "wall, SIFT's over it", "CPU, SIFT's over it"]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(
        "# SURF of ours beside OpenCV's SIFT\n\n"
        f"Written by `python -m benchmarks.features --seeds {options.seeds}`. Right: both 3D points are one "
        f"place within {100 * RIGHT:.0f} cm under the true pose. Times are of detection and description of all "
        f"pictures, the least of {options.rounds} rounds each; at most {FeatureOptions().most} keypoints a picture. "
        f"Machine: {stated}.\n\n{markdown(head, lines)}"
    )
    print(options.out.read_text())
    return 0


if __name__ == "__main__":
    sys.exit(main())
