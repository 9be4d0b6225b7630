"""Real scans and which of them show one place: folders of ../shared/data with their truth.json."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import inverse, motion
from trihedral.io.e57 import E57Scan, write_e57

Float64 = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
# Folders whose truth.json places every file in one frame.
ONE_PLACE = ("eth-facade", "pcl-room", "lpm-tutorial", "norlab")
ROOMS = "rooms-tilting-sick"
CAMERAS = "rgbd360"
# Motion from its first station to its second: mean of small_gicp's GICP and Open3D's point-to-plane ICP at 3, 5 and
# 8 cm voxels from no motion, which lie within 3 cm and 0.3 degrees of each other. Rotation vector in degrees, metres.
CAMERAS_TURN, CAMERAS_SHIFT = (0.49, -0.14, 0.19), (0.006, -0.216, -0.211)


@dataclass(frozen=True)
class Place:
    """Stations of one place, in any frame of its own."""

    kind: str  # the folder of the data set
    poses: dict[Path, Float64]  # place_from_station by file


@dataclass(frozen=True)
class Pair:
    """Two files, and the true motion between their stations where they are of one place."""

    kind: str
    a: Path
    b: Path
    b_from_a: Float64 | None

    @property
    def name(self) -> str:
        return f"{self.a.parent.name}/{self.a.stem} - {self.b.parent.name}/{self.b.stem}"


def pairs_of_one_place(places: Sequence[Place]) -> Iterator[Pair]:
    """Every pair of each place."""
    for place in places:
        for a, b in combinations(place.poses, 2):
            yield Pair(place.kind, a, b, inverse(place.poses[b]) @ place.poses[a])


def pairs_of_different_places(places: Sequence[Place], count: int) -> list[Pair]:
    """So many pairs of files of different places, those within one data set first: their places look alike."""
    every = [
        Pair(place.kind if place.kind == other.kind else "between sets", a, b, None)
        for place, other in combinations(places, 2)
        for a in place.poses
        for b in other.poses
    ]
    alike = [pair for pair in every if pair.kind != "between sets"]
    others = [pair for pair in every if pair.kind == "between sets"]
    within = min(len(alike), count - count // 4)
    return [*_spread(alike, within), *_spread(others, count - within)]


def _spread(pairs: list[Pair], count: int) -> list[Pair]:
    """Draw so many without order: the same ones each time."""
    drawn = np.random.default_rng(1).permutation(len(pairs))[:count]
    return [pairs[k] for k in sorted(drawn)]


def real_places(data: Path, work: Path) -> list[Place]:
    """All places of the data that are there."""
    places = [_listed(data / name) for name in ONE_PLACE if (data / name).is_dir()]
    if (data / ROOMS).is_dir():
        places += _rooms(data / ROOMS)
    if (data / CAMERAS).is_dir():
        places.append(_cameras(data / CAMERAS, work))
    return places


def _listed(folder: Path) -> Place:
    """A place whose truth names each file with its pose."""
    stations = _document(folder)["stations"]
    return Place(
        folder.name, {folder / s["file"]: np.array(s["project_from_station"], float) for s in stations}
    )


def _rooms(folder: Path) -> list[Place]:
    """Rooms of which truth says what pairs are of one, with the motion between them: what hangs together is one."""
    known: dict[Path, dict[Path, Float64]] = {path: {} for path in sorted(folder.glob("*.pcd"))}
    for pair in _document(folder)["same_place"]:
        to, moving = folder / f"{pair['to']}.pcd", folder / f"{pair['from']}.pcd"
        to_from = np.array(pair["to_from_from"], float)
        known[to][moving], known[moving][to] = to_from, inverse(to_from)
    places: list[Place] = []
    for first in known:
        if any(first in place.poses for place in places):
            continue
        poses, waiting = {first: np.eye(4)}, [first]
        while waiting:
            at = waiting.pop()
            for path, from_other in known[at].items():
                if path not in poses:
                    poses[path] = poses[at] @ from_other
                    waiting.append(path)
        places.append(Place(folder.name, poses))
    return places


def _cameras(folder: Path, work: Path) -> Place:
    """Two stations of a rig of depth cameras, each made one file."""
    paths = [_station_of_cameras(folder / name, work) for name in ("station1", "station2")]
    turn = Rotation.from_rotvec(CAMERAS_TURN, degrees=True).as_matrix()
    return Place(folder.name, {paths[0]: motion(turn, np.array(CAMERAS_SHIFT)), paths[1]: np.eye(4)})


def _station_of_cameras(folder: Path, work: Path) -> Path:
    """Put the depth pictures of a station together."""
    path = work / "real" / CAMERAS / f"{folder.name}.e57"
    if path.exists():
        return path
    xyz, color = [], []
    for camera in json.loads((folder / "cameras.json").read_text())["cameras"]:
        depth = cv2.imread(str(folder / camera["depth"]), cv2.IMREAD_UNCHANGED) / 1000.0
        image = cv2.cvtColor(cv2.imread(str(folder / camera["image"])), cv2.COLOR_BGR2RGB)
        y, x = np.nonzero(depth)
        z = depth[y, x]
        rays = np.stack(
            [(x - camera["cx"]) / camera["fx"] * z, (y - camera["cy"]) / camera["fy"] * z, z], axis=1
        )
        pose = np.array(camera["station_from_camera"])
        xyz.append(rays @ pose[:3, :3].T + pose[:3, 3])
        color.append(image[y, x])
    path.parent.mkdir(parents=True, exist_ok=True)
    write_e57(
        path, [E57Scan(folder.name, np.concatenate(xyz).astype(np.float32), color=np.concatenate(color))]
    )
    return path


def _document(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "truth.json").read_text())
    return document
