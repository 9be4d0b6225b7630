"""A terrestrial laser scanner: which beams it sends, what comes back, and what it writes down.

Models and their sources are described in docs/simulator.md.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float32, Float64, Floating
from trihedral.simulate.beam import edge_beams, footprints, further_echoes, with_mixed
from trihedral.simulate.lighting import falling_light
from trihedral.simulate.material import GLOSS
from trihedral.simulate.mesh import rotated
from trihedral.simulate.optics import follow, looks_at
from trihedral.simulate.patterns import Pattern, regular
from trihedral.simulate.returns import Returns, strongest_at_panes
from trihedral.simulate.scanner_options import ScannerOptions
from trihedral.simulate.snapshot import Snapshot
from trihedral.simulate.tracer import dot

CHUNK = 1 << 16  # beams worked on at a time: the temporaries of one chunk fit the processor's cache


@dataclass(frozen=True)
class SimulatedScan:
    """One scan and the truth about it."""

    #: Carries no meaning.
    name: str
    #: Rows and columns; cells without a point had no return.
    grid: tuple[int, int]
    #: (N, 3) float32, metres, station coordinates; the scanner is at the origin.
    xyz: NDArray[np.float32]
    #: (N,) int32 both. Of a regular pattern row 0 is the highest, and columns run clockwise seen from above.
    row: NDArray[np.int32]
    column: NDArray[np.int32]
    #: (N,) float32 in 0..1.
    intensity: NDArray[np.float32]
    #: (N, 3) uint8, or None.
    color: NDArray[np.uint8] | None
    #: (4, 4) float64 truth.
    project_from_station: Float64
    #: (N,) float64 distance along the recorded direction without range noise, metres, of the surface that
    #: the beam met, or of the mixture of surfaces.
    true_range: Float64
    #: (N,) uint8 `ReturnKind`.
    kind: NDArray[np.uint8]
    #: (N,) int32 face of the station's mesh that the point lies on (the strongest one if several).
    face: NDArray[np.int32]
    #: (N,) whether the surface stands still from station to station.
    fixed: NDArray[np.bool_]
    #: (N,) uint8 how many echoes of the same beam are stronger.
    echo: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.xyz)


def scan(
    snapshot: Snapshot,
    project_from_station: Float64,
    options: ScannerOptions,
    seed: tuple[int, ...],
    name: str,
    pattern: Pattern | None = None,
) -> SimulatedScan:
    """Measure a scene from one station, whose translation must be exact in float32.

    The numbers of `seed`, with the options, the pattern and the scene, fix every bit of the result; without a
    pattern it is the regular one.
    """
    pattern = regular(options) if pattern is None else pattern
    rows, columns = pattern.grid
    block = max(1, CHUNK // rows)
    blocks = [slice(c, min(c + block, columns)) for c in range(0, columns, block)]
    turn = _Turn(snapshot, project_from_station, options, seed, name, pattern)
    met = [turn.cast(k, part) for k, part in enumerate(blocks)]
    face, distance = (np.concatenate(of_blocks) for of_blocks in zip(*met, strict=True))
    parts = [turn.measured(k, part, face, distance[part].reshape(-1)) for k, part in enumerate(blocks)]
    return _joined(parts)


def _joined(parts: list[SimulatedScan]) -> SimulatedScan:
    columns = ["xyz", "row", "column", "intensity", "true_range", "kind", "face", "fixed", "echo"]
    columns += [] if parts[0].color is None else ["color"]
    joined: dict[str, Any] = {key: np.concatenate([getattr(p, key) for p in parts]) for key in columns}
    return replace(parts[0], **joined)


@dataclass(frozen=True)
class _Draws:
    """Standard normal numbers of (N,) beams and which are lost.

    Drawn for every beam, so that what one beam meets never changes another's noise.
    """

    range: Float32
    signal: Float32
    intensity: Float32
    dropped: NDArray[np.bool_]


def _drawn(rng: np.random.Generator, beams: int, dropout_share: float) -> _Draws:
    normal = rng.standard_normal((3, beams), np.float32)
    return _Draws(normal[0], normal[1], normal[2], rng.random(beams) < dropout_share)


@dataclass(frozen=True)
class _Seen:
    """Returns strong enough to be seen."""

    #: (M,) numbers of the beams.
    beam: NDArray[np.int64]
    returns: Returns
    #: What comes back, falling with the range.
    signal: Float64
    #: The same without the fall.
    bright: Float64
    albedo: Float32


@dataclass(frozen=True)
class _Turn:
    """One turn of the instrument."""

    snapshot: Snapshot
    project_from_station: Float64
    options: ScannerOptions
    seed: tuple[int, ...]
    name: str
    pattern: Pattern

    @property
    def rows(self) -> int:
        """Beams of a column."""
        return len(self.pattern.elevation)

    @property
    def origin(self) -> Float64:
        """The scanner, project frame."""
        return self.project_from_station[:3, 3]

    def instrument(self, columns: NDArray[np.int64]) -> Float64:
        """(columns * rows, 3) recorded directions, column by column, the instrument's axes."""
        azimuth, elevation = self.pattern.azimuth_table[columns], self.pattern.elevation_table
        ce, se = elevation[None, :, 0], elevation[None, :, 1]
        ca, sa = azimuth[:, None, 0], azimuth[:, None, 1]
        up = np.broadcast_to(se, (len(azimuth), len(elevation)))
        rays = np.stack([ce * ca, ce * sa, up], axis=-1).reshape(-1, 3)
        if self.pattern.jitter > 0:
            self.turn(rays, columns, *self.pattern.offsets(columns))
            rays /= np.sqrt(dot(rays, rays))[:, None]
        return rays

    def turn(self, rays: Float64, columns: NDArray[np.int64], up: Floating, side: Floating) -> None:
        """Turn rays in place by small angles (columns, rows) upwards and sideways; they stay unit but for squares."""
        azimuth, elevation = self.pattern.azimuth_table[columns], self.pattern.elevation_table
        ce, se = elevation[None, :, 0], elevation[None, :, 1]
        ca, sa = azimuth[:, None, 0], azimuth[:, None, 1]
        rays[:, 0] += (-se * ca * up - sa * side).reshape(-1)
        rays[:, 1] += (-se * sa * up + ca * side).reshape(-1)
        rays[:, 2] += (ce * up).reshape(-1)

    def nominal(self, columns: NDArray[np.int64]) -> Float64:
        """(columns * rows, 3) recorded directions, column by column, station axes."""
        return self.pattern.in_station(self.instrument(columns))

    def sent(self, number: int, block: slice) -> Float64:
        """(columns * rows, 3) directions that the beams of a block really take, project axes."""
        columns = np.arange(block.start, block.stop)
        rays = self.instrument(columns)
        if self.options.angular_noise_arcsec > 0:
            sigma = math.radians(self.options.angular_noise_arcsec / 3600.0)
            rng = np.random.default_rng((*self.seed, 0, number))
            up, side = np.float32(sigma) * rng.standard_normal((2, len(columns), self.rows), np.float32)
            self.turn(rays, columns, up, side)
        rays /= np.sqrt(dot(rays, rays))[:, None]
        return rotated(self.project_from_station[:3, :3], self.pattern.in_station(rays))

    def cast(self, number: int, block: slice) -> tuple[NDArray[np.int32], Float64]:
        """Faces and ranges (columns, rows) that central rays meet first, glass included."""
        sent = self.sent(number, block)
        face, distance = self.snapshot.tracer.cast(np.broadcast_to(self.origin, sent.shape), sent)
        return face.reshape(-1, self.rows), distance.reshape(-1, self.rows)

    def over_edges(self, block: slice, face: NDArray[np.int32]) -> NDArray[np.int64]:
        """Beams of a block whose footprint may lie over an edge; `face` is that of all columns."""
        if not self.options.mixed_pixels:
            return np.zeros(0, np.int64)
        around = np.arange(block.start - 1, block.stop + 1) % len(self.pattern.azimuth)
        nominal = rotated(self.project_from_station[:3, :3], self.nominal(around))
        directions = nominal.reshape(len(around), -1, 3)
        return np.flatnonzero(edge_beams(self.snapshot.tracer, self.origin, face[around], directions)[1:-1])

    def measured(
        self, number: int, block: slice, face: NDArray[np.int32], distance: Float64
    ) -> SimulatedScan:
        """The beams of a block that returned; `face` is that of all columns."""
        options, tracer = self.options, self.snapshot.tracer
        sent = self.sent(number, block)
        rng = np.random.default_rng((*self.seed, 1, number))
        draws = _drawn(rng, len(sent), options.dropout_share)
        origins = np.broadcast_to(self.origin, sent.shape)
        met = (face[block].reshape(-1), distance)
        path = follow(tracer, origins, sent, met, options.glass_delay_m)
        over = self.over_edges(block, face)
        footprint = footprints(tracer, options.beam, origins, sent, over, rng)
        wide = with_mixed(tracer, options.pulse_length_m, Returns.along(path), over, footprint)
        returns = strongest_at_panes(tracer, origins, sent, path, wide, draws.signal)
        first = self.points(block, sent, self.seen(returns, draws), draws, rng, 0)
        if footprint is None:
            return first
        parts = [first]
        for rank in range(1, options.returns):
            # Other numbers for each echo, so that the strongest ones stay the same.
            own = np.random.default_rng((*self.seed, 3, number, rank))
            noise = _drawn(own, len(sent), 0.0)
            weaker = further_echoes(len(sent), options.pulse_length_m, over, footprint, rank)
            parts.append(self.points(block, sent, self.seen(weaker, noise), noise, own, rank))
        return _joined(parts)

    def points(
        self, block: slice, sent: Float64, seen: _Seen, draws: _Draws, rng: np.random.Generator, echo: int
    ) -> SimulatedScan:
        """What the instrument writes down of the returns that it sees in a block."""
        options = self.options
        beam, r = seen.beam, seen.returns.distance
        weakness = np.minimum(0.5 / seen.signal, 400.0)
        sigma = np.sqrt(options.range_noise_m**2 + options.signal_noise_m**2 * weakness)
        noisy = r + sigma * draws.range[beam]
        # Instruments correct most of the fall-off with range; a third of an e-fold over 50 m is left.
        bright = seen.bright / (1.0 + r / 150.0) * (1.0 + options.intensity_noise * draws.intensity[beam])
        return SimulatedScan(
            self.name,
            self.pattern.grid,
            (noisy[:, None] * self.nominal(np.arange(block.start, block.stop))[beam]).astype(np.float32),
            (beam % self.rows).astype(np.int32),
            (beam // self.rows + block.start).astype(np.int32),
            np.clip(bright, 0.0, 1.0).astype(np.float32),
            self.color(seen, sent[beam], rng) if options.color else None,
            self.project_from_station,
            r,
            seen.returns.kind,
            seen.returns.face,
            seen.returns.face < self.snapshot.fixed_faces,
            np.full(len(beam), echo, np.uint8),
        )

    def seen(self, returns: Returns, draws: _Draws) -> _Seen:
        """Those of a block's returns that are in range, not lost and strong enough."""
        options, tracer = self.options, self.snapshot.tracer
        alive = np.flatnonzero(returns.within(options.min_range_m, options.max_range_m) & ~draws.dropped)
        hit = returns.of(alive)
        size = hit.distance * math.radians(options.angular_step_deg)
        albedo, rho = looks_at(tracer, hit.face, hit.point, size)
        gloss = GLOSS[tracer.mesh.material[hit.face]]
        shine = np.maximum(0.0, 1.0 - (1.0 - hit.cosine) * 400.0)  # a lobe of about 3 degrees
        back = rho * hit.cosine * (1.0 - 0.7 * gloss) + 3.0 * gloss * shine
        signal = hit.share * back * (10.0 / np.maximum(hit.distance, 1.0)) ** 2
        seen = signal * (1.0 + 0.3 * draws.signal[alive]) > options.weakest_signal
        return _Seen(alive[seen], hit.of(seen), signal[seen], (hit.share * back)[seen], albedo[seen])

    def color(self, seen: _Seen, view: Float64, rng: np.random.Generator) -> NDArray[np.uint8]:
        """(M, 3) colours that the camera writes down of what was seen along `view`."""
        # Exposure and white balance change from station to station.
        drawn = np.random.default_rng((*self.seed, 2))
        exposure = 1.0 + 0.08 * drawn.standard_normal()
        gain = np.clip(exposure * (1.0 + 0.02 * drawn.standard_normal(3)), 0.6, 1.5)
        here, hit = self.snapshot, seen.returns
        facing = here.tracer.facing(hit.face, view)
        falling = falling_light(here.tracer, here.light, hit.point, facing, shadows=here.shadows)
        color = np.empty((len(view), 3), np.uint8)
        grain = 1.0 + 0.02 * rng.standard_normal(len(view))
        for c in range(3):
            # A square root stands for the camera's tone curve; it is exact everywhere, unlike a power.
            tone = np.sqrt(np.clip(seen.albedo[:, c] * falling[c] * gain[c], 0.0, 1.0))
            color[:, c] = np.rint(np.clip(255.0 * tone * grain, 0, 255)).astype(np.uint8)
        return color
