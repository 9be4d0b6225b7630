"""The paper's instrument: four line scanners and a camera on a body that turns on a mobile robot.

Kim, Chen and Cho (2017): 80 m range, fans of 190 degrees, 0.1667 degrees between beams and 0.072 degrees between
profiles, eight pictures a turn.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from trihedral.errors import OptionError
from trihedral.fusion.kinematics import beam_origins, profile_points, station_from_body
from trihedral.fusion.rig import LineScanner, Profiles, RigCamera
from trihedral.geometry.se3 import Matrix, motion, rotation_about_z
from trihedral.parallel import ordered_map, processors
from trihedral.simulate.beam import STEEP, mixed_returns
from trihedral.simulate.material import GLOSS, looks
from trihedral.simulate.optics import follow
from trihedral.simulate.photograph import Exposure, photograph, typical_camera
from trihedral.simulate.scanner import CHUNK, rotated
from trihedral.simulate.scene import Light
from trihedral.simulate.tracer import Float, Tracer, dot

SCANNERS = 4


@dataclass(frozen=True)
class RigOptions:
    """The rig and what it does; the defaults are the paper's where it states them."""

    points: int = 600_000  # beams a station of all scanners together; the full density is 22.8 million
    fan_deg: float = 190.0  # of each line scanner, half up and half down
    beam_step_deg: float = 0.1667  # between beams at full density
    body_step_deg: float = 0.072  # between profiles of one scanner at full density
    lowest_deg: float = -62.0  # below it a beam meets the robot itself and is dropped
    min_range_m: float = 0.5
    max_range_m: float = 80.0
    range_noise_m: float = 0.008  # one sigma; typical of such line scanners
    range_step_m: float = 0.001  # ranges are written in whole steps
    angular_noise_deg: float = 0.01  # one sigma, each axis, of the beam's direction against the recorded one
    beam_diameter_m: float = 0.0136  # at the exit
    beam_divergence_rad: float = 0.0047  # full angle
    pulse_length_m: float = 0.5  # echoes nearer to each other than this are averaged
    dropout_share: float = 0.002  # beams lost at random
    pictures: int = 8  # a turn
    picture_size: tuple[int, int] = (1024, 768)  # columns, rows
    exposure: Exposure = field(default_factory=Exposure)

    def __post_init__(self) -> None:
        if not 10_000 <= self.points <= 25_000_000:
            raise OptionError("Rig: points a station must lie between 10,000 and 25,000,000.")
        if not 0 <= self.pictures <= 360:
            raise OptionError("Rig: pictures a turn must lie between 0 and 360.")
        if min(self.picture_size) < 32 or max(self.picture_size) > 8192:
            raise OptionError("Rig: pictures must have 32 to 8192 pixels a side.")
        if self.range_noise_m < 0 or self.angular_noise_deg < 0:
            raise OptionError("Rig: noise must not be negative.")
        if not 0 < self.min_range_m < self.max_range_m:
            raise OptionError("Rig: min_range_m must be positive and below max_range_m.")

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
    def beam_angles(self) -> Float:
        """(B,) rad, upwards."""
        count = int(self.fan_deg / self.beam_step_deg)
        every = self.thinning[0]
        angles = (np.arange(0, count + 1, every) - count / 2.0) * self.beam_step_deg
        return np.asarray(np.radians(angles))

    @property
    def body_angles(self) -> Float:
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
    """What the rig measured at one station.

    Attributes
    ----------
    profiles
        Of each line scanner.
    pictures
        (H, W, 3) uint8 and the body's angle (rad), each.
    still
        (N, 3) noise-free points on surfaces that stand still, project frame.
    """

    profiles: tuple[Profiles, ...]
    pictures: tuple[tuple[np.ndarray, float], ...]
    still: Float

    @property
    def points(self) -> int:
        """Beams that returned."""
        return sum(int(np.count_nonzero(one.ranges)) for one in self.profiles)


