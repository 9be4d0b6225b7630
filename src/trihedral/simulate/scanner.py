"""A terrestrial laser scanner: which beams it sends, what comes back, and what it writes down.

Models and their sources are described in docs/simulator.md.
"""

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.simulate.beam import edge_beams, mixed_returns
from trihedral.simulate.lighting import falling_light
from trihedral.simulate.material import GLOSS, MIRRORS, REFLECTANCE, looks
from trihedral.simulate.optics import follow, pane_reflects
from trihedral.simulate.scene import Light
from trihedral.simulate.tracer import Float, Tracer, dot

CHUNK = 1 << 16  # beams worked on at a time: the temporaries of one chunk fit the processor's cache


@dataclass(frozen=True)
class ScannerOptions:
    """What the instrument does; the defaults are those of a mid-range scanner in a quick mode."""

    angular_step_deg: float = (
        0.165  # between neighbouring beams, both ways; 0.165 gives 2 million beams a scan
    )
    elevation_min_deg: float = -60.0  # lowest beam; below it is the tripod
    elevation_max_deg: float = 90.0  # highest beam
    min_range_m: float = 0.4  # nothing nearer is measured
    max_range_m: float = 120.0  # nothing farther is measured
    range_noise_m: float = 0.002  # one sigma where the signal is strong
    signal_noise_m: float = (
        0.0005  # one sigma more at a signal of 0.5 (half-grey, head-on, 10 m); grows as 1/sqrt
    )
    angular_noise_arcsec: float = 8.0  # one sigma of the beam's direction against the recorded one, each axis
    beam_diameter_m: float = 0.005  # at the exit, 1/e^2
    beam_divergence_rad: float = 0.0003  # full angle, 1/e^2
    mixed_pixels: bool = True  # follow the beam's footprint over edges; False: an infinitely thin beam
    pulse_length_m: float = 0.3  # echoes nearer to each other than this are averaged, others told apart
    # Added by each pane on the way: 0.002 for 4 mm of glass of index 1.5. It is a fact that no rigid motion
    # explains, so it is left out of data that registration is measured on unless asked for.
    glass_delay_m: float = 0.0
    weakest_signal: float = (
        3e-4  # reflectance * cos(incidence) * (10 m / range)^2 below which nothing is seen
    )
    dropout_share: float = 0.001  # beams lost at random
    intensity_noise: float = 0.03  # one sigma, relative
    color: bool = True  # take colours
    light_changes: bool = False  # each scan has a sun and lamps of its own, and the sun casts shadows
    level_sigma_deg: float = 0.02  # one sigma of each component of the compensated tilt
    tilt_deg: float = 0.0  # an instrument that is not levelled: tilted by up to this much, in any direction

    def __post_init__(self) -> None:
        checks = [
            (0.005 <= self.angular_step_deg <= 5.0, "angular_step_deg must lie between 0.005 and 5"),
            (
                -90.0 <= self.elevation_min_deg < self.elevation_max_deg <= 90.0,
                "elevation_min_deg must lie below elevation_max_deg, both within -90..90",
            ),
            (0.0 <= self.min_range_m < self.max_range_m, "min_range_m must be below max_range_m"),
            (0.0 <= self.dropout_share < 1.0, "dropout_share must lie in 0..1"),
            (0.0 <= self.tilt_deg <= 60.0, "tilt_deg must lie between 0 and 60"),
            (self.pulse_length_m > 0.0, "pulse_length_m must be positive"),
            *(
                (getattr(self, name) >= 0.0, f"{name} must not be negative")
                for name in (
                    "range_noise_m",
                    "signal_noise_m",
                    "angular_noise_arcsec",
                    "beam_diameter_m",
                    "beam_divergence_rad",
                    "glass_delay_m",
                    "weakest_signal",
                    "intensity_noise",
                    "level_sigma_deg",
                )
            ),
        ]
        for good, message in checks:
            if not good:
                raise OptionError(f"Scanner: {message}.")

    def with_beams(self, beams: int) -> "ScannerOptions":
        """Take the angular step with which about this many beams fill the field of view."""
        if beams < 1:
            raise OptionError("Scanner: the number of points a scan must be positive.")
        step = math.sqrt(360.0 * (self.elevation_max_deg - self.elevation_min_deg) / beams)
        return replace(self, angular_step_deg=step)

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns."""
        rows = max(1, round((self.elevation_max_deg - self.elevation_min_deg) / self.angular_step_deg))
        return rows, max(1, round(360.0 / self.angular_step_deg))


class ReturnKind(IntEnum):
    """How a point came about."""

    DIRECT = 0  # one surface, straight from the scanner
    MIXED = 1  # the footprint lay over an edge: the point may float between surfaces
    THROUGH_GLASS = 2  # a surface behind glass
    GLASS = 3  # the pane itself
    GHOST = 4  # seen in a mirror or in a pane: there is nothing at this place


@dataclass(frozen=True)
class SimulatedScan:
    """One scan and the truth about it.

    Attributes
    ----------
    name
        Carries no meaning.
    grid
        Rows and columns; cells without a point had no return.
    xyz
        (N, 3) float32, metres, station coordinates; the scanner is at the origin.
    row, column
        (N,) int32. Row 0 is the highest; columns run clockwise seen from above.
    intensity
        (N,) float32 in 0..1.
    color
        (N, 3) uint8, or None.
    project_from_station
        (4, 4) float64 truth.
    true_range
        (N,) float64 distance along the recorded direction without range noise, metres: of the surface that
        the beam met, or of the mixture of surfaces.
    kind
        (N,) uint8 `ReturnKind`.
    face
        (N,) int32 face of the station's mesh that the point lies on (the strongest one if several).
    fixed
        (N,) bool: the surface stands still from station to station.
    """

    name: str
    grid: tuple[int, int]
    xyz: NDArray[np.float32]
    row: NDArray[np.int32]
    column: NDArray[np.int32]
    intensity: NDArray[np.float32]
    color: NDArray[np.uint8] | None
    project_from_station: Float
    true_range: Float
    kind: NDArray[np.uint8]
    face: NDArray[np.int32]
    fixed: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.xyz)


def beam_tables(options: ScannerOptions) -> tuple[Float, Float]:
    """Cosine and sine of each row's elevation (rows, 2) and each column's azimuth (columns, 2).

    The last bits of sine and cosine differ between libraries of mathematics; they are rounded off.
    """
    rows, columns = options.grid
    step = (options.elevation_max_deg - options.elevation_min_deg) / rows
    elevation = np.radians(options.elevation_max_deg - (np.arange(rows) + 0.5) * step)
    azimuth = np.radians(-np.arange(columns) * (360.0 / columns))

    def table(angle: Float) -> Float:
        values = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.asarray(np.rint(values * 2.0**40) * 2.0**-40)

    return table(elevation), table(azimuth)


def rotated(rotation: Float, vectors: Float) -> Float:
    """(N, 3) vectors turned by plain sums of products, the same on every machine."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    return np.stack([rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z for i in range(3)], axis=1)


