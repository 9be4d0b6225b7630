"""Which directions a scanner measures in: a regular grid, or what line scanners and spinning ones make of it.

Each pattern is a function of the scanner's options and random numbers; all have about as many beams as the regular one.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import rotation_about_z
from trihedral.simulate.mesh import Rng, rotated
from trihedral.simulate.noise import cell_noise
from trihedral.simulate.scanner_options import ScannerOptions

# Radians from a beam within which something is seen by it, or by the next one.
NEAR = math.radians(1.0)
# Degrees that the axis of an instrument whose coordinates are levelled leans by.
LEAN = (1.0, 6.0)
# Wedges without columns, and their widths in degrees.
GAPS, GAP_WIDTH = 3, (5.0, 20.0)
# A line scanner's fan, degrees from the horizon in front over the zenith to the one behind and below.
FAN = (-55.0, 235.0)
# Sweeps of its head, degrees each, and how much faster or slower than another one may be.
SWEEPS, SWEEP, SPEED = 3, 190.0, 0.1
# A tilting one's fan to both sides, and how far it tilts up and down, degrees.
TILT_FAN, TILT_UP, TILT_DOWN = 95.0, 75.0, 40.0
# A spinning scanner's rings, degrees, denser in the middle; and beams of a turn of one ring.
RINGS, RING_LOW, RING_HIGH, RING_BEAMS = 64, -25.0, 15.0, 1800


@dataclass(frozen=True)
class Pattern:
    """Directions of (columns, rows) beams in the instrument's frame, and how it stands in the station's."""

    #: (R,) radians over the instrument's horizon, of rows; beyond a right angle they lie behind.
    elevation: Float64
    #: (C,) radians about the instrument's axis, of columns in the order in which they are measured.
    azimuth: Float64
    #: (3, 3); None where the frames are one.
    station_from_instrument: Float64 | None = None
    #: Radians by which each direction may be off its row and column, either way.
    jitter: float = 0.0
    #: Cosine and sine (R, 2) of elevations and (C, 2) of azimuths.
    elevation_table: Float64 = field(init=False, repr=False)
    azimuth_table: Float64 = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "elevation_table", _table(self.elevation))
        object.__setattr__(self, "azimuth_table", _table(self.azimuth))

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.elevation), len(self.azimuth)

    def offsets(self, columns: NDArray[np.int64]) -> tuple[Float64, Float64]:
        """Radians (columns, rows) by which directions are off, upwards and sideways."""
        i = np.repeat(columns.astype(np.int32), len(self.elevation))
        j = np.tile(np.arange(len(self.elevation), dtype=np.int32), len(columns))
        up, side = (
            self.jitter * (2.0 * cell_noise(i, j, np.uint32(seed)).astype(np.float64) - 1.0)
            for seed in (41, 43)
        )
        shape = (len(columns), len(self.elevation))
        return up.reshape(shape), side.reshape(shape)

    def in_station(self, directions: Float64) -> Float64:
        """Turn directions (N, 3) of the instrument into the station's frame."""
        turn = self.station_from_instrument
        return directions if turn is None else rotated(turn, directions)

    def covers(self, rays: Float64) -> NDArray[np.bool_]:
        """Whether the pattern has beams about (N, 3) rays, station frame: near a column and within the rows."""
        turn = self.station_from_instrument
        own = rays if turn is None else rays @ turn
        elevation = np.arcsin(np.clip(own[:, 2] / np.maximum(np.linalg.norm(own, axis=1), 1e-12), -1.0, 1.0))
        azimuth = np.arctan2(own[:, 1], own[:, 0])
        low, high = float(self.elevation.min()), float(self.elevation.max())
        covered = np.zeros(len(rays), bool)
        # Rows count on over the zenith, and over the nadir: the same ray has these elevations and azimuths.
        for own_elevation, turned in (
            (elevation, 0.0),
            (math.pi - elevation, math.pi),
            (-math.pi - elevation, math.pi),
        ):
            in_rows = np.abs(own_elevation - (low + high) / 2.0) <= (high - low) / 2.0 + NEAR
            covered |= in_rows & self._has_column(azimuth + turned)
        return covered

    def _has_column(self, azimuth: Float64) -> NDArray[np.bool_]:
        known = np.sort(np.mod(self.azimuth, 2.0 * math.pi))
        known = np.concatenate([known[-1:] - 2.0 * math.pi, known, known[:1] + 2.0 * math.pi])
        wanted = np.mod(azimuth, 2.0 * math.pi)
        at = np.searchsorted(known, wanted)
        off = np.minimum(np.abs(known[at] - wanted), np.abs(known[at - 1] - wanted))
        return np.asarray(off <= NEAR)


