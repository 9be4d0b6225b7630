"""What people's exports make of a scan: the same points without a grid, thinned, cropped, turned, merged.

Each kind is a function of a scan, and of a number where it has one, that gives a scan.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import inverse, motion, transform
from trihedral.simulate.scanner import SimulatedScan

Mask = NDArray[np.bool_]

# Eastings, northings and heights of a national grid, metres.
NATIONAL = (345_678.0, 5_712_345.0, 123.0)
# Centre and width of what a camera saw, degrees of elevation.
BAND = (-10.0, 60.0)
# A robot around its scanner: radius, lowest and highest point, metres; turn that it covers, degrees; noise, metres.
BODY_RADIUS, BODY_LOW, BODY_HIGH, BODY_TURN, BODY_NOISE = 0.2, -0.3, -0.05, 200.0, 0.002
# How far above a floor, or below a ceiling, people cut; metres.
CLEAR_OF_FLOOR = 0.15
# Rays steeper than this, degrees, tell where floor and ceiling are.
STEEP = 45.0


@dataclass(frozen=True)
class FileScan:
    """A scan as a file holds it."""

    name: str
    #: (N, 3) float32 or float64, metres, the file's frame.
    xyz: NDArray[Any]
    #: (N,) float32 in 0..1, or None.
    intensity: NDArray[np.float32] | None
    #: (N, 3) uint8, or None.
    color: NDArray[np.uint8] | None
    #: (N,) int32 both, or None.
    row: NDArray[np.int32] | None
    column: NDArray[np.int32] | None
    #: Rows and columns; None where the file keeps none.
    grid: tuple[int, int] | None
    #: (4, 4) truth.
    project_from_file: Float64
    #: (S, 3) where the scanner stood, the file's frame; several of merged scans and of a moving scanner.
    scanners: Float64
    #: Seed of the site and number of the station.
    seed: tuple[int, int]
    #: Which of (N, 3) points, project frame, lie in what crops left of the field of view.
    keeps: Callable[[Float64], Mask] = lambda points: np.ones(len(points), bool)

    def __len__(self) -> int:
        return len(self.xyz)

    def of(self, chosen: NDArray[Any] | slice) -> "FileScan":
        """Some of the points, in the order given."""
        columns: dict[str, Any] = {}
        for name in ("xyz", "intensity", "color", "row", "column"):
            values = getattr(self, name)
            columns[name] = None if values is None else values[chosen]
        return replace(self, **columns)

    def random(self, purpose: int) -> np.random.Generator:
        """Give random numbers of this station for one purpose."""
        return np.random.default_rng((*self.seed, 23, purpose))


def as_measured(one: SimulatedScan, seed: tuple[int, int]) -> FileScan:
    """Take a simulated scan as the scanner writes it: column by column, from the scanner."""
    order = np.lexsort((one.row, one.column))
    return FileScan(
        one.name,
        one.xyz[order],
        one.intensity[order],
        None if one.color is None else one.color[order],
        one.row[order],
        one.column[order],
        one.grid,
        one.project_from_station,
        np.zeros((1, 3)),
        seed,
    )


def without_grid(scan: FileScan) -> FileScan:
    """List the points without rows and columns."""
    return replace(scan, row=None, column=None, grid=None)


def shuffled(scan: FileScan) -> FileScan:
    """Put the points into random order; each keeps its row and column, if there are any."""
    return scan.of(scan.random(1).permutation(len(scan)))


def thinned(scan: FileScan, metres: float) -> FileScan:
    """Keep the first point of each cube of an edge of so many metres; no grid is left."""
    cell = np.floor(scan.xyz.astype(np.float64) / metres).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    _, first = np.unique((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2], return_index=True)
    return without_grid(scan.of(np.sort(first)))


def random_share(scan: FileScan, share: float) -> FileScan:
    """Keep a random share of the points, each with the same chance; no grid is left."""
    return without_grid(scan.of(scan.random(2).random(len(scan)) < share))


def rounded(scan: FileScan, metres: float) -> FileScan:
    """Round coordinates to whole steps."""
    whole = np.round(scan.xyz.astype(np.float64) / metres) * metres
    return replace(scan, xyz=whole.astype(scan.xyz.dtype))


def cropped(scan: FileScan, inside: Callable[[Float64], Mask]) -> FileScan:
    """Keep the points (N, 3) of the file's frame that are `inside`."""
    before, file_from_project = scan.keeps, inverse(scan.project_from_file)

    def keeps(points: Float64) -> Mask:
        return before(points) & inside(transform(file_from_project, points))

    return replace(scan.of(inside(scan.xyz.astype(np.float64))), keeps=keeps)