def measure(
    rig: Rig,
    tracer: Tracer,
    fixed_faces: int,
    light: Light,
    project_from_station: Matrix,
    options: RigOptions,
    seed: tuple[int, ...],
    *,
    shadows: bool,
    done: Callable[[str], None] = lambda what: None,
) -> RigScan:
    """Turn the rig once around.

    Parameters
    ----------
    tracer
        The scene as it is during this turn.
    fixed_faces
        The mesh's first so many faces stand still.
    seed
        Fixes every bit, whatever the number of threads.
    shadows
        Whether the sun casts some in the pictures.
    done
        Is told the name of each line scanner and picture that is done.
    """

    def line(number: int) -> tuple[Profiles, Float]:
        return _line(
            rig.scanners[number],
            number,
            tracer,
            fixed_faces,
            project_from_station,
            options,
            (*seed, 21, number),
        )

    def picture(number: int) -> tuple[np.ndarray, float]:
        angle = 2.0 * math.pi * number / options.pictures
        image = photograph(
            tracer,
            light,
            rig.camera.model,
            project_from_station @ station_from_body(angle) @ rig.camera.body_from_camera,
            options.exposure,
            (*seed, 22, number),
            shadows=shadows,
        )
        return image, angle

    lines = ordered_map(
        line, range(len(rig.scanners)), processors(), lambda item, result: done(rig.scanners[item].name)
    )
    pictures = ordered_map(
        picture, range(options.pictures), processors(), lambda item, result: done(f"picture {item + 1}")
    )
    still = [points for _, points in lines]
    return RigScan(tuple(one for one, _ in lines), tuple(pictures), np.concatenate(still))


