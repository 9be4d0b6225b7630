"""The paper's three testbeds: a construction site, a building, a room, with its distances, overlaps and tilts.

Kim, Chen and Cho (2017), Tables 2 to 5. Places are looked for in scenes of `trihedral.simulate.scenes`.
"""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import output_error, write_atomically
from trihedral.errors import OptionError, TrihedralError
from trihedral.geometry.se3 import Matrix, motion
from trihedral.io.rig import write_rig
from trihedral.simulate.covisible import reaches, surface_samples
from trihedral.simulate.files import TRUTH, prepare_folder
from trihedral.simulate.mesh import Float, Rng
from trihedral.simulate.placement import sphere
from trihedral.simulate.rig import Rig, RigOptions, RigScan, measure, paper_rig
from trihedral.simulate.scene import Scene
from trihedral.simulate.scenes import build
from trihedral.simulate.snapshot import Snapshot, with_movers
from trihedral.simulate.tracer import Tracer, dot

HEAD_M = 1.32  # of the line scanners above the ground
CLEAR_M = 0.55  # around the rig's head
ROOM_M = 0.45  # around the robot's foot
PROBE_RAYS = 1500  # sent from a place to learn what it shows
FAR_M = 40.0  # surfaces farther away count no more than at this range, as few rays fall on them
PLACES_TRIED = 60  # of those with room for the robot everywhere
DRAWS = 4000  # of position and direction
SCENES_TRIED = 8
GOOD_ENOUGH = 0.08  # RMS difference of the overlaps from the paper's that ends the search


@dataclass(frozen=True)
class Testbed:
    """What the paper says of a testbed.

    Attributes
    ----------
    scene
        Kind of scene.
    first
        Number of its first scan in the paper.
    plan
        (K, 2) stations in plan, metres, by least squares from the distances; these contradict each other by up to
        1.2 m, as they are rounded and some break the triangle inequality.
    overlap
        Of the pairs that the paper states.
    turns
        Rotations (deg about x, y, z) of the lower scan into the higher one that the paper's tables give as
        "original".
    """

    scene: str
    first: int
    plan: tuple[tuple[float, float], ...]
    overlap: dict[tuple[int, int], float]
    turns: dict[tuple[int, int], tuple[float, float, float]]

    @property
    def stations(self) -> int:
        """How many."""
        return len(self.plan)


TESTBEDS: dict[str, Testbed] = {
    "testbed1": Testbed(
        "site",
        1,
        ((-20.48, -0.47), (-11.30, -0.52), (-5.50, 0.34), (2.83, 1.03), (12.87, 0.94), (21.58, -1.33)),
        {
            (1, 2): 0.93,
            (2, 3): 0.91,
            (3, 4): 0.90,
            (4, 5): 0.88,
            (5, 6): 0.89,
            (1, 3): 0.82,
            (2, 4): 0.85,
            (3, 5): 0.82,
            (4, 6): 0.80,
            (1, 4): 0.68,
            (2, 5): 0.70,
            (3, 6): 0.67,
            (1, 5): 0.57,
            (2, 6): 0.55,
            (1, 6): 0.45,
        },
        {(1, 4): (-15.334, 3.922, 168.125), (4, 6): (9.141, -13.922, 91.421)},
    ),
    "testbed2": Testbed(
        "facade",
        7,
        ((-31.2, 0.4), (-5.3, -1.9), (31.6, 1.0)),
        {(7, 8): 0.70, (8, 9): 0.56},
        {(7, 8): (11.239, -1.928, -78.836), (8, 9): (-8.382, -3.321, 50.329)},
    ),
    "testbed3": Testbed(
        "office",
        10,
        ((-1.5, 0.0), (1.5, 0.0)),
        {(10, 11): 0.96},
        {(10, 11): (-17.404, -3.155, 29.899)},
    ),
}


