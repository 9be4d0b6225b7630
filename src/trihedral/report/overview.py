"""The registered cloud from above as one handsome picture, for a README or a slide."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from trihedral.atomic import write_new
from trihedral.geometry.arrays import Float64
from trihedral.report.axes import Axes, Colour, as_png, assign_colours, axes_around, round_down
from trihedral.report.map import scanner_place
from trihedral.report.section import Samples, choose_level, moved, thinned, trusted
from trihedral.verdict.ranking import used_links

_PAPER: Colour = (13, 19, 31)
# Okabe and Ito's hues, lightened to stand on the dark.
_INKS: tuple[Colour, ...] = (
    *((86, 180, 233), (240, 138, 70), (60, 200, 150), (222, 150, 190)),
    *((240, 228, 110), (120, 150, 255), (235, 235, 240)),
)
_NARROW, _WIDE = 500.0, 1100.0  # pixels of the panels
_STRIP = 40.0  # pixels below the registered view for the words
_MOST_BYTES = 300_000
_FINE = 2  # lines and letters are drawn this many times larger, then reduced


def write_overview(path: Path | str, document: Mapping[str, Any], samples: Samples) -> None:
    """Draw the scans as they came, small, beside the registered cloud from above; a wide PNG under 300 kB.

    Stations are numbered and linked, each cloud has its station's colour. The registered view is turned so
    that most walls run along the picture's sides and the long side lies across. Walls are bright; what lies
    more than 0.6 m below the cut through them is dim; what lies above it, ceilings and roofs, is left out.

    Takes what `page.write_report` takes.

    Raises
    ------
    OutputError
        The file cannot be written; an older one is untouched.
    """
    poses = trusted(document)
    some = thinned(poses, samples)
    level = choose_level(poses, some).widened(1.2)
    places = {s["name"]: scanner_place(s)[:2] for s in document["stations"] if s["name"] in some}
    links = [link for link in used_links(document) if link["from"] in places and link["to"] in places]
    pairs = [(link["from"], link["to"]) for link in links]
    colours = assign_colours(list(some), pairs, _INKS)
    numbers = {station["name"]: number for number, station in enumerate(document["stations"], start=1)}

    before, after = _View({}, {}, {}), _View({}, {}, {})
    for name, points in some.items():
        cloud = moved(poses[name], points)
        standing = np.abs(cloud[:, 2] - level.middle) <= 0.6
        below = cloud[:, 2] < level.bottom
        before.walls[name], after.walls[name] = points[standing, :2].astype(np.float64), cloud[standing, :2]
        before.ground[name], after.ground[name] = points[below, :2].astype(np.float64), cloud[below, :2]
    turn = _straightening(list(after.walls.values()))
    for parts in (after.walls, after.ground):
        parts.update({name: cloud @ turn.T for name, cloud in parts.items()})
    after.places.update({name: turn @ place for name, place in places.items()})

    large = axes_around([*after.walls.values(), *after.ground.values()], after.places.values(), _WIDE, 0.55)
    large = replace(large, bottom=large.bottom - _STRIP / large.scale)
    narrow = _narrow(before, large.height)
    for shrink in (1.0, 0.87, 0.75, 0.6, 0.45):
        image = Image.new("RGB", (round((_NARROW + _WIDE) * shrink), round(large.height * shrink)), _PAPER)
        for view, axes, left, named in ((before, narrow, 0.0, []), (after, large, _NARROW, pairs)):
            panel = _glow(axes, view, colours, shrink)
            caption = _caption(document, links) if named is pairs else "as they came"
            _draw_over(panel, axes, view, colours, numbers, named, caption)
            image.paste(panel, (round(left * shrink), 0))
        png = as_png(image)
        if len(png) < _MOST_BYTES:
            break
    write_new(path, png)


@dataclass(frozen=True)
class _View:
    """What one panel shows, by station, metres in the plane."""

    walls: dict[str, Float64]
    ground: dict[str, Float64]
    #: Of the scanners; empty where they are not marked.
    places: dict[str, Float64]


def _narrow(view: _View, height: float) -> Axes:
    """Choose a window of the small panel's width and the given height about all that it shows."""
    tight = axes_around([*view.walls.values(), *view.ground.values()], [], _NARROW, 10.0)
    across = max(tight.right - tight.left, (tight.top - tight.bottom) * _NARROW / height)
    x, y = 0.5 * (tight.left + tight.right), 0.5 * (tight.bottom + tight.top)
    half = 0.5 * across
    up = half * height / _NARROW
    return Axes(x - half, y - up, x + half, y + up, _NARROW)


