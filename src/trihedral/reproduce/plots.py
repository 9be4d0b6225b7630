"""Fig. 5 of the paper from our trials, and the plan of stations, as SVG."""

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from trihedral.initial.visual.scan_features import picture_features
from trihedral.report.axes import STATION_COLOURS, as_png, as_uri, axes_around, paint
from trihedral.report.map import hexadecimal
from trihedral.report.section import moved
from trihedral.reproduce.experiment import TestbedRun, Trial, paper_tables

_WIDTH, _HEIGHT = 760.0, 430.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 70.0, 20.0, 56.0, 56.0
# Way, words, colour, shape.
_SERIES = (
    ("coarse-icp", "ICP", STATION_COLOURS[1]),
    ("coarse-planes", "plane matching", STATION_COLOURS[0]),
    ("auto", "--method auto", STATION_COLOURS[2]),
)


def figure_5(trials: Sequence[Trial], against: str) -> str:
    """RMSE against "overlap" or "distance": every trial of ours as a dot, the paper's figures as rings."""
    ours = [t for t in trials if t.testbed == "testbed1"]
    paper = paper_tables()["table2"]
    across = [100 * t.overlap if against == "overlap" else t.distance_m for t in ours]
    theirs = [100 * row["overlap"] if against == "overlap" else row["distance_m"] for row in paper]
    low, high = _limits([*across, *theirs])
    shapes = []
    for decade in (0.01, 0.1, 1.0, 10.0):
        y = _up(decade)
        shapes.append(
            f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ccd2da"/>'
        )
        shapes.append(f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{decade:g} m</text>')
    for tick in np.arange(math.ceil(low / 10) * 10, high + 1e-9, 10):
        x = _along(float(tick), low, high)
        unit = " %" if against == "overlap" else " m"
        shapes.append(
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{_TOP}" y2="{_HEIGHT - _BOTTOM}" stroke="#e6eaef"/>'
            f'<text x="{x:.1f}" y="{_HEIGHT - _BOTTOM + 18}" text-anchor="middle">{tick:g}{unit}</text>'
        )
    for key, colour in (("icp_rmse_m", _SERIES[0][2]), ("plane_matching_rmse_m", _SERIES[1][2])):
        for value, row in zip(theirs, paper, strict=True):
            shapes.append(
                f'<circle cx="{_along(value, low, high):.1f}" cy="{_up(row[key]):.1f}" r="6" fill="none" '
                f'stroke="{hexadecimal(colour)}" stroke-width="1.6"><title>paper, {row["pair"]}</title></circle>'
            )
    for way, words, colour in _SERIES:
        for value, trial in zip(across, ours, strict=True):
            rmse = trial.found.get(way, {}).get("final_rmse_m")
            if rmse is not None:
                name = "-".join(str(n) for n in trial.pair)
                shapes.append(
                    f'<circle cx="{_along(value, low, high):.1f}" cy="{_up(rmse):.1f}" r="3.6" '
                    f'fill="{hexadecimal(colour)}" fill-opacity="0.8">'
                    f"<title>{escape(words)}, {name}, seed {trial.seed}: {rmse:.3f} m</title></circle>"
                )
    x = _LEFT
    for _, words, colour in _SERIES:
        ink = hexadecimal(colour)
        shapes.append(
            f'<circle cx="{x + 6}" cy="36" r="4" fill="{ink}"/><text x="{x + 16}" y="40">{escape(words)}</text>'
        )
        x += 130
    shapes.append(
        f'<circle cx="{x + 6}" cy="36" r="6" fill="none" stroke="#5b6470" stroke-width="1.6"/>'
        f'<text x="{x + 18}" y="40">the paper&#8217;s</text>'
    )
    what = "overlap of the reference scan" if against == "overlap" else "distance between the stations"
    title = f"RMSE against {what}"
    shapes.append(f'<text x="{_LEFT}" y="20" font-weight="700" font-size="15">{title}</text>')
    return _svg(_WIDTH, _HEIGHT, shapes, title)


def station_plan(run: TestbedRun) -> str:
    """The testbed's cloud from above under its true poses, each scan in its colour, stations circled."""
    numbers = sorted(run.poses)
    clouds = {k: moved(run.poses[k], picture_features(run.scans[k]).points) for k in numbers}
    places = [run.poses[k][:3, 3] for k in numbers]
    reach = 25.0
    middle = np.mean(places, axis=0)
    near = {k: c[np.linalg.norm(c[:, :2] - middle[:2], axis=1) < reach + 25.0] for k, c in clouds.items()}
    axes = axes_around(near.values(), places, 900.0, 0.8)
    colours = {k: STATION_COLOURS[n % len(STATION_COLOURS)] for n, k in enumerate(numbers)}
    picture = as_uri(as_png(paint(axes, [(near[k], colours[k]) for k in numbers], 1100)))
    shapes = [f'<image href="{picture}" x="0" y="0" width="{axes.width}" height="{axes.height:.1f}"/>']
    for k in numbers:
        x, y = axes.at(run.poses[k][:3, 3])
        shapes.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="15" fill="#ffffffcc" stroke="{hexadecimal(colours[k])}" '
            f'stroke-width="4"/><text x="{x:.1f}" y="{y + 5:.1f}" text-anchor="middle" font-weight="700">#{k}</text>'
        )
    return _svg(axes.width, axes.height, shapes, f"{run.name}, seed {run.seed}: stations from above")


def _limits(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    margin = 0.05 * max(high - low, 1.0)
    return low - margin, high + margin


def _along(value: float, low: float, high: float) -> float:
    return _LEFT + (value - low) / (high - low) * (_WIDTH - _LEFT - _RIGHT)


def _up(rmse: float) -> float:
    """A logarithmic scale from 3 mm to 40 m."""
    share = (math.log10(min(max(rmse, 0.003), 40.0)) - math.log10(0.003)) / math.log10(40.0 / 0.003)
    return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)


def _svg(width: float, height: float, shapes: Sequence[str], title: str) -> str:
    body = "\n".join(shapes)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'font-family="sans-serif" font-size="12" fill="#1b2430" role="img" aria-label="{escape(title)}">\n'
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>\n{body}\n</svg>\n'
    )