@dataclass(frozen=True)
class Survey:
    """A testbed in a scene: iterate for the scans, each made when it is asked for.

    Attributes
    ----------
    poses
        (K, 4, 4) project_from_station in the paper's order.
    names
        "scan-1" and so on, numbered as in the paper.
    """

    name: str
    testbed: Testbed
    scene: Scene
    seed: int
    options: RigOptions
    rig: Rig
    poses: Float
    names: tuple[str, ...]
    still: Tracer = field(repr=False)

    def __len__(self) -> int:
        return len(self.names)

    def scan(self, k: int, done: Callable[[str], None] = lambda what: None) -> RigScan:
        """Make scan `k`: the same bits each time."""
        rng = np.random.default_rng((self.seed, 17, k))
        head = self.poses[k][:3, 3] + HEAD_M * self.poses[k][:3, 2]
        tracer = with_movers(self.scene, self.still, head, 1.0, 1, rng)
        outdoors = self.testbed.scene != "office"
        snapshot = Snapshot(tracer, len(self.scene.mesh), self.scene.light, outdoors)
        return measure(self.rig, snapshot, self.poses[k], self.options, (self.seed, 19, k), done)

    def distance(self, a: int, b: int) -> float:
        """Metres between two stations."""
        return float(np.linalg.norm(self.poses[a][:3, 3] - self.poses[b][:3, 3]))


def make_testbed(name: str, seed: int, options: RigOptions | None = None) -> Survey:
    """Find a scene with room for a testbed, where scans overlap as nearly as possible as in the paper.

    Parameters
    ----------
    name
        One of `TESTBEDS`.
    seed
        0 or more; with the options it fixes every bit of what follows.
    options
        The instrument.

    Raises
    ------
    OptionError
        There is no such testbed, or the seed is negative.
    TrihedralError
        No scene of this seed has room.
    """
    if name not in TESTBEDS:
        raise OptionError(f"There is no testbed '{name}': choose from {', '.join(TESTBEDS)}.")
    if seed < 0:
        raise OptionError("The seed must be 0 or more.")
    testbed, options = TESTBEDS[name], options or RigOptions()
    best: tuple[float, Scene, Tracer, Float] | None = None
    # Scenes are drawn until one serves well; some of every kind are too small or too cluttered.
    for attempt in range(SCENES_TRIED):
        scene = build(testbed.scene, seed * 8 + attempt)
        tracer = Tracer(scene.mesh)
        found = _places(testbed, scene, tracer, options, np.random.default_rng((seed, 13, attempt)))
        if found is not None and (best is None or found[0] < best[0]):
            best = (found[0], scene, tracer, found[1])
        if best is not None and best[0] < GOOD_ENOUGH:
            break
    if best is None:
        raise TrihedralError(f"No scene of seed {seed} has room for {name}: choose another seed.")
    _, scene, tracer, places = best
    rotations = _rotations(testbed, np.random.default_rng((seed, 14)))
    poses = np.array([motion(turn, place) for turn, place in zip(rotations, places, strict=True)])
    names = tuple(f"scan-{testbed.first + k}" for k in range(testbed.stations))
    return Survey(name, testbed, scene, seed, options, paper_rig(options), poses, names, tracer)


def _places(
    testbed: Testbed, scene: Scene, tracer: Tracer, options: RigOptions, rng: Rng
) -> tuple[float, Float] | None:
    """Search for places (K, 3) on the ground, and how far their overlaps are from the paper's (RMS)."""
    plan = np.array(testbed.plan)
    low, high = scene.stands.min(axis=0), scene.stands.max(axis=0)
    middle, reach = (low[:2] + high[:2]) / 2, (high[:2] - low[:2]) / 2
    best: tuple[float, Float] | None = None
    tried = 0
    for _ in range(DRAWS):
        turn, mirror = rng.uniform(0.0, 2.0 * math.pi), rng.choice([-1.0, 1.0])
        centre = middle + rng.uniform(-0.8, 0.8, 2) * reach
        c, s = math.cos(turn), math.sin(turn)
        plane = (plan * [1.0, mirror]) @ np.array([[c, s], [-s, c]]) + centre
        if ((plane < low[:2] - 2.0) | (plane > high[:2] + 2.0)).any():
            continue
        places = _on_ground(tracer, scene, plane)
        if places is None:
            continue
        error = _overlap_error(testbed, tracer, places + np.array([0.0, 0.0, HEAD_M]), options)
        if best is None or error < best[0]:
            best = (error, places)
        tried += 1
        if tried >= PLACES_TRIED:
            break
    return best