def window(scan: FileScan, degrees: float) -> FileScan:
    """Keep a horizontal window; those of a site look about the same way, as people scan towards something."""
    drawn = np.random.default_rng((scan.seed[0], 29))
    heading = drawn.uniform(0.0, 360.0) + scan.random(3).uniform(-20.0, 20.0)
    ahead = np.array([np.cos(np.radians(heading)), np.sin(np.radians(heading)), 0.0])
    ahead = scan.project_from_file[:3, :3].T @ ahead
    up = scan.project_from_file[:3, :3].T @ [0.0, 0.0, 1.0]
    side = np.cross(up, ahead)

    def inside(points: Float64) -> Mask:
        rays = points - scan.scanners[0]
        return np.asarray(np.abs(np.arctan2(rays @ side, rays @ ahead)) <= np.radians(degrees / 2))

    return cropped(scan, inside)


def cut_at(scan: FileScan, metres: float) -> FileScan:
    """Keep what is nearer to the scanner."""

    def inside(points: Float64) -> Mask:
        return np.asarray(np.linalg.norm(points - scan.scanners[0], axis=1) <= metres)

    return cropped(scan, inside)


def without_floor(scan: FileScan) -> FileScan:
    """Cut off what is not clear of the floor below the scanner."""
    return _level_cut(scan, np.array([0.0, 0.0, -1.0]))


def without_ceiling(scan: FileScan) -> FileScan:
    """Cut off what is not clear of the ceiling above the scanner; out of doors nothing."""
    return _level_cut(scan, np.array([0.0, 0.0, 1.0]))


def _level_cut(scan: FileScan, towards: Float64) -> FileScan:
    """Cut off what lies as far `towards` (3,), project axes, as what steep rays meet there."""
    axis = scan.project_from_file[:3, :3].T @ towards
    rays = scan.xyz.astype(np.float64) - scan.scanners[0]
    depth = rays @ axis
    steep = depth > np.sin(np.radians(STEEP)) * np.linalg.norm(rays, axis=1)
    if not steep.any():
        return scan
    level = float(np.median(depth[steep])) - CLEAR_OF_FLOOR
    return cropped(scan, lambda points: np.asarray((points - scan.scanners[0]) @ axis < level))


def moved(scan: FileScan, to_from_file: Float64) -> FileScan:
    """Give the points in another frame."""
    xyz = transform(to_from_file, scan.xyz)
    if not to_from_file[:3, 3].any():
        xyz = xyz.astype(scan.xyz.dtype)
    return replace(
        scan,
        xyz=xyz,
        project_from_file=scan.project_from_file @ inverse(to_from_file),
        scanners=transform(to_from_file, scan.scanners),
    )


def hanging(scan: FileScan) -> FileScan:
    """Measure by a scanner that hangs from a ceiling: z down."""
    return moved(scan, motion(np.diag([1.0, -1.0, -1.0])))


