"""What a scanner saw all around it, as one picture with ranges: the faces of a cube, bounded in size."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.scan.scan import Scan

Float32 = NDArray[np.float32]

# Cells this much wider than the mean distance of points stay empty seldom.
CELL_WIDTHS = 1.2
# A face has at least so many cells along each side.
LEAST_SIDE = 64
# Ranges of neighbouring cells of one surface differ by up to so many cells: it is seen at 80 degrees at the most.
STEEPEST = 6.0


@dataclass(frozen=True)
class SurroundingsOptions:
    """How finely the surroundings are drawn."""

    most_side: int = 448  # cells along each side of a face
    even: int = 101  # cells over which contrast is evened out

    def __post_init__(self) -> None:
        if self.most_side < LEAST_SIDE or self.even < 3:
            raise OptionError(f"most_side must be at least {LEAST_SIDE} and even at least 3")


@dataclass(frozen=True)
class Surroundings:
    """Grey and range in every direction about the scanner; the faces (+x, -x, +y, -y, +z, -z) one below the other.

    Attributes
    ----------
    grey
        (6 S, S) uint8, contrast evened out; cells without a point carry on their neighbours.
    range
        (6 S, S) metres; 0 where nothing was seen.
    edge
        (6 S, S) ranges jump in the cell's neighbourhood, or part of it was not seen.
    """

    grey: NDArray[np.uint8]
    range: Float32
    edge: NDArray[np.bool_]

    @property
    def side(self) -> int:
        """Cells along each side of a face."""
        return int(self.grey.shape[1])

    @property
    def cell(self) -> float:
        """Angle (rad) of a cell in the middle of a face."""
        return 2.0 / self.side

    def places(self, directions: NDArray[np.floating]) -> tuple[Float32, Float32]:
        """Column and row, in fractions (cell centres at integers), that directions (..., 3) fall on."""
        size = np.abs(directions)
        axis = size.argmax(axis=-1)
        depth = np.take_along_axis(directions, axis[..., None], axis=-1)[..., 0]
        across = np.take_along_axis(directions, ((axis + 1) % 3)[..., None], axis=-1)[..., 0] / np.abs(depth)
        along = np.take_along_axis(directions, ((axis + 2) % 3)[..., None], axis=-1)[..., 0] / np.abs(depth)
        face = 2 * axis + (depth < 0)
        last = self.side - 1
        # Held half a cell inside the face: beyond it the picture shows another one.
        column = np.clip((across + 1) * 0.5 * self.side - 0.5, 0, last)
        row = np.clip((along + 1) * 0.5 * self.side - 0.5, 0, last) + face * self.side
        return column.astype(np.float32), row.astype(np.float32)

    def pictured(self, column: Float32, row: Float32) -> NDArray[np.uint8]:
        """Grey at places (H, W) of `places`, interpolated."""
        return np.asarray(cv2.remap(self.grey, column, row, cv2.INTER_LINEAR), dtype=np.uint8)


def surroundings(scan: Scan, options: SurroundingsOptions | None = None) -> Surroundings | None:
    """Draw a scan's colour, or its intensity where it has no colour; None where it has neither or no points."""
    options = options or SurroundingsOptions()
    if (scan.color is None and scan.intensity is None) or not len(scan):
        return None
    offset = np.asarray(scan.header.scanner_origin - scan.local_origin, dtype=np.float32)
    centred = scan.xyz - offset if offset.any() else scan.xyz
    # Points spread over the whole sphere: a face has a sixth of them.
    side = 8 * int(np.clip(np.sqrt(len(scan) / 6) / CELL_WIDTHS, LEAST_SIDE, options.most_side) / 8)
    intensity = None if scan.color is not None else scan.intensity
    color = None if scan.color is None else np.ascontiguousarray(scan.color)
    grey, ranges = _core.cube_map(np.ascontiguousarray(centred), intensity, color, side)
    seen = ranges > 0
    if not seen.any():
        return None
    # Contrast is a matter of ratios: light and range shift the logarithm.
    least = max(float(np.percentile(grey[seen], 2)), 1e-4)
    grey = np.log(np.maximum(grey, np.float32(least)))
    faces = []
    filled = []
    for face in range(6):
        part = slice(face * side, (face + 1) * side)
        known = seen[part].astype(np.float32)
        faces.append(_evened(_carried(grey[part], known), options.even))
        filled.append(np.where(seen[part], ranges[part], _carried(ranges[part], known, steps=1)))
    ranges = np.concatenate(filled).astype(np.float32)
    return Surroundings(np.concatenate(faces), ranges, _edges(ranges, side))


def _carried(values: Float32, known: Float32, steps: int = 4) -> Float32:
    """Means of the known neighbours, nearer ones first, where a value is not known."""
    values = values * known
    for step in range(steps):
        size = (3 + 4 * step, 3 + 4 * step)
        weight = np.asarray(cv2.blur(known, size), dtype=np.float32)
        mean = np.asarray(cv2.blur(values, size), dtype=np.float32) / np.maximum(weight, 1e-6)
        reached = weight > 1e-3
        values = np.where(known > 0, values, np.where(reached, mean, 0)).astype(np.float32)
        known = np.maximum(known, reached.astype(np.float32))
    if steps > 1 and known.any():
        values = np.where(known > 0, values, values[known > 0].mean()).astype(np.float32)
    return values


def _evened(image: Float32, width: int) -> NDArray[np.uint8]:
    """Deviation from the local mean in units of the local spread, which is no less than its median."""
    size = (width, width)
    deviation = image - np.asarray(cv2.blur(image, size), dtype=np.float32)
    # Running sums leave squares of nothing a little below it.
    square = np.asarray(cv2.blur(deviation * deviation, size), dtype=np.float32)
    spread = np.sqrt(np.maximum(square, 0.0))
    least = max(float(np.median(spread)), 1e-6)
    evened = 128 + 48 * deviation / np.maximum(spread, np.float32(least))
    return np.asarray(np.clip(np.rint(evened), 0, 255), dtype=np.uint8)


def _edges(ranges: Float32, side: int) -> NDArray[np.bool_]:
    around = np.ones((3, 3), dtype=np.uint8)
    jump = np.empty(ranges.shape, dtype=bool)
    for face in range(6):
        part = slice(face * side, (face + 1) * side)
        here = ranges[part]
        nearest, farthest = cv2.erode(here, around), cv2.dilate(here, around)
        jump[part] = (nearest == 0) | (farthest - nearest > 2 * STEEPEST * 2 / side * here + 0.02)
    return jump
