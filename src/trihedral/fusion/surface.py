"""The surface that a scan saw, drawn into a camera: what shows in each pixel, and what is hidden."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.fusion import camera as lens
from trihedral.geometry.arrays import Float32
from trihedral.geometry.se3 import Matrix
from trihedral.scan import CameraModel, Scan


class ScanSurface:
    """Points of a scan joined to a surface where neighbouring beams met one.

    The scan's own grid is used where it has one, a spherical one about the scanner elsewhere.
    """

    def __init__(self, scan: Scan) -> None:
        self._scanner = np.asarray(scan.header.scanner_origin, dtype=np.float64)
        self._centre = (self._scanner - scan.local_origin).astype(np.float32)
        grid = scan.header.grid is not None and scan.row is not None and scan.column is not None
        cells = (scan.row, scan.column) if grid else (None, None)
        self._core = _core.Surface(np.ascontiguousarray(scan.xyz), self._centre, *cells)

    @property
    def step(self) -> float:
        """Angle between neighbouring beams (rad)."""
        return self._core.step

    @property
    def range_noise(self) -> float:
        """Standard deviation of a range (m)."""
        return self._core.range_noise

    def draw(
        self, camera: CameraModel, station_from_camera: Matrix, image: NDArray[np.uint8], border: float
    ) -> "VisibleSurface":
        """Tell what shows in each pixel of a picture, and which colours the scan's points take from it.

        Parameters
        ----------
        camera
            A complete one (`trihedral.fusion.camera.complete`).
        station_from_camera
            4x4.
        image
            (H, W, 3) red, green, blue.
        border
            Share of half a picture over which the weights of its colours fall to zero at the border.
        """
        pose = station_from_camera.copy()
        pose[:3, 3] -= self._scanner
        pixels = np.ascontiguousarray(image.reshape(-1, 3))
        rays = lens.pixel_rays(camera)
        drawing = self._core.draw(lens.model(camera), pose, rays, pixels, border)
        points = drawing.points
        points += self._centre
        return VisibleSurface(self, camera, image, drawing.distances, points, drawing.sample)

    def blend(self, samples: Sequence[_core.Sample], gains: NDArray[np.float64]) -> _core.Blend:
        """Mix the colours that points take from P pictures; `gains` (P, 3) bring these to one exposure."""
        return self._core.blend(samples, gains)


@dataclass(frozen=True)
class VisibleSurface:
    """A surface as one camera sees it."""

    surface: ScanSurface
    camera: CameraModel
    #: The picture, (H, W, 3) red, green, blue.
    image: NDArray[np.uint8]
    #: (H, W) distance (m) of the surface at the centre of the pixel; infinite where none is known, or the
    #: rim of something nearer may hide it.
    distance: Float32
    #: (H, W, 3) the point there, station coordinates minus local origin; NaN for none.
    points: Float32
    #: Colours that the scan's points take from the picture.
    sample: _core.Sample
