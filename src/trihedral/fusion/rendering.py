"""Pictures of a scan that has colour or intensity but no photographs: perspective views."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import InputError, OptionError
from trihedral.geometry.arrays import Float64, Floating
from trihedral.scan.scan import Scan
from trihedral.scan.view import View

# A grid is regular where its points lie within this share of a step of their row's and column's angles ...
OFF_GRID = 0.25
# ... for this share of the points.
ON_GRID = 0.9
# An unordered scan is put on a spherical grid with cells this much wider than the mean distance of its points, so
# that few of them stay empty.
CELL_WIDTHS = 1.5
# A view is no smaller than this.
LEAST_PIXELS = 64


@dataclass(frozen=True)
class RenderingOptions:
    """Which views are rendered."""

    #: Views around the horizon, the first along +x.
    views: int = 8
    #: Radians, across and down.
    field_of_view: float = float(np.radians(60.0))
    #: "auto": colour where the scan has it, else intensity.
    paint: Literal["auto", "color", "intensity"] = "auto"
    #: Pixels along each side of a view, at the most.
    most_pixels: int = 1200
    #: Cells; gaps up to twice as wide are painted over, their points stay unknown.
    hole: int = 2
    #: Pixels over which intensity is evened out.
    contrast_radius: float = 16.0

    def __post_init__(self) -> None:
        if self.views < 1 or self.most_pixels < LEAST_PIXELS or self.hole < 0:
            raise OptionError(
                f"views must be at least 1, most_pixels at least {LEAST_PIXELS}, hole not negative"
            )
        if not 0 < self.field_of_view <= np.radians(150.0):
            raise OptionError("the field of view must be above 0 and up to 150 degrees")
        if self.paint not in ("auto", "color", "intensity"):
            raise OptionError(f"paint is 'auto', 'color' or 'intensity', not {self.paint!r}")
        if self.contrast_radius <= 0:
            raise OptionError("contrast_radius must be positive")


@dataclass(frozen=True)
class _Panorama:
    """A scan over a grid of directions about the scanner."""

    #: (R, C, 3) float32 scanner-centred; NaN where nothing was seen.
    points: NDArray[np.float32]
    edge: NDArray[np.bool_]
    #: (R, C, K) float32 grey or colour; 0 where nothing was seen.
    paint: NDArray[np.float32]
    #: (R, C) whether the paint is known.
    painted: NDArray[np.bool_]

    @property
    def seen(self) -> NDArray[np.bool_]:
        return np.asarray(np.isfinite(self.points[..., 0]))

    def taken(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> "_Panorama":
        """Rows and columns by their indices."""
        where = np.ix_(rows, columns)
        return _Panorama(self.points[where], self.edge[where], self.paint[where], self.painted[where])


@dataclass(frozen=True)
class _Sphere:
    """A panorama whose rows have one elevation (rad) each, columns one azimuth, both rising."""

    panorama: _Panorama
    elevation: Float64
    azimuth: Float64

    @property
    def steps(self) -> tuple[float, float]:
        return float(np.median(np.diff(self.elevation))), float(np.median(np.diff(self.azimuth)))


def rendered_views(scan: Scan, options: RenderingOptions | None = None) -> list[View]:
    """Perspective views around the horizon, named by their heading.

    The scanner's own grid is sampled where its rows and columns are regular; other scans are put on a spherical grid
    first. Between four known cells of one surface, points are interpolated; elsewhere a pixel has the nearest cell's.
    Views that show nothing are left out.

    Raises
    ------
    InputError
        If the scan has neither colour nor intensity, or not the one that was asked for, or no points.
    """
    options = options or RenderingOptions()
    offset = _scanner(scan)
    sphere = _wrapped(_regular(scan, offset, options) or _projected(scan, offset, options))
    # About one cell a pixel at the centre of the view.
    cell = float(np.sqrt(sphere.steps[0] * sphere.steps[1]))
    half = float(np.tan(options.field_of_view / 2))
    size = int(np.clip(2 * half / cell, LEAST_PIXELS, options.most_pixels))
    focal = size / 2 / half
    paint, painted = _filled(sphere, 1 / focal, options.hole)
    views = []
    for k in range(options.views):
        yaw = 2 * np.pi * k / options.views
        row, column = _places(sphere, yaw, size, focal)
        rendered, shown = _sampled_paint(paint, painted, row, column)
        points, edge = _sampled_points(sphere.panorama, row, column)
        if np.isfinite(points).any():
            heading = f"{np.degrees(yaw):.0f} deg"
            image = _finished(rendered, shown, options)
            views.append(View(heading, image, (points + offset).astype(np.float32), edge))
    return views


def _scanner(scan: Scan) -> Float64:
    if not len(scan):
        raise InputError(scan.header.source, "the scan has no points", place=scan.header.place)
    return np.asarray(scan.header.scanner_origin, dtype=np.float64) - scan.local_origin


def _centred(scan: Scan, offset: Float64) -> NDArray[np.float32]:
    return np.ascontiguousarray(scan.xyz - offset.astype(np.float32))


def _paint(scan: Scan, options: RenderingOptions) -> NDArray[np.float32]:
    """(N, 3) colours or (N, 1) intensities as they are looked at: about 0..255, dark scans brightened."""
    if options.paint != "intensity" and scan.color is not None:
        known = scan.color if scan.colored is None else scan.color[scan.colored]
        bright = float(np.percentile(known.max(axis=1), 99))
        return scan.color.astype(np.float32) * np.float32(250.0 / max(bright, 16.0))
    if options.paint != "color" and scan.intensity is not None:
        # Local contrast is found on the logarithm, where fall-off with range is a shift.
        least = max(float(np.percentile(scan.intensity, 1)), 1e-4)
        return np.log(np.maximum(scan.intensity, np.float32(least)))[:, None]
    wanted = {"auto": "neither colour nor intensity", "color": "no colour", "intensity": "no intensity"}
    raise InputError(
        scan.header.source,
        f"the points have {wanted[options.paint]}, so no picture can be rendered",
        place=scan.header.place,
    )


def _gridded(scan: Scan, offset: Float64, options: RenderingOptions) -> _Panorama | None:
    """The scanner's own grid."""
    if scan.row is None or scan.column is None:
        return None
    centred = _centred(scan, offset)
    row, column = (np.ascontiguousarray(k, dtype=np.int32) for k in (scan.row, scan.column))
    grid = _core.scanned_grid(centred, row, column)
    return None if grid is None else _panorama(scan, centred, grid, options)


