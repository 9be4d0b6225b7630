"""The drawings of the report, as shapes and pixels that the page's template places."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.report.axes import (
    Array,
    Colour,
    Frame,
    as_png,
    as_uri,
    frame_around,
    paint,
    round_down,
)
from trihedral.report.section import Clouds, Level, Offset, Samples, cut, moved, trusted

_WIDTH = 1000.0  # units of every wide drawing
_GREY: Colour = (176, 182, 190)
_95_IN_PLANE = 2.4477  # sigmas that hold 95 % of a normal distribution in the plane
_MOST_EXAGGERATED = 2000.0  # times; beyond, an ellipse says no more than that it is small
_MOST_REFUSED = 30  # refused pairs that the map still shows


@dataclass(frozen=True)
class Mark:
    """A station on a drawing."""

    x: float
    y: float
    number: int
    name: str
    status: str
    colour: str
    ellipse: tuple[float, float] | None  # half axes, drawing units, exaggerated


@dataclass(frozen=True)
class Line:
    """A link on the map."""

    x1: float
    y1: float
    x2: float
    y2: float
    kind: str  # "accepted", "over" (accepted, out of tolerance), "ambiguous", "doubtful", "refused"
    title: str
    label: str  # shown on the map; empty for most
    label_x: float
    label_y: float


@dataclass(frozen=True)
class Drawing:
    """A window with its background picture, grid, stations and links."""

    frame: Frame
    picture: str  # data URI
    step: float  # metres between grid lines
    columns: list[tuple[float, float]]  # position in units, metres
    rows: list[tuple[float, float]]
    marks: list[Mark]
    lines: list[Line]
    exaggeration: float | None
    hidden: int  # refused links left out

    @property
    def size(self) -> float:
        """Scale of the marks: less than 1 where many stations have to share the map."""
        return min(1.0, math.sqrt(40.0 / max(1, len(self.marks))))


def scanner_place(station: Mapping[str, Any]) -> Array:
    """Where the scanner stood in the project, (3,) metres."""
    origin = np.array(station.get("scanner_origin") or (0.0, 0.0, 0.0))
    place: Array = moved(np.array(station["pose"]), origin[None])[0]
    return place


def hexadecimal(colour: Colour) -> str:
    """Colour as CSS writes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _drawing(frame: Frame, picture: str, marks: list[Mark]) -> Drawing:
    step, columns, rows = frame.ticks()
    return Drawing(
        frame,
        picture,
        step,
        [(frame.at((x, 0.0))[0], x) for x in columns],
        [(frame.at((0.0, y))[1], y) for y in rows],
        marks,
        [],
        None,
        0,
    )


def plan(
    document: Mapping[str, Any],
    slabs: Clouds,
    colours: Mapping[str, Colour],
    broken: frozenset[tuple[str, str]],
    worst: tuple[str, str] | None,
) -> Drawing:
    """Draw the map: section in grey, stations, links by verdict, 95 % ellipses.

    `broken` are the accepted links that are out of tolerance, `worst` is labelled with its P95.
    """
    shown = [s for s in document["stations"] if s["pose"] is not None and s["component"] in (0, None)]
    places = {s["name"]: scanner_place(s) for s in shown}
    # The map is of the stations: of what stands around them it shows as much as keeps them apart.
    around = np.array(list(places.values()) or [np.zeros(3)])[:, :2]
    reach = max(4.0, 0.35 * float(np.ptp(around, axis=0).max()))
    data = frame_around(slabs.values(), around, _WIDTH, 10.0)
    low = np.maximum(around.min(axis=0) - reach, (data.left, data.bottom))
    high = np.minimum(around.max(axis=0) + reach, (data.right, data.top))
    frame = frame_around([], [low, high], _WIDTH, 0.8)
    sigmas = [max(s["sigma_translation_m"][:2]) for s in shown if s.get("sigma_translation_m")]
    exaggeration = None
    if sigmas and max(sigmas) > 0.0:
        share = 0.055 * min(1.0, math.sqrt(40.0 / len(sigmas)))
        largest = share * (frame.right - frame.left) / (_95_IN_PLANE * max(sigmas))
        exaggeration = min(max(1.0, round_down(largest)), _MOST_EXAGGERATED)
    numbers = {s["name"]: index for index, s in enumerate(document["stations"], start=1)}
    marks = []
    for station in shown:
        x, y = frame.at(places[station["name"]])
        sigma, ellipse = station.get("sigma_translation_m"), None
        if sigma and exaggeration:
            factor = _95_IN_PLANE * exaggeration * frame.scale
            ellipse = (factor * sigma[0], factor * sigma[1])
        name = station["name"]
        colour = hexadecimal(colours.get(name, _GREY))
        marks.append(Mark(x, y, numbers[name], name, station["status"], colour, ellipse))
    refused = sum(link["verdict"] == "refused" for link in document["links"])
    lines = []
    for link in document["links"]:
        ends = (link["from"], link["to"])
        if ends[0] not in places or ends[1] not in places:
            continue
        if link["verdict"] == "refused" and refused > _MOST_REFUSED:
            continue
        kind = "over" if ends in broken else link["verdict"]
        p95 = link.get("p95_m")
        figure = "" if p95 is None else f"P95 {p95 * 1e3:.1f} mm"
        title = f"{ends[0]} – {ends[1]}: {'accepted, out of tolerance' if kind == 'over' else kind}, {figure}"
        label = figure if ends == worst else ""
        start, end = frame.at(places[ends[0]]), frame.at(places[ends[1]])
        lines.append(Line(*start, *end, kind, title.rstrip(", "), label, *_clear_of(start, end, marks)))
    order = ("refused", "doubtful", "ambiguous", "accepted", "over")
    lines.sort(key=lambda line: order.index(line.kind))
    picture = as_uri(as_png(paint(frame, [(slab, _GREY) for slab in slabs.values()], 1200), 16))
    drawing = _drawing(frame, picture, marks)
    hidden = refused if refused > _MOST_REFUSED else 0
    return replace(drawing, lines=lines, exaggeration=exaggeration, hidden=hidden)


