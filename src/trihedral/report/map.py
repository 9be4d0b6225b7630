"""The map and the section of the report, as shapes and pixels that the page's template places."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.report.axes import Axes, Colour, as_png, as_uri, axes_around, paint, round_down
from trihedral.report.section import Clouds, moved

_WIDTH = 1000.0  # units of every wide drawing
GREY: Colour = (176, 182, 190)
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
    #: Half axes, drawing units, exaggerated.
    ellipse: tuple[float, float] | None


@dataclass(frozen=True)
class Line:
    """A link on the map."""

    x1: float
    y1: float
    x2: float
    y2: float
    #: "accepted", "over" (accepted, out of tolerance), "ambiguous", "doubtful", "refused".
    kind: str
    title: str
    #: Shown on the map; empty for most.
    label: str
    label_x: float
    label_y: float


@dataclass(frozen=True)
class Drawing:
    """A window with its background picture, grid, stations and links."""

    axes: Axes
    #: Data URI.
    picture: str
    #: Metres between grid lines.
    step: float
    #: Position in units, metres.
    columns: list[tuple[float, float]]
    rows: list[tuple[float, float]]
    marks: list[Mark]
    lines: Sequence[Line] = ()
    exaggeration: float | None = None
    #: Refused links left out.
    hidden: int = 0

    @property
    def size(self) -> float:
        """Scale of the marks: less than 1 where many stations have to share the map."""
        return min(1.0, math.sqrt(40.0 / max(1, len(self.marks))))


def scanner_place(station: Mapping[str, Any]) -> Float64:
    """Where the scanner stood in the project, (3,) metres."""
    origin = np.array(station.get("scanner_origin") or (0.0, 0.0, 0.0))
    place: Float64 = moved(np.array(station["pose"]), origin[None])[0]
    return place


def hexadecimal(colour: Colour) -> str:
    """Colour as CSS writes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _drawing(axes: Axes, picture: str, marks: list[Mark]) -> Drawing:
    step, columns, rows = axes.ticks()
    return Drawing(
        axes,
        picture,
        step,
        [(axes.at((x, 0.0))[0], x) for x in columns],
        [(axes.at((0.0, y))[1], y) for y in rows],
        marks,
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
    margin = max(4.0, 0.35 * float(np.ptp(around, axis=0).max()))
    data = axes_around(slabs.values(), around, _WIDTH, 10.0)
    low = np.maximum(around.min(axis=0) - margin, (data.left, data.bottom))
    high = np.minimum(around.max(axis=0) + margin, (data.right, data.top))
    axes = axes_around([], [low, high], _WIDTH, 0.8)
    sigmas = [max(s["sigma_translation_m"][:2]) for s in shown if s.get("sigma_translation_m")]
    exaggeration = None
    if sigmas and max(sigmas) > 0.0:
        share = 0.055 * min(1.0, math.sqrt(40.0 / len(sigmas)))
        largest = share * (axes.right - axes.left) / (_95_IN_PLANE * max(sigmas))
        exaggeration = min(max(1.0, round_down(largest)), _MOST_EXAGGERATED)
    numbers = {s["name"]: index for index, s in enumerate(document["stations"], start=1)}
    marks = []
    for station in shown:
        x, y = axes.at(places[station["name"]])
        sigma, ellipse = station.get("sigma_translation_m"), None
        if sigma and exaggeration:
            factor = _95_IN_PLANE * exaggeration * axes.scale
            ellipse = (factor * sigma[0], factor * sigma[1])
        name = station["name"]
        colour = hexadecimal(colours.get(name, GREY))
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
        start, end = axes.at(places[ends[0]]), axes.at(places[ends[1]])
        lines.append(Line(*start, *end, kind, title.rstrip(", "), label, *_clear_of(start, end, marks)))
    order = ("refused", "doubtful", "ambiguous", "accepted", "over")
    lines.sort(key=lambda line: order.index(line.kind))
    picture = as_uri(as_png(paint(axes, [(slab, GREY) for slab in slabs.values()], 1200), 16))
    drawing = _drawing(axes, picture, marks)
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
    axes = axes_around(slabs.values(), places.values(), _WIDTH, 1.0)
    picture = as_uri(as_png(paint(axes, [(slabs[name], colours[name]) for name in sorted(slabs)], 1800)))
    marks = [
        Mark(*axes.at(places[s["name"]]), n, s["name"], s["status"], hexadecimal(colours[s["name"]]), None)
        for n, s in shown
    ]
    return _drawing(axes, picture, marks)