def _panorama(
    scan: Scan,
    centred: NDArray[np.float32],
    grid: _core.DirectionGrid,
    options: RenderingOptions,
) -> _Panorama:
    cells = grid.points
    values = _paint(scan, options)
    seen = cells >= 0
    points = np.full((*cells.shape, 3), np.nan, dtype=np.float32)
    points[seen] = centred[cells[seen]]
    paint = np.zeros((*cells.shape, values.shape[1]), dtype=np.float32)
    paint[seen] = values[cells[seen]]
    painted = seen.copy()
    if values.shape[1] == 3 and scan.colored is not None:
        painted[seen] = scan.colored[cells[seen]]
    return _Panorama(points, grid.edges, paint, painted)


def _regular(scan: Scan, offset: Float64, options: RenderingOptions) -> _Sphere | None:
    """The scanner's own grid, if each row has one elevation and each column one azimuth."""
    panorama = _gridded(scan, offset, options)
    if panorama is None:
        return None
    rows, columns = (np.flatnonzero(panorama.seen.any(axis=axis)) for axis in (1, 0))
    if min(len(rows), len(columns)) < 8:
        return None
    panorama = panorama.taken(np.arange(rows[0], rows[-1] + 1), np.arange(columns[0], columns[-1] + 1))
    x, y, z = (panorama.points[..., k].astype(np.float64) for k in range(3))
    heading = np.where(panorama.seen, np.exp(1j * np.arctan2(y, x)), 0)
    elevations = np.arctan2(z, np.hypot(x, y))
    elevation, azimuth = np.full(len(elevations), np.nan), np.full(elevations.shape[1], np.nan)
    elevation[rows - rows[0]] = np.nanmedian(elevations[rows - rows[0]], axis=1)
    azimuth[columns - columns[0]] = np.unwrap(np.angle(heading.sum(axis=0))[columns - columns[0]])
    for angles in (elevation, azimuth):
        known = np.flatnonzero(np.isfinite(angles))
        angles[:] = np.interp(np.arange(len(angles)), known, angles[known])
    up, round_ = np.diff(elevation), np.diff(azimuth)
    if not all((steps > 0).all() or (steps < 0).all() for steps in (up, round_)):
        return None
    off_row = np.abs(elevations - elevation[:, None]) / np.abs(np.median(up))
    off_column = np.abs(np.angle(heading * np.exp(-1j * azimuth))) / np.abs(np.median(round_))
    if ((off_row < OFF_GRID) & (off_column < OFF_GRID))[panorama.seen].mean() < ON_GRID:
        return None
    by_row, by_column = np.argsort(elevation), np.argsort(azimuth)
    return _Sphere(panorama.taken(by_row, by_column), elevation[by_row], azimuth[by_column])


