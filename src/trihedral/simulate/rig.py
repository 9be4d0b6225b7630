"""The paper's instrument: four line scanners and a camera on a body that turns on a mobile robot.

Kim, Chen and Cho (2017): 80 m range, fans of 190 degrees, 0.1667 degrees between beams and 0.072 degrees between
profiles, eight pictures a turn.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from trihedral.fusion.kinematics import beam_origins, profile_points, station_from_body
from trihedral.fusion.rig import LineScanner, Profiles, RigCamera
from trihedral.geometry.arrays import Float32, Float64
from trihedral.geometry.se3 import Matrix, motion, rotation_about_z
from trihedral.parallel import ordered_map, processors
from trihedral.simulate.beam import STEEP, Beam, footprints, with_mixed
from trihedral.simulate.material import GLOSS
from trihedral.simulate.mesh import rotated
from trihedral.simulate.optics import follow, looks_at
from trihedral.simulate.option_checks import check, not_negative
from trihedral.simulate.photograph import Exposure, photograph, typical_camera
from trihedral.simulate.returns import ReturnKind, Returns
from trihedral.simulate.scanner import CHUNK
from trihedral.simulate.snapshot import Snapshot
from trihedral.simulate.tracer import dot

SCANNERS = 4


@dataclass(frozen=True)
class RigOptions:
    """The rig and what it does; the defaults are the paper's where it states them."""

    #: Beams a station of all scanners together; the full density is 22.8 million.
    points: int = 600_000
    #: Of each line scanner, half up and half down.
    fan_deg: float = 190.0
    #: Between beams at full density.
    beam_step_deg: float = 0.1667
    #: Between profiles of one scanner at full density.
    body_step_deg: float = 0.072
    #: Below it a beam meets the robot itself and is dropped.
    lowest_deg: float = -62.0
    #: Nothing nearer is measured.
    min_range_m: float = 0.5
    #: Nothing farther is measured.
    max_range_m: float = 80.0
    #: One sigma; typical of such line scanners.
    range_noise_m: float = 0.008
    #: Ranges are written in whole steps.
    range_step_m: float = 0.001
    #: One sigma, each axis, of the beam's direction against the recorded one.
    angular_noise_deg: float = 0.01
    #: At the exit.
    beam_diameter_m: float = 0.0136
    #: Full angle.
    beam_divergence_rad: float = 0.0047
    #: Echoes nearer to each other than this are averaged.
    pulse_length_m: float = 0.5
    #: Beams lost at random, 0..1.
    dropout_share: float = 0.002
    #: A turn.
    pictures: int = 8
    #: Columns, rows.
    picture_size: tuple[int, int] = (1024, 768)
    #: How the camera exposes.
    exposure: Exposure = field(default_factory=Exposure)

    def __post_init__(self) -> None:
        sides_good = min(self.picture_size) >= 32 and max(self.picture_size) <= 8192
        range_good = 0 < self.min_range_m < self.max_range_m
        check(
            "Rig",
            [
                (
                    10_000 <= self.points <= 25_000_000,
                    "points must lie between 10,000 and 25,000,000 a station",
                ),
                (0 < self.fan_deg <= 360, "fan_deg must lie between 0 and 360"),
                (0 < self.beam_step_deg < self.fan_deg, "beam_step_deg must be positive and below fan_deg"),
                (0 < self.body_step_deg <= 90, "body_step_deg must lie between 0 and 90"),
                (-90 <= self.lowest_deg <= 90, "lowest_deg must lie between -90 and 90"),
                (range_good, "min_range_m must be positive and below max_range_m"),
                (self.range_step_m > 0, "range_step_m must be positive"),
                (self.pulse_length_m > 0, "pulse_length_m must be positive"),
                (0 <= self.dropout_share < 1, "dropout_share must lie in 0..1"),
                (0 <= self.pictures <= 360, "pictures a turn must lie between 0 and 360"),
                (sides_good, "pictures must have 32 to 8192 pixels a side"),
                *not_negative(self, "range_noise_m", "angular_noise_deg"),
                *not_negative(self, "beam_diameter_m", "beam_divergence_rad"),
            ],
        )

    @property
    def beam(self) -> Beam:
        """Its width and its pulse."""
        return Beam(self.beam_diameter_m, self.beam_divergence_rad, self.pulse_length_m)

    @property
    def thinning(self) -> tuple[int, int]:
        """Every how many-th beam of a fan, and every how many-th profile, is taken.

        As near to square cells as whole numbers allow: the profiles of the four scanners interleave.
        """
        square = math.sqrt(360.0 * self.fan_deg / self.points)
        beams = max(1, round(square / self.beam_step_deg))
        profiles = 360.0 * self.fan_deg / (self.points * beams * self.beam_step_deg)
        return beams, max(1, round(profiles * SCANNERS / self.body_step_deg))

    @property
    def beam_angles(self) -> Float64:
        """(B,) rad, upwards."""
        count = int(self.fan_deg / self.beam_step_deg)
        every = self.thinning[0]
        angles = (np.arange(0, count + 1, every) - count / 2.0) * self.beam_step_deg
        return np.asarray(np.radians(angles))

    @property
    def body_angles(self) -> Float64:
        """(P,) rad, one turn."""
        # A multiple of the scanners, so that the arms of all of them pass over the same directions.
        count = SCANNERS * max(2, round(360.0 / self.body_step_deg / self.thinning[1] / SCANNERS))
        return np.asarray(np.arange(count) * (2.0 * math.pi / count))


