"""Axes of a drawing from above, and points drawn into them as pixels."""

import base64
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from trihedral.geometry.arrays import Float64

Colour = tuple[int, int, int]

# Okabe and Ito's colours (Color Universal Design, 2008), told apart by colour-blind readers; yellow, which is
# lost on paper, left out.
STATION_COLOURS: tuple[Colour, ...] = (
    *((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167)),
    *((60, 60, 70), (86, 180, 233), (230, 159, 0)),
)

# A point covers its pixel and, by half, the eight around it.
_DOT = tuple(((r, c), 1.0 if (r, c) == (0, 0) else 0.5) for r in (-1, 0, 1) for c in (-1, 0, 1))


@dataclass(frozen=True)
class Axes:
    """Project x to the right and y upwards, in metres, shown `width` units wide."""

    left: float
    bottom: float
    right: float
    top: float
    width: float

    @property
    def scale(self) -> float:
        """Units a metre."""
        return self.width / (self.right - self.left)

    @property
    def height(self) -> float:
        """Units."""
        return self.scale * (self.top - self.bottom)

    def at(self, place: Sequence[float] | Float64) -> tuple[float, float]:
        """Where a place (x, y in metres) lies, in units from the top left."""
        return (float(place[0]) - self.left) * self.scale, (self.top - float(place[1])) * self.scale

    def ticks(self) -> tuple[float, list[float], list[float]]:
        """Choose a round step and the grid lines in x and y, metres."""
        step = round_down((self.right - self.left) / 5.0)
        lines = [
            [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
            for low, high in ((self.left, self.right), (self.bottom, self.top))
        ]
        return step, lines[0], lines[1]


def round_down(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that is not over the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(factor * power for factor in (5.0, 2.0, 1.0) if factor * power <= value * (1 + 1e-9))


def axes_around(clouds: Iterable[Float64], places: Iterable[Float64], width: float, tallest: float) -> Axes:
    """Choose a window that holds all places and the points, less the outermost half per cent of each side.

    Clouds are (N, 2 or more), places (2 or more,), metres; `width` is the drawing's, units. `tallest` is the height
    over width that the window may have; a taller site gets room at its sides.
    """
    corners = [np.asarray(place, dtype=np.float64)[None, :2] for place in places]
    points = [cloud[:, :2] for cloud in clouds if len(cloud)]
    if points:
        corners.append(np.quantile(np.concatenate(points), (0.005, 0.995), axis=0, method="nearest"))
    limits = np.concatenate(corners) if corners else np.zeros((1, 2))
    low, high = limits.min(axis=0), limits.max(axis=0)
    middle, size = 0.5 * (low + high), np.maximum(high - low, 1.0)
    size = size + 0.12 * size.max()
    size[0] = max(size[0], size[1] / tallest)
    size[1] = max(size[1], 0.25 * size[0])
    low, high = (middle - 0.5 * size).tolist(), (middle + 0.5 * size).tolist()
    return Axes(low[0], low[1], high[0], high[1], width)


def paint(axes: Axes, layers: Sequence[tuple[Float64, Colour]], pixels: int) -> Image.Image:
    """Draw points as soft dots on white; where colours meet in one pixel they mix, so no cloud hides another.

    Layers are (N, 2 or more) points in metres, and their colour; the picture is `pixels` wide.
    """
    rows = max(1, round(pixels * axes.height / axes.width))
    keys, weights, inks = [np.zeros(0, dtype=np.int64)], [np.zeros(0)], [np.zeros((0, 3))]
    for points, colour in layers:
        column = np.floor((points[:, 0] - axes.left) / (axes.right - axes.left) * pixels).astype(np.int64)
        row = np.floor((axes.top - points[:, 1]) / (axes.top - axes.bottom) * rows).astype(np.int64)
        inside = (column > 0) & (column < pixels - 1) & (row > 0) & (row < rows - 1)
        hit, counts = np.unique((row * pixels + column)[inside], return_counts=True)
        for step, weight in _DOT:
            keys.append(hit + step[0] * pixels + step[1])
            weights.append(counts * weight)
            inks.append(np.broadcast_to(np.array(colour, dtype=np.float64), (len(hit), 3)))
    # Only the pixels that are hit are worked on: a section leaves most of the paper white.
    pixel, inverse = np.unique(np.concatenate(keys), return_inverse=True)
    load, ink = np.concatenate(weights), np.concatenate(inks)
    sums = np.stack([np.bincount(inverse, load * ink[:, k], len(pixel)) for k in range(3)], axis=1)
    total = np.bincount(inverse, load, len(pixel))
    cover = 1.0 - np.exp(-1.5 * total)
    canvas = np.full((rows * pixels, 3), 255, dtype=np.uint8)
    mixed = 255.0 * (1.0 - cover)[:, None] + (cover / np.maximum(total, 1e-12))[:, None] * sums
    canvas[pixel] = np.rint(mixed).astype(np.uint8)
    return Image.fromarray(canvas.reshape(rows, pixels, 3), "RGB")


def as_png(image: Image.Image, colours: int = 64) -> bytes:
    """Encode with a palette, which halves the file and shows no difference here."""
    buffer = io.BytesIO()
    image.convert("RGB").quantize(colours, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
        buffer, "PNG", optimize=True
    )
    return buffer.getvalue()


def as_uri(png: bytes) -> str:
    """Write a PNG as an address that holds it."""
    return "data:image/png;base64," + base64.b64encode(png).decode()


def assign_colours(
    names: Sequence[str],
    neighbours: Iterable[tuple[str, str]],
    palette: Sequence[Colour] = STATION_COLOURS,
) -> dict[str, Colour]:
    """Give each station a colour, linked stations different ones as far as the palette allows."""
    linked: dict[str, set[str]] = {name: set() for name in names}
    for a, b in neighbours:
        if a in linked and b in linked and a != b:
            linked[a].add(b)
            linked[b].add(a)
    chosen: dict[str, int] = {}
    for index, name in enumerate(names):
        taken = {chosen[other] for other in linked[name] if other in chosen}
        order = [(index + k) % len(palette) for k in range(len(palette))]
        chosen[name] = next((k for k in order if k not in taken), order[0])
    return {name: palette[k] for name, k in chosen.items()}