def _clear_of(start: tuple[float, float], end: tuple[float, float], marks: list[Mark]) -> tuple[float, float]:
    """Choose the place above or below a line that keeps a label farthest from stations and their names."""
    taken = [(mark.x + step, mark.y) for mark in marks for step in (0.0, 30.0, 60.0, 90.0)]
    places = [
        (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]) + lift)
        for lift in (-10.0, 20.0)
        for share in (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8)
    ]
    # A label is wide and low: what lies beside it is nearer than what lies above.
    return max(places, key=lambda p: min(math.hypot(0.4 * (x - p[0]), y - p[1]) for x, y in taken))


def section(document: Mapping[str, Any], slabs: Clouds, colours: Mapping[str, Colour]) -> Drawing:
    """Draw the section, each station in its colour."""
    shown = [(index, s) for index, s in enumerate(document["stations"], start=1) if s["name"] in slabs]
    places = {s["name"]: scanner_place(s) for _, s in shown}
    frame = frame_around(slabs.values(), places.values(), _WIDTH, 1.0)
    picture = as_uri(as_png(paint(frame, [(slabs[name], colours[name]) for name in sorted(slabs)], 1800)))
    marks = [
        Mark(*frame.at(places[s["name"]]), n, s["name"], s["status"], hexadecimal(colours[s["name"]]), None)
        for n, s in shown
    ]
    return _drawing(frame, picture, marks)


@dataclass(frozen=True)
class Profile:
    """Two stations' points along a piece of wall, looked at from above, stretched across it."""

    letter: str
    x: float  # where it lies on the section, drawing units
    y: float
    names: tuple[str, str]
    colours: tuple[str, str]
    millimetres: float
    half_length: float  # metres along the wall to either side
    half_range_mm: float  # across the wall
    stretch: float  # how many times larger the scale across is than along
    paths: tuple[str, str]  # SVG, in a box of 400 by 220
    levels: tuple[float, float]  # height of each wall in that box
    ticks: list[tuple[float, float]]  # height in the box, mm


_BOX = (400.0, 220.0)


