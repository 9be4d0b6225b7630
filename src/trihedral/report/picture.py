"""A picture of a job: its scans as they came, and where they belong."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

from trihedral.atomic import write_atomically
from trihedral.report.drawing import scanner_place
from trihedral.report.frame import Colour, Frame, assign_colours, frame_around, paint
from trihedral.report.ranking import used_links
from trihedral.report.section import Array, Samples, choose_level, cut, trusted

_PANEL = 1100  # pixels
_MARGIN = 40
_INK = (40, 40, 46)
_SHRUNK = 2  # painted larger and shrunk, which smooths the dots


def write_picture(path: Path | str, document: Mapping[str, Any], samples: Samples) -> None:
    """Write a PNG with two sections: every scan in its own coordinates, and all of them registered.

    Parameters
    ----------
    path
        The file to write.
    document
        As `to_document` or `read_result` give it.
    samples
        For each station, by name, (N, 3) evenly sampled points in station coordinates, metres.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    poses = {name: pose for name, pose in trusted(document).items() if len(samples.get(name, ()))}
    level = choose_level(poses, samples)
    after = {name: cut(pose, samples[name], level) for name, pose in poses.items()}
    before = {name: _back(pose, after[name]) for name, pose in poses.items()}
    links = used_links(document)
    colours = assign_colours(list(poses), [(link["from"], link["to"]) for link in links])
    stations = {s["name"]: scanner_place(s) for s in document["stations"] if s["name"] in poses}
    origins = {name: _back(poses[name], place[None])[0] for name, place in stations.items()}

    left = _panel(before, origins, colours, [])
    pairs = [(link["from"], link["to"]) for link in links]
    right = _panel(after, stations, colours, pairs)
    height = max(left.height, right.height)
    sheet = Image.new("RGB", (2 * _PANEL + 3 * _MARGIN, height + 3 * _MARGIN), "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(30)
    for k, (panel, text) in enumerate(
        ((left, f"{len(poses)} scans as they came"), (right, "registered by trihedral, no targets"))
    ):
        x = _MARGIN + k * (_PANEL + _MARGIN)
        draw.text((x + _PANEL / 2, _MARGIN), text, fill=_INK, font=font, anchor="mm")
        sheet.paste(panel, (x, 2 * _MARGIN + (height - panel.height) // 2))
    buffer = io.BytesIO()
    sheet.quantize(128, dither=Image.Dither.NONE).save(buffer, "PNG", optimize=True)
    write_atomically(path, buffer.getvalue())


def _back(pose: Array, points: Array) -> Array:
    """Points of the project in station coordinates."""
    own: Array = (points - pose[:3, 3]) @ pose[:3, :3]
    return own


def _panel(
    clouds: Mapping[str, Array],
    stations: Mapping[str, Array],
    colours: Mapping[str, Colour],
    links: list[tuple[str, str]],
) -> Image.Image:
    frame = frame_around(clouds.values(), stations.values(), _PANEL, 1.0)
    layers = [(clouds[name], colours[name]) for name in sorted(clouds)]
    picture = paint(frame, layers, _SHRUNK * _PANEL)
    picture = picture.resize((_PANEL, picture.height // _SHRUNK), Image.Resampling.LANCZOS)
    draw = ImageDraw.Draw(picture)
    places = {name: frame.at(place) for name, place in stations.items()}
    for a, b in links:
        if a in places and b in places:
            draw.line((*places[a], *places[b]), fill=_INK, width=2)
    for name, (x, y) in places.items():
        draw.ellipse((x - 11, y - 11, x + 11, y + 11), fill=colours[name], outline="white", width=3)
    _scale_bar(draw, frame, picture.height)
    return picture


def _scale_bar(draw: ImageDraw.ImageDraw, frame: Frame, height: int) -> None:
    step, _, _ = frame.ticks()
    length = step * frame.scale
    x, y = _PANEL - length - 10, height - 14
    draw.line((x, y, x + length, y), fill=_INK, width=3)
    draw.text((x + length / 2, y - 6), f"{step:g} m", fill=_INK, font=ImageFont.load_default(22), anchor="mb")