def _table(angle: Float64) -> Float64:
    """Cosine and sine; the last bits differ between libraries of mathematics, and are rounded off."""
    values = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(np.rint(values * 2.0**40) * 2.0**-40)


def regular(options: ScannerOptions, rng: Rng | None = None) -> Pattern:
    """Equal steps of elevation, from the highest, and of azimuth, clockwise."""
    rows, columns = options.grid
    step = (options.elevation_max_deg - options.elevation_min_deg) / rows
    elevation = np.radians(options.elevation_max_deg - (np.arange(rows) + 0.5) * step)
    return Pattern(elevation, np.radians(-np.arange(columns) * (360.0 / columns)))


def leaning(options: ScannerOptions, rng: Rng) -> Pattern:
    """Measure a regular grid about an axis that leans, in coordinates that are levelled."""
    level = regular(options)
    lean, towards = math.radians(rng.uniform(*LEAN)), rng.uniform(0.0, 2.0 * math.pi)
    c, s = math.cos(lean), math.sin(lean)
    about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    turn = rotation_about_z(towards)
    return Pattern(level.elevation, level.azimuth, turn @ about_y @ turn.T)


def jittered(options: ScannerOptions, rng: Rng) -> Pattern:
    """Measure anywhere within the cell of a regular grid."""
    level = regular(options)
    return Pattern(level.elevation, level.azimuth, None, math.radians(options.angular_step_deg / 2.0))


def gaps(options: ScannerOptions, rng: Rng) -> Pattern:
    """Leave wedges out of a regular grid, as where a mast or a person stood."""
    level = regular(options)
    kept = np.ones(len(level.azimuth), bool)
    for _ in range(GAPS):
        middle, width = rng.uniform(0.0, 2.0 * math.pi), math.radians(rng.uniform(*GAP_WIDTH))
        off = np.mod(level.azimuth - middle + math.pi, 2.0 * math.pi) - math.pi
        kept &= np.abs(off) > width / 2.0
    return Pattern(level.elevation, level.azimuth[kept])


def sweeps(options: ScannerOptions, rng: Rng) -> Pattern:
    """Turn a line scanner about the vertical, over half a turn and again, not at the same speed."""
    step = _step(options, FAN[1] - FAN[0], SWEEPS * SWEEP)
    elevation = np.radians(np.arange(FAN[0], FAN[1], step))
    azimuth = []
    for _ in range(SWEEPS):
        own = step * rng.uniform(1.0 - SPEED, 1.0 + SPEED)
        azimuth.append(np.radians(rng.uniform(0.0, own) + np.arange(0.0, SWEEP, own)))
    return Pattern(elevation, np.concatenate(azimuth))


def tilting(options: ScannerOptions, rng: Rng) -> Pattern:
    """Nod a line scanner whose lines are level: a half-sphere ahead, lines that meet at both sides."""
    step = _step(options, 2.0 * TILT_FAN, TILT_UP + TILT_DOWN)
    elevation = np.radians(np.arange(-TILT_FAN, TILT_FAN, step))
    azimuth = np.radians(np.arange(-TILT_UP, TILT_DOWN, step) + rng.uniform(0.0, step))
    # The axis points to the left; x stays ahead.
    return Pattern(elevation, azimuth, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]))


def rings(options: ScannerOptions, rng: Rng) -> Pattern:
    """Spin many beams, each on a cone of its own, turn after turn."""
    rows, columns = options.grid
    away = np.linspace(-1.0, 1.0, RINGS)
    middle, half = (RING_LOW + RING_HIGH) / 2.0, (RING_HIGH - RING_LOW) / 2.0
    elevation = np.radians(middle + half * np.sign(away) * np.abs(away) ** 1.5)[::-1]
    beams = max(RING_BEAMS, rows * columns // RINGS)
    step = 360.0 / RING_BEAMS * rng.uniform(0.99, 1.01)
    return Pattern(elevation.copy(), np.radians(rng.uniform(0.0, 360.0) - step * np.arange(beams)))


def _step(options: ScannerOptions, height: float, width: float) -> float:
    """Degrees between beams with which a field has as many as the regular pattern."""
    rows, columns = options.grid
    return math.sqrt(height * width / (rows * columns))


REGULAR = "regular"
PATTERNS: dict[str, Callable[[ScannerOptions, Rng], Pattern]] = {
    one.__name__: one for one in (regular, leaning, jittered, gaps, sweeps, tilting, rings)
}
