"""Figures of what a whole job believes: five scans of rooms that are copies of each other, from its result alone."""

import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import trihedral
from trihedral.simulate import ScannerOptions, make_site, write_site

Float64 = NDArray[np.float64]
COLOURS = {"accepted": "#1b7837", "ambiguous": "#e08214", "doubtful": "#8073ac", "refused": "#b2182b"}
# A pose within this of the truth is right (m).
RIGHT = 0.01


@cache
def job() -> tuple[dict[str, Any], dict[str, Float64], dict[str, NDArray[np.floating[Any]]]]:
    """Its result as registration.json has it, the true poses, and the sampled surface of each scan."""
    with tempfile.TemporaryDirectory() as name:
        scans = Path(name) / "scans"
        for _ in write_site(make_site("rooms", 2, 5, ScannerOptions().with_beams(360_000)), scans):
            pass
        result = trihedral.register([scans], Path(name) / "out")
        truth = json.loads((scans / "truth.json").read_text())["stations"]
        surfaces = {name: np.array(result.surfaces[name]) for name in result.stations}
    true_poses = {one["name"]: np.array(one["project_from_station"]) for one in truth}
    return dict(result.document), true_poses, surfaces


def verdict() -> Figure:
    """What speaks for and against the best pose of every pair, whether it is right, and what was decided."""
    document, truth, _ = job()
    figure, axes = plt.subplots(figsize=(6.0, 3.4))
    for verdict, colour in COLOURS.items():
        links = [
            k for k in document["links"] if k["verdict"] == verdict and k["evidence"].get("held_area_m2")
        ]
        for right, marker in ((True, "o"), (False, "X")):
            some = [k for k in links if _right(k, truth) is right]
            axes.scatter(
                [k["evidence"]["held_area_m2"] for k in some],
                [100 * k["evidence"]["probability"] for k in some],
                c=colour,
                marker=marker,
                s=50,
                label=f"{verdict}, {'right' if right else 'wrong'}" if some else None,
            )
    axes.set(xlabel="square metres that hold the pose", ylabel="probability, %")
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def network() -> Figure:
    """Stations and links of the job in plan, over what the scans saw."""
    document, _, surfaces = job()
    poses = {one["name"]: np.array(one["pose"]) for one in document["stations"] if one["pose"] is not None}
    main = {one["name"] for one in document["stations"] if one["component"] == 0}
    figure, axes = plt.subplots(figsize=(7.5, 2.8))
    for name in sorted(main):
        points = surfaces[name] @ poses[name][:3, :3].T + poses[name][:3, 3]
        level = np.abs(points[:, 2] - poses[name][2, 3]) < 0.5
        axes.plot(*points[level, 1::-1].T, ",", color="#999999")
    for verdict, colour in COLOURS.items():
        for link in document["links"]:
            if link["verdict"] == verdict and {link["from"], link["to"]} <= main:
                ends = np.array([poses[link["from"]][1::-1, 3], poses[link["to"]][1::-1, 3]])
                axes.plot(*ends.T, color=colour, lw=1.5, ls="-" if verdict == "accepted" else ":")
        axes.plot([], [], color=colour, ls="-" if verdict == "accepted" else ":", label=verdict)
    for name in sorted(main):
        axes.plot(*poses[name][1::-1, 3], "^", color="black")
        axes.annotate(name, poses[name][1::-1, 3], textcoords="offset points", xytext=(-8, 8))
    axes.set_aspect("equal")
    axes.set(xlabel="y, m", ylabel="x, m")
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _right(link: dict[str, Any], truth: dict[str, Float64]) -> bool:
    true = np.linalg.solve(truth[link["to"]], truth[link["from"]])
    return bool(np.linalg.norm(np.array(link["transform"])[:3, 3] - true[:3, 3]) < RIGHT)