def lying(scan: FileScan) -> FileScan:
    """Measure by a scanner that lies on its side, on any of them: its z level."""
    turn = scan.random(4).uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    on_its_side = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    return moved(scan, motion(on_its_side @ [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def y_up(scan: FileScan) -> FileScan:
    """Call the axis that points up y, as programs that draw do."""
    return moved(scan, motion(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])))


def in_project(scan: FileScan) -> FileScan:
    """Give project coordinates; no pose is kept."""
    return moved(scan, scan.project_from_file)


def in_national_grid(scan: FileScan) -> FileScan:
    """Give coordinates of a national grid, where numbers are large; no pose is kept."""
    return moved(scan, motion(None, np.array(NATIONAL)) @ scan.project_from_file)


def bare(scan: FileScan) -> FileScan:
    """Leave out colour and intensity."""
    return replace(scan, color=None, intensity=None)


def colorless(scan: FileScan) -> FileScan:
    """Leave out colour."""
    return replace(scan, color=None)


def black(scan: FileScan) -> FileScan:
    """Have fields for colour that nothing was put into."""
    return replace(scan, color=np.zeros((len(scan), 3), np.uint8))


def flat(scan: FileScan) -> FileScan:
    """Have an intensity that is the same everywhere."""
    return replace(scan, intensity=np.full(len(scan), 0.5, np.float32))


def false_colors(scan: FileScan) -> FileScan:
    """Colour points by height, blue to red over what this scan shows."""
    height = transform(scan.project_from_file, scan.xyz)[:, 2]
    low, high = np.percentile(height, [1.0, 99.0])
    share = np.clip((height - low) / max(high - low, 1e-6), 0.0, 1.0)
    color = np.stack([share, 1.0 - np.abs(2.0 * share - 1.0), 1.0 - share], axis=1)
    return replace(scan, color=np.rint(255.0 * color).astype(np.uint8))


def color_band(scan: FileScan) -> FileScan:
    """Leave points black that a camera with a narrower field of view than the scanner did not see."""
    rays = (scan.xyz.astype(np.float64) - scan.scanners[0]) @ scan.project_from_file[:3, :3].T
    elevation = np.degrees(np.arctan2(rays[:, 2], np.hypot(rays[:, 0], rays[:, 1])))
    color = np.zeros((len(scan), 3), np.uint8) if scan.color is None else scan.color.copy()
    color[np.abs(elevation - BAND[0]) > BAND[1] / 2] = 0
    return replace(scan, color=color)


def with_body(scan: FileScan, share: float) -> FileScan:
    """Have so large a share of points on the robot that carries the scanner: the same ones in each scan."""
    count = round(len(scan) * share / (1.0 - share))
    rng = np.random.default_rng(31)
    turn = np.radians(rng.uniform(0.0, BODY_TURN, count))
    radius = BODY_RADIUS + BODY_NOISE * rng.standard_normal(count)
    points = np.stack(
        [radius * np.cos(turn), radius * np.sin(turn), rng.uniform(BODY_LOW, BODY_HIGH, count)], axis=1
    )
    extra = {
        "xyz": (points + scan.scanners[0]).astype(scan.xyz.dtype),
        "intensity": np.full(count, 0.5, np.float32),
        "color": np.full((count, 3), 128, np.uint8),
    }
    joined: dict[str, Any] = {}
    for name, values in extra.items():
        own = getattr(scan, name)
        joined[name] = None if own is None else np.concatenate([values, own])
    return replace(without_grid(scan), **joined)


def merged(scans: Sequence[FileScan]) -> FileScan:
    """Put all scans into one list of points, in the frame of the first."""
    first = scans[0]
    from_project = inverse(first.project_from_file)
    parts = [without_grid(moved(scan, from_project @ scan.project_from_file)) for scan in scans]

    def joined(name: str) -> Any:
        columns = [getattr(part, name) for part in parts]
        return None if any(column is None for column in columns) else np.concatenate(columns)

    columns = {name: joined(name) for name in ("xyz", "intensity", "color", "scanners")}
    return replace(parts[0], **columns)


#: Kinds without a number, and with one.
PLAIN: dict[str, Callable[[FileScan], FileScan]] = {
    "nogrid": without_grid,
    "shuffled": shuffled,
    "nofloor": without_floor,
    "noceiling": without_ceiling,
    "hanging": hanging,
    "lying": lying,
    "y-up": y_up,
    "project": in_project,
    "national": in_national_grid,
    "bare": bare,
    "colorless": colorless,
    "black": black,
    "flat": flat,
    "false-colors": false_colors,
    "color-band": color_band,
}
#: With the least and the most that its number may be.
NUMBERED: dict[str, tuple[Callable[[FileScan, float], FileScan], float, float]] = {
    "thinned": (thinned, 0.001, 1.0),
    "rounded": (rounded, 1e-6, 1.0),
    "random": (random_share, 0.001, 1.0),
    "window": (window, 1.0, 360.0),
    "cut": (cut_at, 0.5, 1000.0),
    "body": (with_body, 0.001, 0.9),
}
MERGED = "merged"
#: Those that leave less of the field of view.
CROPS = ("window", "cut", "nofloor", "noceiling")