def _projected(scan: Scan, offset: Float64, options: RenderingOptions) -> _Sphere:
    """Any scan on a spherical grid about the scanner; of several points in a cell the nearest is seen."""
    centred = _centred(scan, offset)
    coarse = _core.projected_grid(centred, float(np.radians(1.0))).points
    latitude = (np.arange(len(coarse)) + 0.5) / len(coarse) * np.pi - np.pi / 2
    cell = np.cos(latitude) * (np.pi / len(coarse)) * (2 * np.pi / coarse.shape[1])
    covered = float(((coarse >= 0).sum(axis=1) * cell).sum())
    step = float(np.clip(CELL_WIDTHS * np.sqrt(covered / len(scan)), 4e-4, np.radians(1.0)))
    grid = _core.projected_grid(centred, step)
    rows, columns = grid.points.shape
    elevation = (np.arange(rows) + 0.5) / rows * np.pi - np.pi / 2
    azimuth = (np.arange(columns) + 0.5) / columns * 2 * np.pi - np.pi
    return _Sphere(_panorama(scan, centred, grid, options), elevation, azimuth)


def _wrapped(sphere: _Sphere) -> _Sphere:
    """A full circle closed: its first column once more after the last, and the last before the first."""
    azimuth = sphere.azimuth
    if azimuth[-1] - azimuth[0] + 1.5 * sphere.steps[1] < 2 * np.pi:
        return sphere
    count = len(azimuth)
    around = np.concatenate([[count - 1], np.arange(count), [0]])
    closed = azimuth[around]
    closed[0] = min(azimuth[-1] - 2 * np.pi, azimuth[0] - 1e-9)
    closed[-1] = max(azimuth[0] + 2 * np.pi, azimuth[-1] + 1e-9)
    panorama = sphere.panorama.taken(np.arange(len(sphere.elevation)), around)
    return _Sphere(panorama, sphere.elevation, closed)


