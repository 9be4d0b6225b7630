"""A testbed in a scene: stations as in the paper, and what the rig measures from them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from trihedral.errors import OptionError, TrihedralError
from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import Matrix, motion
from trihedral.simulate.mesh import Rng
from trihedral.simulate.rig import Rig, RigOptions, RigScan, measure, paper_rig
from trihedral.simulate.scene import Scene
from trihedral.simulate.scenes import build
from trihedral.simulate.snapshot import Snapshot, with_movers
from trihedral.simulate.testbed_places import HEAD_M, PlaceSearch
from trihedral.simulate.testbeds import TESTBEDS, Testbed
from trihedral.simulate.tracer import Tracer

SCENES_TRIED = 8
GOOD_ENOUGH = 0.08  # RMS difference of the overlaps from the paper's that ends the search


@dataclass(frozen=True)
class Survey:
    """A testbed in a scene: iterate for the scans, each made when it is asked for."""

    name: str
    testbed: Testbed
    scene: Scene
    seed: int
    options: RigOptions
    rig: Rig
    #: (K, 4, 4) project_from_station in the paper's order.
    poses: Float64
    #: "scan-1" and so on, numbered as in the paper.
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
    best: tuple[float, Scene, Tracer, Float64] | None = None
    # Scenes are drawn until one serves well; some of every kind are too small or too cluttered.
    for attempt in range(SCENES_TRIED):
        scene = build(testbed.scene, seed * 8 + attempt)
        tracer = Tracer(scene.mesh)
        search = PlaceSearch(testbed, scene, tracer, options)
        found = search.best(np.random.default_rng((seed, 13, attempt)))
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
    for number in range(testbed.first, testbed.first + testbed.stations):
        if number in chain:
            rotations.append(start @ chain[number])
        else:
            tilt = rng.uniform(-6.0, 6.0, 2)
            rotations.append(euler((float(tilt[0]), float(tilt[1]), float(rng.uniform(-180.0, 180.0)))))
    return rotations