def _on_ground(tracer: Tracer, scene: Scene, plane: Float) -> Float | None:
    """Give places (K, 3) below (K, 2), or None where the robot has no room or could not drive there."""
    nearest = np.argmin(
        ((scene.stands[None, :, :2] - plane[:, None]) ** 2).sum(axis=2) + 0.2 * scene.stands[None, :, 2] ** 2,
        axis=1,
    )
    level = scene.stands[nearest, 2]
    n = len(plane)
    above = np.column_stack([plane, level + 1.0])
    down = np.broadcast_to(np.array([0.0, 0.0, -1.0]), (n, 3))
    face, drop = tracer.cast(above, down)
    if (face < 0).any() or (np.abs(drop - 1.0) > 0.9).any():
        return None
    z = level + 1.0 - drop
    if np.ptp(z) > 4.0:
        return None
    # Exact in float32, so that Embree and float64 start rays at the same place.
    places = np.rint(np.column_stack([plane, z]) * 1024.0) / 1024.0
    around = sphere(96)
    around = around[around[:, 2] > -0.6]
    heads = np.repeat(places + np.array([0.0, 0.0, HEAD_M]), len(around), axis=0)
    _, near = tracer.cast(heads, np.tile(around, (n, 1)))
    if near.min() < CLEAR_M:
        return None
    level_rays = np.stack([np.cos(k := np.arange(24) * math.pi / 12), np.sin(k), 0.0 * k], axis=1)
    _, near = tracer.cast(
        np.repeat(places + np.array([0.0, 0.0, 0.45]), 24, axis=0), np.tile(level_rays, (n, 1))
    )
    return None if near.min() < ROOM_M else places


def _overlap_error(testbed: Testbed, tracer: Tracer, heads: Float, options: RigOptions) -> float:
    """RMS difference of the overlaps from the paper's."""
    rays = sphere(PROBE_RAYS)
    rays = rays[rays[:, 2] > math.sin(math.radians(options.lowest_deg))]
    seen: list[tuple[Float, Float]] = []
    for head in heads:
        face, length = tracer.cast(np.broadcast_to(head, rays.shape), rays)
        hit = np.flatnonzero(length < options.max_range_m)
        cosine = np.abs(dot(rays[hit], tracer.planes.normal[face[hit]]))
        area = np.minimum(length[hit], FAR_M) ** 2 / np.maximum(cosine, 0.1)
        seen.append((head + rays[hit] * length[hit, None], area))
    squares = []
    for (a, b), wanted in testbed.overlap.items():
        shares = []
        for own, other in ((a, b), (b, a)):
            points, area = seen[own - testbed.first]
            reached = reaches(tracer, heads[other - testbed.first], points, options.max_range_m)
            shares.append(float(area[reached].sum() / max(float(area.sum()), 1e-9)))
        squares.append((min(shares) - wanted) ** 2)
    return math.sqrt(sum(squares) / len(squares))


def euler(degrees: tuple[float, float, float]) -> Matrix:
    """3x3 rotation Rz Ry Rx from angles about x, y and z."""
    x, y, z = (math.radians(angle) for angle in degrees)
    cx, sx, cy, sy, cz, sz = math.cos(x), math.sin(x), math.cos(y), math.sin(y), math.cos(z), math.sin(z)
    return np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )


def _rotations(testbed: Testbed, rng: Rng) -> list[Matrix]:
    """Rotations of the stations: those that the tables chain as they state, the others on uneven ground."""
    last = max(b for _, b in testbed.turns)
    chain: dict[int, Matrix] = {last: np.eye(3)}
    for (a, b), turn in sorted(testbed.turns.items(), reverse=True):
        chain[a] = chain[b] @ euler(turn)
    # The chain as a whole is turned so that no robot leans more than it must.
    best, lean = np.eye(3), math.inf
    for x in np.arange(-16.0, 16.1, 1.0):
        for y in np.arange(-16.0, 16.1, 1.0):
            base = euler((float(x), float(y), 0.0))
            worst = max(math.acos(min(1.0, float((base @ one)[2, 2]))) for one in chain.values())
            if worst < lean:
                best, lean = base, worst
    start = euler((0.0, 0.0, float(rng.uniform(-180.0, 180.0)))) @ best
    rotations = []
    for k in range(testbed.stations):
        number = testbed.first + k
        if number in chain:
            rotations.append(start @ chain[number])
        else:
            tilt = rng.uniform(-6.0, 6.0, 2)
            rotations.append(euler((float(tilt[0]), float(tilt[1]), float(rng.uniform(-180.0, 180.0)))))
    return rotations


