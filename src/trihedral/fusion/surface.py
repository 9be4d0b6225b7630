"""The surface that a scan saw, drawn into a camera: what shows in each pixel, and what is hidden."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.fusion import camera as lens
from trihedral.geometry.motion import Matrix
from trihedral.scan import CameraModel, Scan

Float32 = NDArray[np.float32]

#: Points projected at a time: the temporaries of so many fit in some tens of megabytes.
_BLOCK = 1 << 18
#: Corners of a triangle that shows lie within this angle (rad) and so many steps between beams of the picture.
_BESIDE = 0.2
_BESIDE_STEPS = 4.0


class ScanSurface:
    """Points of a scan joined to a surface where neighbouring beams met one.

    Parameters
    ----------
    scan
        Of any format: its own grid is used where it has one, a spherical one about the scanner elsewhere.
    """

    def __init__(self, scan: Scan) -> None:
        self.scanner = np.asarray(scan.header.scanner_origin, dtype=np.float64)
        self._shift = self.scanner - scan.local_origin
        points = np.ascontiguousarray(scan.xyz - self._shift.astype(np.float32))
        grid = scan.header.grid is not None and scan.row is not None and scan.column is not None
        self._core = _core.Surface(
            points,
            scan.row if grid else None,
            scan.column if grid else None,
        )
        self._count = len(points)
        # The scan's points in the order of its grid; behind them those that close holes of single lost beams.
        self.points: Float32 = self._core.points
        # Which of the scan's points each of them is.
        self.source: NDArray[np.uint32] = self._core.source
        self.ranges: Float32 = _lengths(self.points)

    def __len__(self) -> int:
        """How many points the scan has."""
        return self._count

    @property
    def step(self) -> float:
        """Angle between neighbouring beams (rad)."""
        return self._core.step

    @property
    def range_noise(self) -> float:
        """Standard deviation of a range (m)."""
        return self._core.range_noise

    def draw(self, camera: CameraModel, station_from_camera: Matrix) -> "Drawing":
        """Project every point, and tell what shows in each pixel.

        Parameters
        ----------
        camera
            A complete one (`trihedral.fusion.camera.complete`).
        station_from_camera
            4x4.
        """
        centre = (station_from_camera[:3, 3] - self.scanner).astype(np.float32)
        rotation = np.asarray(station_from_camera[:3, :3], dtype=np.float64)
        rays = lens.pixel_rays(camera)
        near = self._near(camera, rays, centre, rotation)
        count = len(self.points)
        pixels = np.full((count, 2), np.nan, np.float32)
        distances = np.full(count, np.inf, np.float32)
        for start in range(0, len(near), _BLOCK):
            at = near[start : start + _BLOCK]
            offset = self.points[at] - centre
            distances[at] = _lengths(offset)
            pixels[at] = lens.project(camera, _turned(rotation.T, offset.astype(np.float64)))
        turned = _turned(rotation, rays).astype(np.float32)
        shown, nearest = self._core.draw(
            centre,
            turned,
            pixels,
            distances,
            (camera.width, camera.height),
            lens.pixels_per_radian(camera),
            lens.period(camera),
        )
        own = near[: np.searchsorted(near, self._count)]
        return Drawing(self, camera, centre, turned, own, pixels[own], distances[own], shown, nearest)

    def _near(
        self, camera: CameraModel, rays: NDArray[np.float64], centre: Float32, rotation: Matrix
    ) -> NDArray[np.integer]:
        """Points that may fall into a picture, or be corners of a triangle that does, in order."""
        if camera.kind != "pinhole":
            return np.arange(len(self.points))
        widest = math.acos(np.clip(np.nanmin(rays[:, 2]), -1.0, 1.0)) + _BESIDE
        axis = rotation[:, 2].astype(np.float32)
        return self._core.in_cone(centre, axis, math.cos(min(widest, math.pi)), _BESIDE_STEPS)

    def station_points(self, centred: Float32) -> Float32:
        """Scanner-centred points (..., 3) in station coordinates minus the scan's local origin."""
        return np.asarray(centred + self._shift.astype(np.float32), np.float32)