def _filled(sphere: _Sphere, pixel: float, hole: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Paint, averaged over what a pixel (rad) of a view covers, with small holes filled; and where there is any."""
    seen = sphere.panorama.painted.astype(np.float32)
    paint = sphere.panorama.paint * seen[..., None]
    rows, columns = (max(1, round(pixel / step)) for step in sphere.steps)
    mean = _blurred(paint, (columns, rows)) / np.maximum(_blurred(seen, (columns, rows)), 1e-6)[..., None]
    around = (columns + 2 * hole, rows + 2 * hole)
    weight = _blurred(seen, around)
    near = _blurred(paint, around) / np.maximum(weight, 1e-6)[..., None]
    painted = (weight > 1e-4).astype(np.float32)
    return np.where(seen[..., None] > 0, mean, near) * painted[..., None], painted


def _blurred(image: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    if size == (1, 1):
        return image
    return np.asarray(cv2.blur(image, size), dtype=np.float32).reshape(image.shape)


def _places(sphere: _Sphere, yaw: float, size: int, focal: float) -> tuple[Float64, Float64]:
    """Row and column of the grid, in fractions, that each pixel of a view looks at; NaN outside the grid."""
    across = (np.arange(size) - (size - 1) / 2) / focal
    right, down = np.meshgrid(across, across)
    elevation = np.arctan2(-down, np.hypot(right, 1.0))
    azimuth = yaw - np.arctan(right)
    azimuth = sphere.azimuth[0] + np.mod(azimuth - sphere.azimuth[0], 2 * np.pi)
    row = np.interp(elevation, sphere.elevation, np.arange(len(sphere.elevation)), left=np.nan, right=np.nan)
    column = np.interp(azimuth, sphere.azimuth, np.arange(len(sphere.azimuth)), right=np.nan)
    outside = np.isnan(row) | np.isnan(column)
    return np.where(outside, np.nan, row), np.where(outside, np.nan, column)


def _corners(
    row: Float64, column: Float64, shape: tuple[int, ...]
) -> list[tuple[NDArray[np.intp], NDArray[np.intp], Float64]]:
    """The four cells around each place and their bilinear weights; weights are 0 outside the grid."""
    inside = np.isfinite(row)
    row, column = np.where(inside, row, 0.0), np.where(inside, column, 0.0)
    top = np.clip(np.floor(row).astype(np.intp), 0, shape[0] - 2)
    left = np.clip(np.floor(column).astype(np.intp), 0, shape[1] - 2)
    v, u = row - top, column - left
    return [
        (top, left, inside * (1 - v) * (1 - u)),
        (top, left + 1, inside * (1 - v) * u),
        (top + 1, left, inside * v * (1 - u)),
        (top + 1, left + 1, inside * v * u),
    ]


def _sampled_paint(
    paint: NDArray[np.float32], painted: NDArray[np.float32], row: Float64, column: Float64
) -> tuple[Floating, Floating]:
    values = np.zeros((*row.shape, paint.shape[2]), dtype=np.float32)
    weight = np.zeros(row.shape, dtype=np.float32)
    for r, c, share in _corners(row, column, paint.shape):
        values += paint[r, c] * share[..., None].astype(np.float32)
        weight += painted[r, c] * share.astype(np.float32)
    shown = weight > 0.5
    return values / np.maximum(weight, 0.5)[..., None], shown.astype(np.float32)


def _sampled_points(panorama: _Panorama, row: Float64, column: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    corners = _corners(row, column, panorama.edge.shape)
    between = np.zeros((*row.shape, 3))
    nearest = np.full((*row.shape, 3), np.nan)
    greatest = np.zeros(row.shape)
    edge = np.zeros(row.shape, dtype=bool)
    for r, c, share in corners:
        points = panorama.points[r, c].astype(np.float64)
        between += points * share[..., None]
        nearer = share > greatest
        nearest[nearer] = points[nearer]
        greatest = np.maximum(greatest, share)
        edge |= panorama.edge[r, c] & (share > 0)
    surface = np.isfinite(between).all(axis=2) & ~edge & (greatest > 0)
    return np.where(surface[..., None], between, nearest), edge


def _finished(image: Floating, shown: Floating, options: RenderingOptions) -> NDArray[np.uint8]:
    """Bytes; intensity evened out; what was not seen carries on its surroundings, so that its rim is no feature."""
    if image.shape[2] == 1:
        image = _evened(image[..., 0], shown, options.contrast_radius)[..., None]
    image = _carried_on(image, shown)
    return np.asarray(np.clip(np.rint(image), 0, 255), dtype=np.uint8).squeeze()


def _evened(image: Floating, shown: Floating, radius: float) -> Floating:
    """Deviation from the local mean in units of the local spread, about 128.

    The spread is no less than half its median over the picture: plain walls show no more than noise.
    """

    def local(values: Floating) -> Floating:
        return np.asarray(cv2.GaussianBlur(values * shown, (0, 0), radius), dtype=np.float32) / weight

    weight = np.maximum(np.asarray(cv2.GaussianBlur(shown, (0, 0), radius), dtype=np.float32), 1e-6)
    mean = local(image)
    deviation = (image - mean) * shown
    spread = np.sqrt(local(deviation**2))
    if not shown.any():
        return np.full_like(image, 128.0)
    least = max(float(np.median(spread[shown > 0])), 1e-6) / 2
    return np.float32(128) + np.float32(48) * deviation / np.maximum(spread, np.float32(least))


def _carried_on(image: Floating, shown: Floating) -> Floating:
    """Unknown pixels from ever coarser means of the known ones around them."""
    if (shown > 0).all() or not (shown > 0).any() or min(shown.shape) < 2:
        return image
    height, width = shown.shape

    def halved(values: Floating) -> Floating:
        shape = ((height + 1) // 2, (width + 1) // 2, *values.shape[2:])
        return np.asarray(cv2.pyrDown(values), dtype=np.float32).reshape(shape)

    weight = halved(shown)
    mean = halved(image * shown[..., None]) / np.maximum(weight, 1e-6)[..., None]
    coarse = _carried_on(mean, (weight > 1e-3).astype(np.float32))
    fine = np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
    return np.where(shown[..., None] > 0, image, fine.reshape(image.shape))
