"""A small plan of what a station saw at eye level, by which scans that share surface are found among hundreds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from trihedral.geometry.arrays import Bool, Float32, Float64, Floating, Int64
from trihedral.geometry.se3 import rotation_about_z
from trihedral.initial.plan.vertical import upright_rotations
from trihedral.parallel import ordered_map, processors
from trihedral.scan.photometry import less_shading
from trihedral.scan.prepared import Prepared

CELL = 0.4  # metres a side
SIDE = 128  # cells
WALL_BAND = 0.8  # metres above and below the scanner; walls outside it are not drawn
FREE_BAND = 0.6  # the same for rays that say what is empty
RAYS = 4000
# Channels: walls by the way they face, space seen through, and how floors, low and high walls and ceilings look.
FACINGS = 4
FREE = FACINGS
APPEARANCE = slice(FACINGS + 1, FACINGS + 5)
CHANNELS = FACINGS + 5
STEPS = 40.0  # of what a cell looks like, a standard deviation
# Of brightness against texture. Texture tells like storeys apart; outdoors brightness says more.
BRIGHT = 0.5
LEAST_COMPARED = 30  # surfels, below which brightness says nothing
LEAST_CONTRAST = 1e-3  # of a brightness in 0..1: a smaller standard deviation is noise
BLOCK = 32  # plans whose spectra are in memory at once
# Weights against that of walls on walls: what lies in space seen through, and what looks alike.
CONFLICT = 1.0
ALIKE = 4.0
FEW_CELLS = 30.0  # whose looks are compared, below which they say less
APPEARANCE_COUNT = 2.0  # weight of looks against that of places


@dataclass(frozen=True)
class PlanDescriptor:
    """One station's plan."""

    #: (CHANNELS, SIDE, SIDE) int8, indexed by x and y, the scanner in the middle; turned so that most walls lie along
    #: the axes.
    plan: NDArray[np.int8]
    #: (3, 3) rotation.
    plan_from_scanner: Float64

    @property
    def walls(self) -> Bool:
        """(SIDE, SIDE) where there are walls of any facing."""
        walls: Bool = np.any(self.plan[:FACINGS], axis=0)
        return walls


def describe_plan(prepared: Prepared) -> PlanDescriptor:
    """Draw the plan of a station."""
    surfels = prepared.surfels
    upright = upright_rotations(prepared)[-1]
    normals = surfels.normals @ upright.T
    wall = surfels.planar & (np.abs(normals[:, 2]) < 0.3)
    plan_from_scanner = rotation_about_z(-_heading(normals[wall])) @ upright
    points = surfels.points @ plan_from_scanner.T
    normals = surfels.normals @ plan_from_scanner.T
    cells = np.floor(points[:, :2] / CELL).astype(np.int64) + SIDE // 2
    inside = ((cells >= 0) & (cells < SIDE)).all(axis=1)
    plan = np.zeros((CHANNELS, SIDE, SIDE), dtype=np.int8)
    drawn = wall & inside & (np.abs(points[:, 2]) < WALL_BAND)
    facing = np.round(np.arctan2(normals[:, 1], normals[:, 0]) / (np.pi / 2)).astype(np.int64) % FACINGS
    plan[facing[drawn], cells[drawn, 0], cells[drawn, 1]] = 1
    plan[FREE] = _seen_through(points[np.abs(points[:, 2]) < FREE_BAND, :2])
    plan[FREE][plan[:FACINGS].any(axis=0)] = 0
    if np.isfinite(surfels.color).any():
        bright, texture = surfels.color.mean(axis=1), prepared.photometry.color
    else:
        bright, texture = surfels.intensity, less_shading(surfels, surfels.intensity)
    low = points[:, 2] < 0
    surfaces = (normals[:, 2] > 0.8, wall & low, wall & ~low, normals[:, 2] < -0.8)
    for channel, surface in zip(plan[APPEARANCE], surfaces, strict=True):
        appearance = _drawn(cells, texture, surface & inside) + BRIGHT * _drawn(
            cells, bright, surface & inside
        )
        channel[:] = np.rint(STEPS * appearance)
    return PlanDescriptor(plan, plan_from_scanner)