@dataclass(frozen=True)
class Drawing:
    """A surface as one camera sees it.

    Attributes
    ----------
    rays
        (H * W, 3) unit directions of the pixels, station axes.
    at
        (M,) indices of the surface's points that are the scan's and may fall into the picture.
    pixels, distances
        (M, 2) and (M,) their columns and rows, NaN where the camera cannot show them, and distances from the
        camera (m).
    shown
        (H, W) distance (m) of the surface in the middle of the pixel; infinite where none is known.
    nearest
        (H, W) distance (m) of the nearest thing that may hide others there; infinite for none.
    """

    surface: ScanSurface
    camera: CameraModel
    centre: Float32
    rays: Float32
    at: NDArray[np.integer]
    pixels: Float32
    distances: Float32
    shown: Float32
    nearest: Float32

    def visible(self) -> NDArray[np.int64]:
        """Which of `at` fall into the picture with nothing before them."""
        camera = self.camera
        column, row = self._folded()
        with np.errstate(invalid="ignore"):
            inside = np.flatnonzero(
                (column >= -0.5) & (column < camera.width - 0.5) & (row >= -0.5) & (row < camera.height - 0.5)
            )
        column, row = column[inside], row[inside]
        u = np.clip(np.rint(column).astype(np.int64), 0, camera.width - 1)
        v = np.clip(np.rint(row).astype(np.int64), 0, camera.height - 1)
        before = np.maximum(self.nearest[v, u], self._between(column, row))
        own = self.surface.step * self.surface.ranges[self.at[inside]]
        slack = np.maximum(5.0 * self.surface.range_noise, own)
        return np.asarray(inside[self.distances[inside] <= before + slack])

    def columns_rows(self, which: NDArray[np.int64]) -> tuple[Float32, Float32]:
        """Columns and rows of some of `at`, within the picture also of a panorama that goes round."""
        column, row = self._folded()
        return column[which], row[which]

    def _folded(self) -> tuple[Float32, Float32]:
        column, row = self.pixels[:, 0], self.pixels[:, 1]
        turn = lens.period(self.camera)
        if turn is not None:
            column = np.mod(column + 0.5, np.float32(turn)) - np.float32(0.5)
            column = np.minimum(column, np.float32(self.camera.width - 0.501))
        return column, row

    def _between(self, column: Float32, row: Float32) -> Float32:
        """Depth between the four pixels around; infinite where one of them is empty, so zero is given there."""
        left = np.clip(np.floor(column).astype(np.int64), 0, max(self.camera.width - 2, 0))
        top = np.clip(np.floor(row).astype(np.int64), 0, max(self.camera.height - 2, 0))
        right = np.minimum(left + 1, self.camera.width - 1)
        bottom = np.minimum(top + 1, self.camera.height - 1)
        a, b = column - left, row - top
        # Inverse depths of a plane are linear over the picture; those of nothing are zero.
        inverse = (1 - b) * ((1 - a) / self.shown[top, left] + a / self.shown[top, right]) + b * (
            (1 - a) / self.shown[bottom, left] + a / self.shown[bottom, right]
        )
        four = np.stack(
            [self.nearest[y, x] for y, x in ((top, left), (top, right), (bottom, left), (bottom, right))]
        )
        low, high = four.min(axis=0), four.max(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Across a jump nothing lies between.
            smooth = np.isfinite(high) & (high - low <= 0.2 * low)
            return np.where(smooth, 1.0 / inverse, 0.0).astype(np.float32)

    def points(self) -> Float32:
        """(H, W, 3) the point that each pixel shows, station coordinates minus local origin; NaN for none."""
        distance = np.where(self.hidden(), np.nan, self.shown)
        distance[~np.isfinite(distance)] = np.nan
        centred = self.rays.reshape(*distance.shape, 3) * distance[..., None] + self.centre
        return self.surface.station_points(centred)

    def hidden(self) -> NDArray[np.bool_]:
        """(H, W) whether what the mesh shows there may be hidden by the rim of something nearer."""
        known = np.isfinite(self.shown)
        depth = np.where(known, self.shown, 0.0)
        slack = np.maximum(5.0 * self.surface.range_noise, self.surface.step * depth)
        return np.asarray(known & (self.nearest < depth - slack))


def _lengths(vectors: Float32) -> Float32:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def _turned(rotation: Matrix, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) vectors times a 3x3 rotation; on so thin a matrix plain sums are faster than a matrix product."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    turned = np.empty((len(vectors), 3))
    for k in range(3):
        turned[:, k] = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
    return turned