def scan(
    tracer: Tracer,
    fixed_faces: int,
    light: Light,
    project_from_station: Float,
    options: ScannerOptions,
    seed: tuple[int, ...],
    name: str,
) -> SimulatedScan:
    """Measure a scene from one station.

    Parameters
    ----------
    tracer
        The scene as it is during this scan, project frame.
    fixed_faces
        The mesh's first so many faces stand still.
    light
        For the colours.
    project_from_station
        (4, 4); its translation must be exact in float32.
    seed
        Numbers that, with the options and the scene, fix every bit of the result.
    """
    rows, columns = options.grid
    elevation, azimuth = beam_tables(options)
    rotation, origin = project_from_station[:3, :3], project_from_station[:3, 3]
    block = max(1, CHUNK // rows)
    blocks = [(c, min(c + block, columns)) for c in range(0, columns, block)]
    face = np.empty((columns, rows), np.int32)
    distance = np.empty((columns, rows))
    for k, (c0, c1) in enumerate(blocks):
        sent = _sent(elevation, azimuth[c0:c1], rotation, options, (*seed, 0, k))
        start = np.broadcast_to(origin, sent.shape)
        met, length = tracer.cast(start, sent)
        face[c0:c1], distance[c0:c1] = met.reshape(-1, rows), length.reshape(-1, rows)
    camera = _Camera.drawn(np.random.default_rng((*seed, 2)))
    parts = []
    for k, (c0, c1) in enumerate(blocks):
        around = np.arange(c0 - 1, c1 + 1) % columns
        edge = np.zeros((c1 - c0, rows), bool)
        if options.mixed_pixels:
            nominal = rotated(rotation, _nominal(elevation, azimuth[around])).reshape(-1, rows, 3)
            edge = edge_beams(tracer, origin, face[around], nominal)[1:-1]
        parts.append(
            _Block(tracer, light, camera, origin, rotation, options, (*seed, 1, k)).measure(
                _nominal(elevation, azimuth[c0:c1]),
                _sent(elevation, azimuth[c0:c1], rotation, options, (*seed, 0, k)),
                face[c0:c1].reshape(-1),
                distance[c0:c1].reshape(-1),
                edge.reshape(-1),
                c0,
                rows,
            )
        )
    column_of = {key: np.concatenate([p[key] for p in parts]) for key in parts[0]}
    return SimulatedScan(
        name,
        (rows, columns),
        column_of["xyz"],
        column_of["row"],
        column_of["column"],
        column_of["intensity"],
        column_of["color"] if options.color else None,
        project_from_station,
        column_of["true_range"],
        column_of["kind"],
        column_of["face"],
        column_of["face"] < fixed_faces,
    )


def _nominal(elevation: Float, azimuth: Float) -> Float:
    """(columns * rows, 3) recorded directions, column by column, station axes."""
    ce, se = elevation[None, :, 0], elevation[None, :, 1]
    ca, sa = azimuth[:, None, 0], azimuth[:, None, 1]
    return np.stack([ce * ca, ce * sa, np.broadcast_to(se, (len(azimuth), len(elevation)))], axis=-1).reshape(
        -1, 3
    )


def _sent(
    elevation: Float, azimuth: Float, rotation: Float, options: ScannerOptions, seed: tuple[int, ...]
) -> Float:
    """(columns * rows, 3) directions that the beams really take, project axes."""
    nominal = _nominal(elevation, azimuth)
    if options.angular_noise_arcsec > 0:
        ce, se = elevation[None, :, 0], elevation[None, :, 1]
        ca, sa = azimuth[:, None, 0], azimuth[:, None, 1]
        shape = (len(azimuth), len(elevation))
        sigma = math.radians(options.angular_noise_arcsec / 3600.0)
        up, side = np.float32(sigma) * np.random.default_rng(seed).standard_normal((2, *shape), np.float32)
        nominal[:, 0] += (-se * ca * up - sa * side).reshape(-1)
        nominal[:, 1] += (-se * sa * up + ca * side).reshape(-1)
        nominal[:, 2] += (ce * up).reshape(-1)
    nominal /= np.sqrt(dot(nominal, nominal))[:, None]
    return rotated(rotation, nominal)


@dataclass(frozen=True)
class _Camera:
    """How this station's pictures came out: exposure and white balance change from station to station."""

    gain: Float  # (3,)

    @staticmethod
    def drawn(rng: np.random.Generator) -> "_Camera":
        exposure = 1.0 + 0.08 * rng.standard_normal()
        return _Camera(np.clip(exposure * (1.0 + 0.02 * rng.standard_normal(3)), 0.6, 1.5))


@dataclass(frozen=True)
class _Block:
    """Some columns of a scan at work."""

    tracer: Tracer
    light: Light
    camera: _Camera
    origin: Float
    rotation: Float
    options: ScannerOptions
    seed: tuple[int, ...]

    def measure(
        self,
        nominal: Float,
        sent: Float,
        face: NDArray[np.int32],
        distance: Float,
        edge: NDArray[np.bool_],
        first_column: int,
        rows: int,
    ) -> dict[str, NDArray[np.generic]]:
        """Everything a scan holds, for the beams of this block that returned."""
        options, tracer = self.options, self.tracer
        rng = np.random.default_rng(self.seed)
        n = len(face)
        # Drawn for every beam, so that what one beam meets never changes another's noise.
        range_draw, signal_draw, intensity_draw = rng.standard_normal((3, n), np.float32)
        dropped = rng.random(n) < options.dropout_share

        origins = np.broadcast_to(self.origin, (n, 3))
        path = follow(tracer, origins, sent, (face, distance), options.glass_delay_m)
        hit, length, point = path.face.copy(), path.distance.copy(), path.point
        cosine, share = path.cosine.copy(), path.share**2
        kind = np.where(path.pane >= 0, ReturnKind.THROUGH_GLASS, ReturnKind.DIRECT).astype(np.uint8)
        kind[path.mirrored] = ReturnKind.GHOST

        over = np.flatnonzero(edge)
        if len(over):
            draws = rng.random((len(over), 2)) * 2.0 - 1.0
            norm = np.sqrt(draws[:, 0] ** 2 + draws[:, 1] ** 2)
            turn = np.where(norm[:, None] > 1e-6, draws / np.maximum(norm, 1e-6)[:, None], [1.0, 0.0])
            surface = np.where(hit[over] >= 0, tracer.mesh.surface[hit[over]], -1).astype(np.int32)
            mixed = mixed_returns(
                tracer,
                self.origin,
                sent[over],
                surface,
                turn,
                options.beam_diameter_m,
                options.beam_divergence_rad,
                options.pulse_length_m,
                options.glass_delay_m,
            )
            at = over[mixed.changed]
            hit[at], length[at] = mixed.face[mixed.changed], mixed.range[mixed.changed]
            point[at], cosine[at] = mixed.point[mixed.changed], mixed.cosine[mixed.changed]
            share[at] = mixed.signal[mixed.changed]
            kind[at] = ReturnKind.MIXED

        panes = np.flatnonzero(path.pane >= 0)
        if len(panes):
            self._panes(panes, path.pane, sent, hit, length, point, cosine, share, kind, signal_draw)

        with np.errstate(invalid="ignore"):
            alive = np.flatnonzero(
                (hit >= 0) & ~dropped & (length >= options.min_range_m) & (length <= options.max_range_m)
            )
        f, r = hit[alive], length[alive]
        material = tracer.mesh.material[f]
        planes = tracer.planes
        gradient = planes.gradient[f]
        local = point[alive] - planes.corner[f]
        uv = (
            planes.uv[f] + np.stack([dot(gradient[:, 0], local), dot(gradient[:, 1], local)], axis=1)
        ).astype(np.float32)
        pixel = (r * math.radians(options.angular_step_deg)).astype(np.float32)
        albedo, rho = looks(material, tracer.mesh.texture[f], uv, pixel)
        c = cosine[alive]
        gloss = GLOSS[material]
        shine = np.maximum(0.0, 1.0 - (1.0 - c) * 400.0)  # a lobe of about 3 degrees
        back = rho * c * (1.0 - 0.7 * gloss) + 3.0 * gloss * shine
        signal = share[alive] * back * (10.0 / np.maximum(r, 1.0)) ** 2
        flicker = 1.0 + 0.3 * signal_draw[alive]
        seen = signal * flicker > options.weakest_signal
        alive, f, r, signal = alive[seen], f[seen], r[seen], signal[seen]
        back, albedo, material = (share[alive] * back[seen]), albedo[seen], material[seen]

        sigma = np.sqrt(
            options.range_noise_m**2 + options.signal_noise_m**2 * np.minimum(0.5 / signal, 400.0)
        )
        measured = r + sigma * range_draw[alive]
        # Instruments correct most of the fall-off with range; a third of an e-fold over 50 m is left.
        bright = back / (1.0 + r / 150.0) * (1.0 + options.intensity_noise * intensity_draw[alive])
        out: dict[str, NDArray[np.generic]] = {
            "xyz": (measured[:, None] * nominal[alive]).astype(np.float32),
            "row": (alive % rows).astype(np.int32),
            "column": (alive // rows + first_column).astype(np.int32),
            "intensity": np.clip(bright, 0.0, 1.0).astype(np.float32),
            "true_range": r,
            "kind": kind[alive],
            "face": f,
        }
        if options.color:
            out["color"] = self._color(albedo, point[alive], planes.normal[f], sent[alive], rng)
        return out

    def _panes(
        self,
        at: NDArray[np.int64],
        pane: NDArray[np.int32],
        sent: Float,
        hit: NDArray[np.int32],
        length: Float,
        point: Float,
        cosine: Float,
        share: Float,
        kind: NDArray[np.uint8],
        draw: Float,
    ) -> None:
        """Of the pane's own return, what lies behind it and what it mirrors, keep the strongest."""
        tracer = self.tracer
        f = pane[at]
        mesh, planes = tracer.mesh, tracer.planes
        start = np.broadcast_to(self.origin, (len(at), 3))
        near = tracer.range_to(f, start, sent[at])
        normal = planes.normal[f]
        along = dot(sent[at], normal)
        mirror = MIRRORS[mesh.material[f]]
        reflected = np.where(mirror, 0.0, pane_reflects(np.abs(along)))
        place = start + near[:, None] * sent[at]
        away = sent[at] - 2.0 * along[:, None] * normal
        ghost_face, ghost_step = tracer.cast(place + 1e-3 * away, away)
        met = np.where(ghost_face >= 0, ghost_step, 1.0)
        ghost_cosine = np.abs(dot(away, planes.normal[ghost_face]))
        rho = REFLECTANCE[mesh.material[ghost_face]]
        ghost = np.where(ghost_face >= 0, reflected**2 * rho * ghost_cosine / (near + met) ** 2, 0.0)
        rho = REFLECTANCE[mesh.material[hit[at]]]
        behind = np.where(hit[at] >= 0, share[at] * rho * cosine[at], 0.0)
        behind = behind / np.where(hit[at] >= 0, length[at], 1.0) ** 2
        # Dust lies in patches; head-on the pane itself is a mirror that looks back.
        dust = 0.012 * np.exp2(np.rint(1.5 * draw[at]))
        steep = np.maximum(0.0, 1.0 - (1.0 - np.abs(along)) * 2000.0)
        own = (dust * np.abs(along) + 0.5 * steep) / near**2
        use_ghost = (ghost > behind) & (ghost > own)
        use_own = (own > behind) & (own >= ghost)
        g, o = at[use_ghost], at[use_own]
        hit[g], length[g] = ghost_face[use_ghost], (near + ghost_step + 1e-3)[use_ghost]
        point[g] = (place + (ghost_step + 1e-3)[:, None] * away)[use_ghost]
        cosine[g], share[g], kind[g] = ghost_cosine[use_ghost], reflected[use_ghost] ** 2, ReturnKind.GHOST
        hit[o], length[o], point[o] = f[use_own], near[use_own], place[use_own]
        cosine[o], share[o], kind[o] = np.abs(along)[use_own], 0.3, ReturnKind.GLASS

    def _color(
        self, albedo: NDArray[np.float32], point: Float, normal: Float, view: Float, rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        facing = np.where(dot(normal, view) > 0, -1.0, 1.0)[:, None] * normal
        falling = falling_light(self.tracer, self.light, point, facing, shadows=self.options.light_changes)
        color = np.empty((len(albedo), 3), np.uint8)
        grain = 1.0 + 0.02 * rng.standard_normal(len(albedo))
        for c in range(3):
            # A square root stands for the camera's tone curve; it is exact everywhere, unlike a power.
            tone = np.sqrt(np.clip(albedo[:, c] * falling[c] * self.camera.gain[c], 0.0, 1.0))
            color[:, c] = np.rint(np.clip(255.0 * tone * grain, 0, 255)).astype(np.uint8)
        return color