def _straightening(clouds: list[Float64]) -> Float64:
    """Choose the turn, (2, 2), that lays most walls along the axes and the long side across."""
    points = np.concatenate(clouds) if clouds else np.zeros((0, 2))
    if not len(points):
        return np.eye(2)
    points = points[:: max(1, len(points) // 8_000)] - points.mean(axis=0)
    best, turn = -1.0, np.eye(2)
    for degrees in range(90):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        candidate = np.array([[c, -s], [s, c]])
        turned = points @ candidate.T
        # A wall along an axis puts all its points into few of the 0.1 m rows or columns.
        score = 0.0
        for axis in (0, 1):
            rows = np.floor((turned[:, axis] - turned[:, axis].min()) / 0.1).astype(np.int64)
            score += float((np.bincount(rows).astype(np.float64) ** 2).sum())
        if score > best:
            best, turn = score, candidate
    spread = np.ptp(np.quantile(points @ turn.T, (0.01, 0.99), axis=0), axis=0)
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    return turn if spread[0] >= spread[1] else quarter @ turn


def _glow(axes: Axes, view: _View, colours: Mapping[str, Colour], size: float) -> Image.Image:
    """Paint points as light on the dark paper, `size` pixels a unit of the axes."""
    width, rows = round(axes.width * size), round(axes.height * size)
    light = np.zeros((rows, width, 3), dtype=np.float32)
    # The ground is blurred more: it is backdrop, and smooth areas make small files.
    for clouds, strength, passes, gain in ((view.ground, 0.30, 3, 4.0), (view.walls, 1.0, 1, 3.0)):
        counts = np.zeros((rows, width), dtype=np.float32)
        sums = np.zeros((rows, width, 3), dtype=np.float32)
        for name, points in clouds.items():
            column = np.floor((points[:, 0] - axes.left) / (axes.right - axes.left) * width).astype(np.int64)
            row = np.floor((axes.top - points[:, 1]) / (axes.top - axes.bottom) * rows).astype(np.int64)
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < rows)
            flat = np.bincount((row * width + column)[inside], minlength=rows * width)
            hits = flat.reshape(rows, width).astype(np.float32)
            for _ in range(passes):
                hits = _spread(hits)
            counts += hits
            sums += hits[:, :, None] * np.array(colours[name], dtype=np.float32)
        cover = strength * (1.0 - np.exp(-gain * counts))
        light = (
            light * (1.0 - cover)[:, :, None]
            + cover[:, :, None] * sums / np.maximum(counts, 1e-9)[:, :, None]
        )
    dark = np.array(_PAPER, dtype=np.float32)
    pixels = np.clip(dark + light * (1.0 - dark / 255.0), 0.0, 255.0)
    return Image.fromarray(np.rint(pixels).astype(np.uint8), "RGB").convert("RGBA")


def _spread(counts: NDArray[np.float32]) -> NDArray[np.float32]:
    """Share each pixel's light with those around it."""
    for axis in (0, 1):
        around = np.roll(counts, 1, axis) + np.roll(counts, -1, axis)
        counts = np.float32(0.5) * counts + np.float32(0.25) * around
    return counts


def _caption(document: Mapping[str, Any], links: list[Mapping[str, Any]]) -> str:
    stations = document["stations"]
    text = f"{len(trusted(document))} of {len(stations)} scans placed, {len(links)} links"
    p95 = links[0].get("p95_m") if links else None
    return text if p95 is None else f"{text}, worst link P95 {p95 * 1e3:.1f} mm (fit, not accuracy)"


def _draw_over(
    image: Image.Image,
    axes: Axes,
    view: _View,
    colours: Mapping[str, Colour],
    numbers: Mapping[str, int],
    pairs: list[tuple[str, str]],
    caption: str,
) -> None:
    """Add links, numbered stations, a scale bar and a caption."""
    factor = _FINE * image.width / axes.width
    sheet = Image.new("RGBA", (image.width * _FINE, image.height * _FINE), (0, 0, 0, 0))
    draw = ImageDraw.Draw(sheet)

    def at(place: Float64) -> tuple[float, float]:
        x, y = axes.at(place)
        return x * factor, y * factor

    for a, b in pairs:
        draw.line(
            [at(view.places[a]), at(view.places[b])],
            fill=(255, 255, 255, 110),
            width=max(1, round(2.2 * factor)),
        )
    radius = 19.0 * factor
    font = ImageFont.load_default(round(23 * factor))
    for name, place in view.places.items():
        x, y = at(place)
        draw.ellipse(
            [x - radius, y - radius, x + radius, y + radius],
            fill=(*_PAPER, 235),
            outline=(*colours[name], 255),
            width=max(1, round(3.5 * factor)),
        )
        draw.text((x, y), str(numbers[name]), font=font, anchor="mm", fill=(255, 255, 255, 255))
    small = ImageFont.load_default(round(22 * factor))
    soft = (196, 206, 222, 255)
    low = sheet.height - 26.0 * factor
    draw.text((28.0 * factor, low), caption, font=small, anchor="ls", fill=soft)
    metres = round_down(0.2 * (axes.right - axes.left))
    right = sheet.width - 28.0 * factor
    left = right - metres * axes.scale * factor
    line = max(1, round(3 * factor))
    draw.line([(left, low), (right, low)], fill=soft, width=line)
    for x in (left, right):
        draw.line([(x, low - 7 * factor), (x, low + 7 * factor)], fill=soft, width=line)
    draw.text((0.5 * (left + right), low - 12 * factor), f"{metres:g} m", font=small, anchor="ms", fill=soft)
    image.alpha_composite(sheet.resize(image.size, Image.Resampling.BOX))