def plan_similarities(descriptors: Sequence[PlanDescriptor]) -> Float64:
    """(N, N) how far plans go together better than others do: 0 for an average pair, 3 and more for neighbours.

    Two measures of each pair under the best turn and shift: *places*, walls on walls that face alike and surfaces that
    look alike, less walls in space that the other saw through, against all that the two plans show; and *looks*, how
    surely what overlaps looks alike, however little it is. The first tells outdoor places apart, the second storeys
    whose walls are alike. Both are taken in standard deviations among all pairs of the two scans: a corridor is
    somewhat like many. All turns by quarters and all shifts are tried at once in the frequency domain, some
    milliseconds a pair.
    """
    count = len(descriptors)
    places, appearance = np.zeros((count, count)), np.zeros((count, count))
    for start in range(0, count, BLOCK):
        columns = range(start, min(start + BLOCK, count))
        spectra = np.empty(
            (len(columns), CHANNELS + APPEARANCE.stop - APPEARANCE.start, SIDE, SIDE // 2 + 1), np.complex64
        )
        for slot, j in enumerate(columns):
            spectra[slot] = _spectra(descriptors[j].plan)
        weights = np.array([_weights(descriptors[j]) for j in columns])

        def row(
            i: int, spectra: NDArray[np.complex64] = spectra, weights: Float64 = weights, start: int = start
        ) -> tuple[Float32, Float32]:
            before = max(0, min(len(spectra), i - start))
            return _compared(descriptors[i], spectra[:before], weights[:before])

        rows = range(start + 1, count)
        for i, (place, look) in zip(rows, ordered_map(row, rows, processors()), strict=True):
            places[i, start : start + len(place)] = place
            appearance[i, start : start + len(look)] = look
    return (_standard(places + places.T) + APPEARANCE_COUNT * _standard(appearance + appearance.T)) / (
        1 + APPEARANCE_COUNT
    )


def _compared(
    one: PlanDescriptor, spectra: NDArray[np.complex64], weights: Float64
) -> tuple[Float32, Float32]:
    """Both measures between a plan and others, of which there are spectra."""
    own_walls, own_looks = _weights(one)
    wall_weight = (own_walls * weights[:, 0]).astype(np.float32)[:, None, None]
    look_weight = (ALIKE * own_looks * weights[:, 1]).astype(np.float32)[:, None, None]
    places, appearance = np.full((2, len(spectra)), -np.inf, dtype=np.float32)
    for turn in range(4):
        a = np.conj(_spectra(_turned(one.plan, turn)))
        walls, free = a[:FACINGS], a[FREE]
        # What each channel of the other is worth here: walls of its own facing, less what lies in free space.
        worth = [*(walls - CONFLICT * free), -CONFLICT * walls.sum(axis=0)]
        walls_met = _correlated(worth, spectra[:, : FREE + 1])
        looks_met = _correlated(a[APPEARANCE], spectra[:, APPEARANCE])
        cells_met = _correlated(a[APPEARANCE.stop :], spectra[:, APPEARANCE.stop :])
        place = wall_weight * walls_met + look_weight * looks_met
        # By chance the sum of products grows with the root of how many there are.
        look = looks_met / np.sqrt(np.maximum(cells_met, 0) + FEW_CELLS)
        places = np.maximum(places, place.max(axis=(1, 2)))
        appearance = np.maximum(appearance, look.max(axis=(1, 2)))
    return places, appearance


def _correlated(
    worth: Sequence[NDArray[np.complex64]] | NDArray[np.complex64], spectra: NDArray[np.complex64]
) -> Float32:
    """(N, SIDE, SIDE) sum over the channels of the correlation under every shift."""
    product = np.zeros((len(spectra), *spectra.shape[2:]), dtype=np.complex64)
    for channel, spectrum in enumerate(worth):
        product += spectrum * spectra[:, channel]
    correlated: Float32 = fft.irfft2(product, s=(SIDE, SIDE), overwrite_x=True)
    return correlated


def _standard(values: Float64) -> Float64:
    """Symmetric (N, N) in standard deviations from the mean of both rows, the diagonal left out."""
    count = len(values)
    if count < 3:
        return np.zeros_like(values)
    others = values[~np.eye(count, dtype=np.bool_)].reshape(count, count - 1)
    mean, spread = others.mean(axis=1), np.maximum(others.std(axis=1), 1e-6)
    standard: Float64 = (values - (mean[:, None] + mean) / 2) / np.sqrt(spread[:, None] * spread)
    return standard


def expected_overlap(a: PlanDescriptor, b: PlanDescriptor, b_from_a: Float64) -> float:
    """Share of the walls of each plan that lie on walls of the other under a pose between scanners, the smaller."""
    height = b.plan_from_scanner[2] @ b_from_a[:3, 3]
    if abs(height) > WALL_BAND:
        return 0.0
    turn = b.plan_from_scanner @ b_from_a[:3, :3] @ a.plan_from_scanner.T
    shift = b.plan_from_scanner @ b_from_a[:3, 3]
    there = _on_walls(a.walls, b.walls, turn[:2, :2], shift[:2])
    back = _on_walls(b.walls, a.walls, turn[:2, :2].T, -turn[:2, :2].T @ shift[:2])
    return min(there, back)


def _heading(normals: Floating) -> float:
    """Heading of most walls, radians in a quarter turn."""
    degrees = np.degrees(np.arctan2(normals[:, 1], normals[:, 0])) % 90
    histogram = np.bincount(degrees.astype(np.intp) % 90, minlength=90).astype(np.float64)
    kernel = np.exp(-0.5 * (np.arange(-3, 4) / 1.2) ** 2)
    smooth = np.convolve(np.concatenate([histogram[-3:], histogram, histogram[:3]]), kernel, mode="valid")
    best = int(smooth.argmax())
    before, here, after = smooth[best - 1], smooth[best], smooth[(best + 1) % 90]
    curvature = before - 2 * here + after
    offset = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
    return float(np.radians(best + 0.5 + offset))


def _seen_through(ends: Floating) -> Bool:
    """(SIDE, SIDE) cells that rays to some of the (N, 2) ends cross well before they end."""
    ends = ends[:: max(1, len(ends) // RAYS)]
    lengths = np.linalg.norm(ends, axis=1)
    ends, lengths = ends[lengths > 2 * CELL], lengths[lengths > 2 * CELL]
    along = np.arange(0.5, SIDE / 2, 0.7) * CELL
    crossed = along[None] < lengths[:, None] - 1.5 * CELL
    places = (ends / lengths[:, None])[:, None] * along[None, :, None]
    cells = np.floor(places[crossed] / CELL).astype(np.int64) + SIDE // 2
    cells = cells[((cells >= 0) & (cells < SIDE)).all(axis=1)]
    free = np.zeros((SIDE, SIDE), dtype=np.bool_)
    free[cells[:, 0], cells[:, 1]] = True
    return free


def _drawn(cells: Int64, values: Floating, drawn: Bool) -> Floating:
    """(SIDE, SIDE) mean of each cell against that of all, in standard deviations, two at the most."""
    out = np.zeros(SIDE * SIDE)
    drawn = drawn & np.isfinite(values)
    if drawn.sum() >= LEAST_COMPARED:
        key = cells[drawn, 0] * SIDE + cells[drawn, 1]
        count = np.bincount(key, minlength=SIDE * SIDE)
        seen = count > 0
        mean = np.bincount(key, values[drawn], SIDE * SIDE)[seen] / count[seen]
        out[seen] = np.clip((mean - mean.mean()) / (mean.std() + LEAST_CONTRAST), -2, 2)
    return out.reshape(SIDE, SIDE)


def _turned(plan: NDArray[np.int8], turn: int) -> NDArray[np.int8]:
    """The plan after so many quarter turns."""
    turned = np.rot90(plan, turn, axes=(1, 2))
    facings = [(facing - turn) % FACINGS for facing in range(FACINGS)]
    return np.concatenate([turned[facings], turned[FACINGS:]])


def _weights(one: PlanDescriptor) -> tuple[float, float]:
    """Of walls and of brightness: each goes together with itself to 1."""
    walls = float(one.plan[:FACINGS].sum())
    appearance = float(((one.plan[APPEARANCE] / STEPS) ** 2).sum())
    return 1 / np.sqrt(max(walls, 1.0)), 1 / np.sqrt(appearance + 1)


def _spectra(plan: NDArray[np.int8]) -> NDArray[np.complex64]:
    """Of all channels, looks in standard deviations, and of the cells whose looks are known."""
    appearance = plan[APPEARANCE]
    drawn = np.concatenate(
        [plan[: FREE + 1], appearance / np.float32(STEPS), appearance != 0], dtype=np.float32
    )
    spectra: NDArray[np.complex64] = fft.rfft2(drawn, axes=(1, 2))
    return spectra


def _on_walls(a: Bool, b: Bool, turn: Float64, shift: Float64) -> float:
    """Share of the cells of `a` that fall on, or beside, those of `b`."""
    places = (np.argwhere(a) - SIDE // 2 + 0.5) * CELL @ turn.T + shift
    cells = np.floor(places / CELL).astype(np.int64) + SIDE // 2
    cells = cells[((cells >= 1) & (cells < SIDE - 1)).all(axis=1)]
    if not len(places):
        return 0.0
    beside = b.copy()
    for axis in (0, 1):
        beside |= np.roll(b, 1, axis) | np.roll(b, -1, axis)
    return float(beside[cells[:, 0], cells[:, 1]].sum() / len(places))
