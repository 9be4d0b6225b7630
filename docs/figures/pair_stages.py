"""Figures of the stages of a pair: two scans of an office floor."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pair import pair, proposals, refined, scores
from trihedral.scan.surfels import Surfels

Float64 = NDArray[np.float64]

# Metres above and below the scanner that a plan shows.
SLAB = 1.0


def preparation() -> Figure:
    """One scan in plan: as it came with what it saw through, and its surfels by patch."""
    scan, prepared = pair().scans[1], pair().prepared[1].surfels
    figure, (above, below) = plt.subplots(2, 1, figsize=(8.0, 6.0), sharex=True, sharey=True)
    points = scan.xyz[np.abs(scan.xyz[:, 2]) < SLAB]
    above.fill(*_free(scan.xyz)[::-1], color="#dbe9f6")
    above.plot(*points[:, 1::-1].T, ",", color="#333333")
    above.set_title(f"{len(scan):,} points, and space seen through")
    shown = _upright(prepared)
    patch = prepared.patch[shown]
    colours = np.where((patch >= 0)[:, None], plt.get_cmap("tab20")(patch % 20), [0.7, 0.7, 0.7, 1.0])
    below.scatter(*prepared.points[shown, 1::-1].T, s=3, c=colours, linewidths=0)
    below.set_title(f"upright ones of {len(prepared.points):,} surfels, by patch")
    for axes in (above, below):
        axes.plot(0, 0, "^", color="black")
        axes.set_aspect("equal")
        axes.set(xlabel="y, m", ylabel="x, m", xlim=(-28, 8), ylim=(-3, 8))
    return figure


def hypotheses() -> Figure:
    """The plan of one scan, and where its proposals put the other scanner."""
    figure, axes = plt.subplots(figsize=(6.0, 4.6))
    poses, truth = proposals(), pair().truth
    plan = pair().prepared[1].surfels
    axes.plot(*plan.points[_upright(plan), :2].T, ",", color="#333333")
    rank = np.arange(len(poses))
    dots = axes.scatter(*poses[::-1, :2, 3].T, c=rank[::-1], s=12, cmap="viridis_r")
    axes.plot(0, 0, "^", color="black", label="the scanner of the plan")
    axes.plot(*truth[:2, 3], "o", mfc="none", mec="red", ms=13, label="where the other one stood")
    figure.colorbar(dots, ax=axes, label="rank of the proposal")
    axes.legend(loc="lower left", frameon=False)
    axes.set_title(f"{len(poses)} proposals")
    _plan(axes)
    return figure


def verification() -> Figure:
    """The score of poses along a line through the true one, at the tolerance of each round."""
    truth = pair().truth
    shifts = np.linspace(-2.0, 2.0, 201)
    poses = np.tile(truth, (len(shifts), 1, 1))
    poses[:, 0, 3] += shifts
    figure, axes = plt.subplots(figsize=(6.0, 3.2))
    for offset, margin, samples in ((0.5, 0.5, 400), (0.3, 0.3, 800), (0.15, 0.2, 1500), (0.05, 0.1, 20_000)):
        axes.plot(shifts, scores(poses, offset, margin, samples), label=f"{offset} m, {samples:,} surfels")
    axes.set(xlabel="metres beside the true pose", ylabel="score")
    axes.legend(frameon=False, title="tolerance")
    return figure


def refinement() -> Figure:
    """How far refined poses are from the truth, against how far they started from it."""
    truth = pair().truth
    random = np.random.default_rng(1)
    starts, ends = [], []
    for size in np.geomspace(0.005, 0.5, 40):
        shift = random.normal(size=3)
        start = truth.copy()
        start[:3, 3] += size * shift / np.linalg.norm(shift)
        starts.append(1e3 * size)
        ends.append(1e3 * _apart(refined(start), truth))
    figure, axes = plt.subplots(figsize=(6.0, 3.2))
    axes.loglog(starts, ends, "o", mfc="none")
    axes.loglog(starts, starts, color="grey", lw=0.8, label="where it started")
    axes.set(xlabel="mm off at the start", ylabel="mm off at the end")
    axes.legend(frameon=False)
    return figure


def _apart(one: Float64, other: Float64) -> float:
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3]))


def _free(xyz: NDArray[np.float32]) -> tuple[Float64, Float64]:
    """Outline of what the scanner saw through: the nearest range within two degrees of the level, a point a degree."""
    ranges = np.linalg.norm(xyz, axis=1)
    level = np.abs(xyz[:, 2]) < np.sin(np.radians(2.0)) * ranges
    column = np.degrees(np.arctan2(xyz[level, 1], xyz[level, 0])).astype(int) % 360
    nearest = np.full(360, np.inf)
    np.minimum.at(nearest, column, ranges[level])
    nearest[~np.isfinite(nearest)] = 0.0
    heading = np.radians(np.arange(360) + 0.5)
    return nearest * np.cos(heading), nearest * np.sin(heading)


def _upright(one: Surfels) -> NDArray[np.bool_]:
    """(N,) surfels of walls about the scanner's height."""
    planar = np.any(one.normals != 0, axis=1)
    upright: NDArray[np.bool_] = (
        planar & (np.abs(one.normals[:, 2]) < 0.3) & (np.abs(one.points[:, 2]) < SLAB)
    )
    return upright


def _plan(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set(xlabel="x, m", ylabel="y, m")