@dataclass(frozen=True)
class Rig:
    """Line scanners and camera, each where its own calibration found it."""

    scanners: tuple[LineScanner, ...]
    camera: RigCamera


def paper_rig(options: RigOptions) -> Rig:
    """Four line scanners at right angles, a few millimetres and hundredths of a degree off; a camera above them."""
    rng = np.random.default_rng(20170705)
    scanners = []
    for k in range(SCANNERS):
        lean = np.radians(0.04) * rng.standard_normal(3)
        turn = rotation_about_z(k * math.pi / 2 + lean[2]) @ _leaning(lean[0], lean[1])
        d, h = 0.225 + 0.002 * rng.standard_normal(), 1.320 + 0.002 * rng.standard_normal()
        scanners.append(LineScanner(f"line-{k + 1}", round(d, 4), round(h, 4), motion(turn)))
    # Camera axes on the body: x to the right, y down, z outwards along the body's x.
    outward = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    lean = _leaning(math.radians(0.6), math.radians(4.0))
    place = np.array([0.085, 0.012, 1.655])
    camera = RigCamera("camera", typical_camera(*options.picture_size), motion(lean @ outward, place))
    return Rig(tuple(scanners), camera)


def _leaning(about_x: float, about_y: float) -> Matrix:
    cx, sx, cy, sy = math.cos(about_x), math.sin(about_x), math.cos(about_y), math.sin(about_y)
    return np.array([[cy, sy * sx, sy * cx], [0.0, cx, -sx], [-sy, cy * sx, cy * cx]])


@dataclass(frozen=True)
class RigScan:
    """What the rig measured at one station."""

    #: Of each line scanner.
    profiles: tuple[Profiles, ...]
    #: (H, W, 3) uint8 and the body's angle (rad), each.
    pictures: tuple[tuple[np.ndarray, float], ...]
    #: (N, 3) noise-free points on surfaces that stand still, project frame.
    still: Float64

    @property
    def points(self) -> int:
        """Beams that returned."""
        return sum(int(np.count_nonzero(one.ranges)) for one in self.profiles)


def measure(
    rig: Rig,
    snapshot: Snapshot,
    project_from_station: Matrix,
    options: RigOptions,
    seed: tuple[int, ...],
    done: Callable[[str], None] = lambda what: None,
) -> RigScan:
    """Turn the rig once around; `seed` fixes every bit, whatever the number of threads.

    `done` is told the name of each line scanner and picture that is done.
    """
    turn, threads = _Turn(rig, snapshot, project_from_station, options, seed), processors()
    lines = ordered_map(
        turn.line, range(len(rig.scanners)), threads, lambda item, result: done(rig.scanners[item].name)
    )
    pictures = ordered_map(
        turn.picture, range(options.pictures), threads, lambda item, result: done(f"picture {item + 1}")
    )
    still = np.concatenate([points for _, points in lines])
    return RigScan(tuple(profiles for profiles, _ in lines), tuple(pictures), still)


@dataclass(frozen=True)
class _Sweep:
    """Some profiles of a line scanner, beam by beam."""

    #: (N,) float32, 0 without a return.
    ranges: Float32
    #: (N,) float32 in 0..1.
    intensity: Float32
    #: Where the beams ended, without noise.
    exact: Returns


