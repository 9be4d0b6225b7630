"""Figures of the source paper from a job's own links: matched pictures, planes with their corner, coloured cloud."""

import base64
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from trihedral.geometry.arrays import Float64
from trihedral.initial.visual.scan_features import Picture
from trihedral.report.axes import STATION_COLOURS, as_png, as_uri
from trihedral.report.map import hexadecimal
from trihedral.report.section import Samples, moved, trusted

_WIDTH = 1000.0  # units of a wide figure
_GAP = 12.0
_GREY = (186, 192, 200)
_PLANES = (STATION_COLOURS[0], STATION_COLOURS[1], STATION_COLOURS[2])
_MOST_FIGURES = 12  # links that are shown with their figures
_MOST_POINTS = 600_000  # of all scans together, in the coloured cloud: a third of its pixels


@dataclass(frozen=True)
class StationAppearance:
    """What figures show beside the surface of each station, by its name.

    Attributes
    ----------
    colors
        (N, 3) in 0..1 of the station's surface points, NaN where unknown; None where the scan has none.
    pictures
        Its pictures.
    """

    colors: Callable[[str], NDArray[np.floating[Any]] | None]
    pictures: Callable[[str], Sequence[Picture]]


@dataclass(frozen=True)
class Matched:
    """Two pictures side by side with their matches.

    Attributes
    ----------
    sources
        Data URI, x, width and height of either picture, drawing units.
    lines
        x1, y1, x2, y2 of each match, and whether it follows the pose.
    """

    names: tuple[str, str]
    sources: tuple[tuple[str, float, float, float], ...]
    lines: list[tuple[float, float, float, float, bool]]
    matches: int
    planar: int
    agreeing: int
    height: float


@dataclass(frozen=True)
class PlaneView:
    """A scan seen from above and aside, its three planes in colour, and their corner."""

    name: str
    picture: str
    height: float
    corner: tuple[float, float]
    #: Colour, words.
    planes: list[tuple[str, str]]


@dataclass(frozen=True)
class LinkFigures:
    """What one link of the paper's method shows."""

    names: tuple[str, str]
    method: str
    overlap: str
    reason: str | None
    matched: list[Matched]
    planes: list[PlaneView]


def link_figures(
    document: Mapping[str, Any], samples: Samples, appearance: StationAppearance | None
) -> list[LinkFigures]:
    """Draw each link that used pictures or planes; links with a pose first."""
    links = [k for k in document["links"] if "visual" in k["evidence"] or "planes" in k["evidence"]]
    links.sort(key=lambda link: (not link["accepted"], link["transform"] is None))
    return [_figures(link, samples, appearance) for link in links[:_MOST_FIGURES]]


def _figures(link: Mapping[str, Any], samples: Samples, appearance: StationAppearance | None) -> LinkFigures:
    evidence = link["evidence"]
    names = (link["from"], link["to"])
    matched: list[Matched] = []
    if appearance is not None and "visual" in evidence:
        shown = [{p.name: p for p in appearance.pictures(name)} for name in names]
        matched = [
            _matched(pair, shown[0][pair["from_picture"]], shown[1][pair["to_picture"]])
            for pair in evidence["visual"]["pairs"]
            if pair["from_picture"] in shown[0] and pair["to_picture"] in shown[1]
        ]
    planes: list[PlaneView] = []
    if "planes" in evidence and all(name in samples for name in names):
        found = evidence["planes"]
        # Both scans are looked at from one side: the second as it is, the first turned into its frame.
        poses = (np.eye(4) if link["transform"] is None else np.array(link["transform"]), np.eye(4))
        planes = [
            plane_view(name, samples[name], found[end], found[f"corner_{end}"], found["tolerance_m"], pose)
            for name, end, pose in zip(names, ("from", "to"), poses, strict=True)
        ]
    overlap = evidence.get("overlap_initial")
    said = ""
    if overlap is not None:
        threshold = evidence["overlap_threshold"]
        said = (
            f"After the initial alignment {overlap['to']:.0%} of {names[1]}, the reference scan, has {names[0]} "
            f"within {overlap['slack_m']:.2f} m and what its own points lie apart; the threshold is {threshold:.0%}"
        )
    return LinkFigures(names, link["method"] or "none", said, link["reason"], matched[:3], planes)


def _matched(pair: Mapping[str, Any], a: Picture, b: Picture) -> Matched:
    half = (_WIDTH - _GAP) / 2
    heights = [half * picture.size[1] / picture.size[0] for picture in (a, b)]
    sources = tuple(
        ("data:image/jpeg;base64," + base64.b64encode(picture.jpeg).decode(), left, half, height)
        for picture, left, height in zip((a, b), (0.0, half + _GAP), heights, strict=True)
    )
    scales = [half / picture.size[0] for picture in (a, b)]
    lines = [
        (
            (p[0] + 0.5) * scales[0],
            (p[1] + 0.5) * scales[0],
            half + _GAP + (q[0] + 0.5) * scales[1],
            (q[1] + 0.5) * scales[1],
            bool(agrees),
        )
        for p, q, agrees in zip(pair["from_pixels"], pair["to_pixels"], pair["drawn_agreeing"], strict=True)
    ]
    # Those that agree are drawn over the others.
    lines.sort(key=lambda line: line[4])
    return Matched(
        (a.name, b.name), sources, lines, pair["matches"], pair["planar"], pair["agreeing"], max(heights)
    )


