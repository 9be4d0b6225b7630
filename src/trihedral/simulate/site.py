"""A simulated site: a scene, stations in it, and their scans one by one."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float64
from trihedral.simulate.lighting import at_another_hour
from trihedral.simulate.mesh import placement, rotated
from trihedral.simulate.patterns import PATTERNS, REGULAR, Pattern
from trihedral.simulate.placement import plan_stations
from trihedral.simulate.scanner import SimulatedScan, scan
from trihedral.simulate.scanner_options import ScannerOptions
from trihedral.simulate.scene import Scene
from trihedral.simulate.scenes import build
from trihedral.simulate.snapshot import Snapshot, with_movers
from trihedral.simulate.tracer import Tracer

MAX_STATIONS = 500


@dataclass(frozen=True)
class Site:
    """A scene with stations in it; iterate for the scans, each made when it is asked for."""

    scene: Scene
    scanner: ScannerOptions
    #: (K, 4, 4) project_from_station, in the order of the scans, which carries no meaning.
    poses: Float64
    #: K names without meaning.
    names: tuple[str, ...]
    still: Tracer = field(repr=False)
    #: A key of `PATTERNS`.
    pattern: str = REGULAR

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[SimulatedScan]:
        return (self.scan(k) for k in range(len(self)))

    def scan(self, k: int) -> SimulatedScan:
        """Make scan `k`: the same bits each time."""
        return self.scan_from(k, self.poses[k])

    def scan_from(self, k: int, project_from_station: Float64, *turn: int) -> SimulatedScan:
        """Measure from elsewhere while things stand as they do for scan `k`; numbers of `turn` draw other noise."""
        rng = np.random.default_rng((self.scene.seed, 7, k))
        origin = self.poses[k][:3, 3]
        scene, changes = self.scene, self.scanner.light_changes
        tracer = with_movers(scene, self.still, origin, 0.8, 8, rng)
        light = scene.light
        if changes:
            light = at_another_hour(light, origin, np.random.default_rng((scene.seed, 13, k)))
        snapshot = Snapshot(tracer, len(scene.mesh), light, changes)
        seed = (scene.seed, 11, k, *turn)
        beams = self.beams(k, *turn)
        return scan(snapshot, project_from_station, self.scanner, seed, self.names[k], beams)

    def beams(self, k: int, *turn: int) -> Pattern:
        """Directions that scan `k` measures in: of a pattern with something random in it, other ones each time."""
        return PATTERNS[self.pattern](self.scanner, np.random.default_rng((self.scene.seed, 37, k, *turn)))


def make_site(
    scene: str,
    seed: int,
    stations: int,
    scanner: ScannerOptions | None = None,
    *,
    overlap: tuple[float, float] = (0.3, 0.7),
    pattern: str = REGULAR,
) -> Site:
    """Build a scene and put stations into it.

    Parameters
    ----------
    scene
        One of `scenes.SCENES`.
    seed
        0 or more; with the other arguments it fixes every bit of what follows.
    overlap
        Least and most share of a station's view that a station chosen before sees too.
    pattern
        One of `patterns.PATTERNS`: the directions that are measured in.

    Raises
    ------
    OptionError
        An argument makes no sense.
    TrihedralError
        The scene has no room for so many stations.
    """
    if not 1 <= stations <= MAX_STATIONS:
        raise OptionError(f"The number of stations must lie between 1 and {MAX_STATIONS}.")
    if not 0.0 <= overlap[0] < overlap[1] <= 1.0:
        raise OptionError("The overlap must be two increasing shares between 0 and 1.")
    if pattern not in PATTERNS:
        raise OptionError(f"There is no pattern {pattern!r}: choose from {', '.join(PATTERNS)}.")
    options = ScannerOptions() if scanner is None else scanner
    built = build(scene, seed)
    still = Tracer(built.mesh)
    rng = np.random.default_rng((seed, 3, stations))
    positions = plan_stations(built, still, stations, overlap, options.max_range_m, rng)
    order = rng.permutation(stations)
    poses = np.array([_pose(p, options, rng) for p in positions[order]])
    return Site(built, options, poses, _names(rng, stations), still, pattern)


def _pose(position: Float64, options: ScannerOptions, rng: np.random.Generator) -> Float64:
    """Turn a station by any yaw, and lean it by what the compensator leaves or the user asked for."""
    pose = placement(0, 0, 0, rng.uniform(-math.pi, math.pi))
    pose[:3, 3] = position
    lean = np.radians(options.level_sigma_deg) * rng.standard_normal(2)
    lean_by, lean_to = math.radians(rng.uniform(0.0, options.tilt_deg)), rng.uniform(-math.pi, math.pi)
    lean += lean_by * np.array([math.cos(lean_to), math.sin(lean_to)])
    angle = math.hypot(*lean)
    if angle > 0:
        x, y = lean / angle
        c, s, k = math.cos(angle), math.sin(angle), 1 - math.cos(angle)
        tilt = [[c + x * x * k, x * y * k, y * s], [x * y * k, c + y * y * k, -x * s], [-y * s, x * s, c]]
        pose[:3, :3] = rotated(np.array(tilt), pose[:3, :3].T).T
    return pose


def _names(rng: np.random.Generator, count: int) -> tuple[str, ...]:
    """Distinct names that tell nothing."""
    letters = "abcdefghjkmnpqrstuvwxyz"
    names: list[str] = []
    while len(names) < count:
        name = "".join(letters[int(i)] for i in rng.integers(0, len(letters), 5))
        if name not in names:
            names.append(name)
    return tuple(names)