@dataclass(frozen=True)
class _Turn:
    """The rig's turn at one station."""

    rig: Rig
    snapshot: Snapshot
    project_from_station: Matrix
    options: RigOptions
    seed: tuple[int, ...]

    def picture(self, number: int) -> tuple[np.ndarray, float]:
        """One picture and the body's angle."""
        angle, camera, here = 2.0 * math.pi * number / self.options.pictures, self.rig.camera, self.snapshot
        image = photograph(
            here.tracer,
            here.light,
            camera.model,
            self.project_from_station @ station_from_body(angle) @ camera.body_from_camera,
            self.options.exposure,
            (*self.seed, 22, number),
            shadows=here.shadows,
        )
        return image, angle

    def line(self, number: int) -> tuple[Profiles, Float64]:
        """One line scanner's profiles, and noise-free points on what stands still."""
        options, scanner, pose = self.options, self.rig.scanners[number], self.project_from_station
        beams, turns = options.beam_angles, options.body_angles
        # Each scanner begins a quarter of a step later than the one before.
        turns = turns + number / SCANNERS * (turns[1] - turns[0])
        centres = beam_origins(scanner, turns)
        ranges = np.zeros((len(turns), len(beams)), np.float32)
        intensity = np.zeros_like(ranges)
        still: list[Float64] = []
        block = max(1, CHUNK // len(beams))
        for part, first in enumerate(range(0, len(turns), block)):
            chosen = slice(first, first + block)
            origins = np.repeat(centres[chosen], len(beams), axis=0)
            ends = profile_points(scanner, turns[chosen], beams, np.ones((len(turns[chosen]), len(beams))))
            nominal = ends.reshape(-1, 3) - origins
            start = rotated(pose[:3, :3], origins) + pose[:3, 3]
            sent = rotated(pose[:3, :3], nominal)
            sweep = self.sweep(start, sent, len(beams), (*self.seed, 21, number, part))
            # The robot itself is in the way of the lowest beams.
            returned = (sweep.ranges > 0) & (nominal[:, 2] > math.sin(math.radians(options.lowest_deg)))
            ranges[chosen] = np.where(returned, sweep.ranges, 0.0).reshape(-1, len(beams))
            intensity[chosen] = np.where(returned, sweep.intensity, 0.0).reshape(-1, len(beams))
            stands = (sweep.exact.face >= 0) & (sweep.exact.face < self.snapshot.fixed_faces)
            kept = returned & stands & (sweep.exact.kind != ReturnKind.MIXED)
            still.append(sweep.exact.point[kept])
        return Profiles(scanner, turns, beams, ranges, intensity), np.concatenate(still)

    def sweep(self, start: Float64, sent: Float64, beams: int, seed: tuple[int, ...]) -> _Sweep:
        """Measure some profiles of so many beams each."""
        options, tracer, rng = self.options, self.snapshot.tracer, np.random.default_rng(seed)
        n = len(start)
        range_draw, bright_draw = rng.standard_normal((2, n), np.float32)
        dropped = rng.random(n) < options.dropout_share
        wobble = np.radians(options.angular_noise_deg) * rng.standard_normal((n, 3))
        sent = sent + wobble
        sent /= np.sqrt(dot(sent, sent))[:, None]
        thin = Returns.along(follow(tracer, start, sent))
        over = np.flatnonzero(self.jumps(thin.distance.reshape(-1, beams)))
        footprint = footprints(tracer, options.beam, start, sent, over, rng)
        exact = with_mixed(tracer, options.beam.pulse, thin, over, footprint)

        alive = np.flatnonzero(exact.within(options.min_range_m, options.max_range_m) & ~dropped)
        hit = exact.of(alive)
        size = options.beam_diameter_m + options.beam_divergence_rad * hit.distance
        _, reflectance = looks_at(tracer, hit.face, hit.point, size)
        gloss = GLOSS[tracer.mesh.material[hit.face]]
        back = hit.share * reflectance * hit.cosine * (1.0 - 0.7 * gloss)
        signal = back * (10.0 / np.maximum(hit.distance, 1.0)) ** 2
        # White paper at 80 m returns a signal of 0.012; a tenth of it is still seen, as data sheets give it.
        seen = signal * (1.0 + 0.3 * bright_draw[alive]) > 1e-3
        alive, r, back = alive[seen], hit.distance[seen], back[seen]
        ranges, intensity = np.zeros(n, np.float32), np.zeros(n, np.float32)
        noisy = r + options.range_noise_m * range_draw[alive]
        ranges[alive] = np.rint(noisy / options.range_step_m) * options.range_step_m
        bright = back / (1.0 + r / 80.0) * (1.0 + 0.04 * bright_draw[alive])
        intensity[alive] = np.rint(np.clip(bright, 0.0, 1.0) * 255.0) / np.float32(255.0)
        return _Sweep(ranges, intensity, exact)

    def jumps(self, near: Float64) -> np.ndarray:
        """(profiles, beams) whether the footprint of this wide beam may lie on both sides of a jump in range."""
        spacing = math.radians(self.options.beam_step_deg * self.options.thinning[0])
        with np.errstate(invalid="ignore"):
            gentle = STEEP * spacing * np.minimum(near[:, 1:], near[:, :-1])
            apart = ~(np.abs(np.diff(near, axis=1)) < gentle)
        apart &= np.isfinite(near[:, 1:]) | np.isfinite(near[:, :-1])
        jump = np.zeros(near.shape, bool)
        jump[:, 1:] |= apart
        jump[:, :-1] |= apart
        return jump