def write_testbed(
    survey: Survey, folder: Path | str, done: Callable[[str], None] = lambda what: None
) -> Iterator[tuple[str, RigScan]]:
    """Write a testbed's scans one by one as rigs with their profiles and pictures, then `truth.json`.

    Parameters
    ----------
    survey
        From `make_testbed`.
    folder
        A new or empty folder, or one that an earlier run wrote, whose files are replaced.
    done
        Is told the name of each line scanner and picture that is done.

    Yields
    ------
    Name and scan, once its files are there. `truth.json` is written after the last has been taken.

    Raises
    ------
    OutputError
        The folder holds something else, or cannot be written.
    """
    folder = Path(folder)
    options = survey.options
    files = [
        name
        for station in survey.names
        for name in (
            f"{station}.toml",
            *(f"{station}-{one.name}.npz" for one in survey.rig.scanners),
            *(f"{station}-{number:02d}.jpg" for number in range(options.pictures)),
        )
    ]
    prepare_folder(folder, [*files, TRUTH])
    stations, samples = [], []
    for k, name in enumerate(survey.names):
        one = survey.scan(k, done)
        try:
            write_rig(folder / f"{name}.toml", name, one.profiles, survey.rig.camera, one.pictures)
        except OSError as error:
            raise output_error(folder / f"{name}.toml", error) from error
        stations.append(
            {
                "file": f"{name}.toml",
                "name": name,
                "scan_index": 0,
                "points": one.points,
                "project_from_station": survey.poses[k].tolist(),
            }
        )
        samples.append(surface_samples(one.still))
        yield name, one
    truth = {
        "schema": "trihedral.truth/1",
        "testbed": survey.name,
        "scene": survey.scene.name,
        "scene_seed": survey.scene.seed,
        "seed": survey.seed,
        "rig": asdict(options),
        "stations": stations,
        "pairs": _pairs(survey, samples),
    }
    write_atomically(folder / TRUTH, (json.dumps(truth, indent=1) + "\n").encode())


def _pairs(survey: Survey, samples: list[Float]) -> list[dict[str, object]]:
    """Distance and overlap of each pair, beside the paper's overlap where it states one."""
    pairs: list[dict[str, object]] = []
    heads = survey.poses[:, :3, 3] + HEAD_M * survey.poses[:, :3, 2]
    for a in range(len(survey)):
        for b in range(a + 1, len(survey)):
            shares = [
                _share(survey, heads[other], survey.poses[other], samples[own])
                for own, other in ((a, b), (b, a))
            ]
            first = survey.testbed.first
            pairs.append(
                {
                    "a": survey.names[a],
                    "b": survey.names[b],
                    "distance_m": round(survey.distance(a, b), 3),
                    "overlap": round(min(shares), 4),
                    "overlap_a": round(shares[0], 4),
                    "overlap_b": round(shares[1], 4),
                    "paper_overlap": survey.testbed.overlap.get((first + a, first + b)),
                }
            )
    return pairs


def _share(survey: Survey, head: Float, pose: Matrix, points: Float) -> float:
    """Share of (N, 3) points that a station sees: in range, above the robot, not hidden."""
    if not len(points):
        return 0.0
    offset = points - head
    above: NDArray[np.bool_] = offset @ pose[:3, 2] > math.sin(
        math.radians(survey.options.lowest_deg)
    ) * np.sqrt(dot(offset, offset))
    return float((reaches(survey.still, head, points, survey.options.max_range_m) & above).mean())