def _line(
    scanner: LineScanner,
    number: int,
    tracer: Tracer,
    fixed_faces: int,
    pose: Matrix,
    options: RigOptions,
    seed: tuple[int, ...],
) -> tuple[Profiles, Float]:
    """One line scanner's profiles, and noise-free points on what stands still."""
    beams, turns = options.beam_angles, options.body_angles
    # Each scanner begins a quarter of a step later than the one before.
    turns = turns + number / SCANNERS * (turns[1] - turns[0])
    centres = beam_origins(scanner, turns)
    ranges = np.zeros((len(turns), len(beams)), np.float32)
    intensity = np.zeros_like(ranges)
    still: list[Float] = []
    block = max(1, CHUNK // len(beams))
    for part, first in enumerate(range(0, len(turns), block)):
        chosen = slice(first, first + block)
        origins = np.repeat(centres[chosen], len(beams), axis=0)
        ends = profile_points(scanner, turns[chosen], beams, np.ones((len(turns[chosen]), len(beams))))
        nominal = ends.reshape(-1, 3) - origins
        start = rotated(pose[:3, :3], origins) + pose[:3, 3]
        measured, bright, exact = _beams(
            tracer, start, rotated(pose[:3, :3], nominal), len(beams), options, (*seed, part)
        )
        # The robot itself is in the way of the lowest beams.
        free = nominal[:, 2] > math.sin(math.radians(options.lowest_deg))
        measured[~free] = 0.0
        shape = (-1, len(beams))
        ranges[chosen] = measured.reshape(shape)
        intensity[chosen] = np.where(measured > 0, bright, 0.0).reshape(shape)
        kept = (measured > 0) & (exact.face >= 0) & (exact.face < fixed_faces) & ~exact.mixed
        still.append(exact.point[kept])
    return Profiles(scanner, turns, beams, ranges, intensity), np.concatenate(still)


@dataclass(frozen=True)
class _Exact:
    """Where beams ended, without noise."""

    face: np.ndarray  # (N,) int32, -1 for nothing
    point: Float  # (N, 3)
    mixed: np.ndarray  # (N,) bool: the footprint lay over an edge


def _beams(
    tracer: Tracer, start: Float, sent: Float, beams: int, options: RigOptions, seed: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, _Exact]:
    """Ranges (N,), 0 without a return, intensities (N,) in 0..1, and the truth of some profiles."""
    rng = np.random.default_rng(seed)
    n = len(start)
    range_draw, bright_draw = rng.standard_normal((2, n), np.float32)
    dropped = rng.random(n) < options.dropout_share
    wobble = np.radians(options.angular_noise_deg) * rng.standard_normal((n, 3))
    sent = sent + wobble
    sent /= np.sqrt(dot(sent, sent))[:, None]
    path = follow(tracer, start, sent)
    face, length, point = path.face.copy(), path.distance.copy(), path.point.copy()
    cosine, share = path.cosine.copy(), path.share**2

    # A jump to a neighbour in the profile: the footprint of this wide beam may lie on both sides of it.
    near = length.reshape(-1, beams)
    jump = np.zeros(near.shape, bool)
    spacing = math.radians(options.beam_step_deg * options.thinning[0])
    with np.errstate(invalid="ignore"):
        apart = ~(np.abs(np.diff(near, axis=1)) < STEEP * spacing * np.minimum(near[:, 1:], near[:, :-1]))
    apart &= np.isfinite(near[:, 1:]) | np.isfinite(near[:, :-1])
    jump[:, 1:] |= apart
    jump[:, :-1] |= apart
    over = np.flatnonzero(jump.ravel())
    mixed = np.zeros(n, bool)
    if len(over):
        draws = rng.random((len(over), 2)) * 2.0 - 1.0
        norm = np.sqrt(draws[:, 0] ** 2 + draws[:, 1] ** 2)
        turn = np.where(norm[:, None] > 1e-6, draws / np.maximum(norm, 1e-6)[:, None], [1.0, 0.0])
        found = mixed_returns(
            tracer,
            start[over],
            sent[over],
            np.where(face[over] >= 0, tracer.mesh.surface[face[over]], -1).astype(np.int32),
            turn,
            options.beam_diameter_m,
            options.beam_divergence_rad,
            options.pulse_length_m,
            0.0,
        )
        at = over[found.changed]
        face[at], length[at], point[at] = (
            found.face[found.changed],
            found.range[found.changed],
            found.point[found.changed],
        )
        cosine[at], share[at], mixed[at] = found.cosine[found.changed], found.signal[found.changed], True

    with np.errstate(invalid="ignore"):
        alive = np.flatnonzero(
            (face >= 0) & ~dropped & (length >= options.min_range_m) & (length <= options.max_range_m)
        )
    f, r = face[alive], length[alive]
    planes = tracer.planes
    gradient, local = planes.gradient[f], point[alive] - planes.corner[f]
    uv = (planes.uv[f] + np.stack([dot(gradient[:, 0], local), dot(gradient[:, 1], local)], axis=1)).astype(
        np.float32
    )
    footprint = (options.beam_diameter_m + options.beam_divergence_rad * r).astype(np.float32)
    material = tracer.mesh.material[f]
    _, reflectance = looks(material, tracer.mesh.texture[f], uv, footprint)
    back = share[alive] * reflectance * cosine[alive] * (1.0 - 0.7 * GLOSS[material])
    signal = back * (10.0 / np.maximum(r, 1.0)) ** 2
    # White paper at 80 m returns a signal of 0.012; a tenth of it is still seen, as data sheets give it.
    seen = signal * (1.0 + 0.3 * bright_draw[alive]) > 1e-3
    alive, r, back = alive[seen], r[seen], back[seen]
    ranges, intensity = np.zeros(n, np.float32), np.zeros(n, np.float32)
    noisy = r + options.range_noise_m * range_draw[alive]
    ranges[alive] = np.rint(noisy / options.range_step_m) * options.range_step_m
    bright = back / (1.0 + r / 80.0) * (1.0 + 0.04 * bright_draw[alive])
    intensity[alive] = np.rint(np.clip(bright, 0.0, 1.0) * 255.0) / np.float32(255.0)
    return ranges, intensity, _Exact(face, point, mixed)