def profile(
    offset: Offset, slabs: Clouds, frame: Frame, colours: Mapping[str, Colour], letter: str
) -> Profile:
    """Draw both stations' points along one piece of wall; heights count from the first station's wall."""
    half_length = 0.75
    half_range = max(0.01, 2.5 * abs(offset.metres))
    along = np.array([offset.across[1], -offset.across[0]])
    parts: list[NDArray[np.float64]] = []
    for name in offset.stations:
        step = slabs[name][:, :2] - offset.place
        local = np.stack([step @ along, step @ offset.across, slabs[name][:, 2]], axis=1)
        band = (np.abs(local[:, 0]) <= half_length) & (np.abs(local[:, 1]) <= half_range + 0.02)
        parts.append(local[band])
    base = _over_first(parts)
    width, height = _BOX
    across = 0.5 * height / half_range
    paths = []
    for part, heights in zip(parts, base, strict=True):
        stride = max(1, len(part) // 500)
        inside = np.abs(heights) <= half_range
        x = (part[inside, 0] + half_length) * 0.5 * width / half_length
        y = 0.5 * height - heights[inside] * across
        paths.append("".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[::stride], y[::stride], strict=True)))
    levels = [0.5 * height - metres * across for metres in (0.0, offset.metres)]
    tick = round_down(half_range * 1e3 / 2.0)
    count = int(half_range * 1e3 / tick + 1e-9)
    lines = [(0.5 * height - k * tick * 1e-3 * across, k * tick) for k in range(-count, count + 1)]
    ticks = [line for line in lines if 8.0 <= line[0] <= height - 8.0]
    where = frame.at(offset.place)
    names = offset.stations
    return Profile(
        letter,
        *where,
        names,
        (hexadecimal(colours[names[0]]), hexadecimal(colours[names[1]])),
        offset.metres * 1e3,
        half_length,
        half_range * 1e3,
        across / (0.5 * width / half_length),
        (paths[0], paths[1]),
        (levels[0], levels[1]),
        ticks,
    )


def _over_first(parts: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Heights of both parts (rows of along, across, z) over the plane of the first part's middle metre."""
    first = parts[0][np.abs(parts[0][:, 0]) <= 0.5]
    if len(first) < 6:
        return [part[:, 1] for part in parts]
    middle = first[:, 2].mean()
    design = np.stack([np.ones(len(first)), first[:, 0], first[:, 2] - middle], axis=1)
    for _ in range(2):
        plane = np.linalg.lstsq(design, first[:, 1], rcond=None)[0]
        height = np.abs(first[:, 1] - design @ plane)
        kept = height <= max(2.0 * float(np.sqrt(np.mean(height**2))), 1e-4)
        if kept.sum() < 6:
            break
        first, design = first[kept], design[kept]
    return [
        part[:, 1] - plane[0] - plane[1] * part[:, 0] - plane[2] * (part[:, 2] - middle) for part in parts
    ]


@dataclass(frozen=True)
class Candidate:
    """One of several poses that explain a scan nearly as well, drawn over the scan it was matched to."""

    station: str
    neighbour: str
    letter: str
    picture: str
    width: float
    height: float
    x: float  # where it puts the scanner
    y: float
    heading_deg: float


_MOST_AMBIGUOUS = 6
_MOST_CANDIDATES = 3


def candidates(
    document: Mapping[str, Any],
    samples: Samples,
    slabs: Clouds,
    level: Level,
    colour: Colour,
) -> list[list[Candidate]]:
    """Draw the poses that compete for each ambiguous link between a trusted scan and one that is not."""
    poses = trusted(document)
    stations = {station["name"]: station for station in document["stations"]}
    groups: list[list[Candidate]] = []
    for link in document["links"]:
        if link["verdict"] != "ambiguous" or link["transform"] is None or len(groups) == _MOST_AMBIGUOUS:
            continue
        motions = [np.array(motion) for motion in (link["transform"], *link.get("alternatives", ()))]
        fixed, loose = link["to"], link["from"]
        if fixed not in poses:
            fixed, loose = loose, fixed
            motions = [np.linalg.inv(motion) for motion in motions]
        if fixed not in poses or loose in poses or fixed not in slabs or loose not in samples:
            continue
        found = [poses[fixed] @ motion for motion in motions[:_MOST_CANDIDATES]]
        clouds = [cut(pose, samples[loose], level) for pose in found]
        frame = frame_around([slabs[fixed], *clouds], [], 400.0, 1.0)
        group = []
        for index, (pose, cloud) in enumerate(zip(found, clouds, strict=True)):
            image = paint(frame, [(slabs[fixed], _GREY), (cloud, colour)], 560)
            origin = np.array(stations[loose].get("scanner_origin") or (0.0, 0.0, 0.0))
            x, y = frame.at(moved(pose, origin[None])[0])
            heading = float(np.degrees(np.arctan2(pose[1, 0], pose[0, 0]))) % 360.0
            uri = as_uri(as_png(image, 16))
            group.append(Candidate(loose, fixed, chr(65 + index), uri, 400.0, frame.height, x, y, heading))
        groups.append(group)
    return groups