def plane_view(
    name: str,
    points: NDArray[np.floating[Any]],
    planes: Sequence[Mapping[str, Any]],
    corner: Sequence[float],
    tolerance: float,
    pose: Float64,
) -> PlaneView:
    """Draw a scan under a pose, points on its three planes in colour (Fig. 6 of the paper).

    Parameters
    ----------
    points
        (N, 3) station coordinates, metres.
    planes
        With `normal`, `distance_m`, `points` and `rank`.
    corner
        Where they meet, station coordinates.
    """
    colours = np.empty((len(points), 3))
    colours[:] = _GREY
    for colour, plane in zip(_PLANES, planes, strict=True):
        on = np.abs(points @ np.array(plane["normal"]) - plane["distance_m"]) <= tolerance
        colours[on] = colour
    # The corner may lie far out: what is near it and the scan is shown.
    where = moved(pose, np.asarray(corner, dtype=np.float64)[None])
    image, to_unit = oblique(moved(pose, points), colours, 488, 488.0, keep=where)
    x, y = to_unit(where)[0]
    words = [
        (
            hexadecimal(colour),
            f"no. {p['rank']} by size, {p['points']} points, {1e3 * p['thickness_m']:.0f} mm thick",
        )
        for colour, p in zip(_PLANES, planes, strict=True)
    ]
    return PlaneView(name, as_uri(as_png(image)), 488.0 * image.height / image.width, (x, y), words)


def coloured_cloud(
    document: Mapping[str, Any], samples: Samples, appearance: StationAppearance
) -> tuple[str, float] | None:
    """The placed scans in their own colours from above and aside: data URI, and height at a width of 1000 units."""
    poses = trusted(document)
    clouds, inks = [], []
    names = [name for name in sorted(poses) if name in samples]
    for name in names:
        colors = appearance.colors(name)
        if colors is None:
            continue
        step = max(1, -(-len(samples[name]) * len(names) // _MOST_POINTS))
        known = np.isfinite(colors).all(axis=1) & (np.asarray(colors).max(axis=1) > 0)
        clouds.append(moved(poses[name], samples[name][known][::step]))
        inks.append(np.rint(255.0 * np.clip(colors[known][::step], 0, 1)).astype(np.uint8))
    if not clouds or not sum(len(cloud) for cloud in clouds):
        return None
    image, _ = oblique(np.concatenate(clouds), np.concatenate(inks), 1200, _WIDTH)
    return as_uri(as_png(image, 128)), _WIDTH * image.height / image.width


def oblique(
    points: Float64, colours: NDArray[np.number[Any]], pixels: int, units: float, keep: Float64 | None = None
) -> tuple[Image.Image, Callable[[Float64], Float64]]:
    """Draw points from above and aside, parallel rays, nearer ones over farther ones.

    Parameters
    ----------
    colours
        (N, 3) whole numbers, 0 to 255.

    Returns
    -------
    The picture, `pixels` wide, and what takes (N, 3) places to x, y in drawing units, of which it is `units` wide.
    """
    turn, lift = math.radians(30.0), math.radians(40.0)
    right = np.array([math.cos(turn), math.sin(turn), 0.0])
    away = np.array([-math.sin(turn), math.cos(turn), 0.0])
    up = math.sin(lift) * away + np.array([0.0, 0.0, math.cos(lift)])
    depth_axis = math.cos(lift) * away - np.array([0.0, 0.0, math.sin(lift)])
    flat = np.stack([points @ right, points @ up], axis=1)
    low, high = np.quantile(flat, (0.01, 0.99), axis=0)
    if keep is not None:
        places = np.stack([keep @ right, keep @ up], axis=1)
        low, high = np.minimum(low, places.min(axis=0)), np.maximum(high, places.max(axis=0))
    margin = 0.04 * max(float(np.max(high - low)), 0.5)
    low, high = low - margin, high + margin
    scale = pixels / float(high[0] - low[0])
    rows = int(min(max(math.ceil(float(high[1] - low[1]) * scale), 40), 1.2 * pixels))
    canvas = np.full((rows, pixels, 3), 255, dtype=np.uint8)
    order = np.argsort(-(points @ depth_axis), kind="stable")
    column = np.floor((flat[order, 0] - low[0]) * scale).astype(np.int64)
    row = np.floor((high[1] - flat[order, 1]) * scale).astype(np.int64)
    ink = colours[order]
    for down, aside in ((0, 0), (0, 1), (1, 0), (1, 1)):
        r, c = row + down, column + aside
        inside = (r >= 0) & (r < rows) & (c >= 0) & (c < pixels)
        # Of several points in one pixel the last, nearest one stays.
        canvas[r[inside], c[inside]] = ink[inside]

    def to_unit(places: Float64) -> Float64:
        x, y = (places @ right - low[0]) * scale, (high[1] - places @ up) * scale
        unit: Float64 = np.stack([x, y], axis=1) * (units / pixels)
        return unit

    return Image.fromarray(canvas, "RGB"), to_unit
