"""The horizontal section that shows whether walls coincide."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64

Clouds = Mapping[str, Float64]
Samples = Mapping[str, NDArray[np.floating[Any]]]

_LEVEL_POINTS = 1_500_000  # points that are looked at at once, all stations together


@dataclass(frozen=True)
class SectionLevel:
    """A horizontal slab, project heights in metres."""

    bottom: float
    top: float

    @property
    def middle(self) -> float:
        """Its height."""
        return 0.5 * (self.bottom + self.top)

    def widened(self, thickness: float) -> "SectionLevel":
        """Give the slab of that thickness about the same middle, or this one if it is thicker."""
        half = max(0.5 * thickness, 0.5 * (self.top - self.bottom))
        return SectionLevel(self.middle - half, self.middle + half)


def trusted(document: Mapping[str, Any]) -> dict[str, Float64]:
    """Pose of each station that may be drawn: placed, unambiguous and in the main group."""
    return {
        station["name"]: np.array(station["pose"], dtype=np.float64)
        for station in document["stations"]
        if station["pose"] is not None
        and station["status"] in ("verified", "single-linked")
        and station["component"] in (0, None)
    }


def moved(pose: Float64, points: NDArray[np.floating[Any]]) -> Float64:
    """Points taken through a pose, (N, 3) float64."""
    moved: Float64 = points.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
    return moved


def thinned(poses: Mapping[str, Float64], samples: Samples) -> dict[str, NDArray[np.floating[Any]]]:
    """Take of each station that has points so many that all together are few enough to look over.

    Samples may be read from disk each time they are asked for: this asks once a station.
    """
    share = max(1, _LEVEL_POINTS // max(1, len(poses)))
    taken = {}
    for name in poses:
        points = samples.get(name)
        if points is not None and len(points):
            # A copy: all points of all stations would stay in memory behind a view.
            taken[name] = points[:: -(-len(points) // share)].copy()
    return taken


def choose_level(poses: Mapping[str, Float64], samples: Samples) -> SectionLevel:
    """Find the height at which most vertical surface is cut.

    Poses are project_from_station, samples (N, 3) station coordinates, metres. The slab is 10 cm thick; 20 or 40 cm
    where the points are too far apart to fill walls at 10 cm.
    """
    names = [name for name in poses if name in samples and len(samples[name])]
    if not names:
        return SectionLevel(0.0, 0.1)
    # One station at a time: all of them moved would be the most that a whole job holds in memory.
    bounds = np.array([[np.min(c, axis=0), np.max(c, axis=0)] for c in _clouds(names, poses, samples)])
    lowest, highest = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    level = SectionLevel(0.0, 0.1)
    for size in (0.1, 0.2, 0.4):
        level, columns = _level_at(_clouds(names, poses, samples), lowest, highest, size)
        if columns >= 200:
            break
    return level


def _clouds(names: Sequence[str], poses: Mapping[str, Float64], samples: Samples) -> Iterator[Float64]:
    return (moved(poses[name], samples[name]) for name in names)


def _level_at(
    clouds: Iterable[Float64], lowest: Float64, highest: Float64, size: float
) -> tuple[SectionLevel, int]:
    """Best slab of thickness `size`, and how many vertical columns of cells it cuts; all points within the bounds."""
    _, width, height = (int(count) + 1 for count in np.floor((highest - lowest) / size))
    spread = height + 8  # so that the neighbours of one column never reach into the next
    of_stations = []
    for points in clouds:
        cells = np.floor((points - lowest) / size).astype(np.int64)
        of_stations.append(np.unique((cells[:, 0] * width + cells[:, 1]) * spread + cells[:, 2]))
    filled = np.unique(np.concatenate(of_stations))
    # A column filled from three cells below to three above stands on a vertical surface; a floor fills one.
    near = np.searchsorted(filled, filled + 3, side="right") - np.searchsorted(
        filled, filled - 3, side="left"
    )
    upright = np.bincount((filled % spread)[near >= 6], minlength=height)
    lying = np.bincount((filled % spread)[near < 6], minlength=height)
    # A cut along a table, a duct or a slope shows a stain, not a line; but where nothing stands, nothing is shown.
    most = int(upright.max())
    worth = np.where(2 * upright >= most, upright - lying, -np.inf)
    # Walls are as good to cut anywhere between furniture and ceiling: the middle of the longest good stretch.
    good = np.flatnonzero(worth >= worth.max() - 0.1 * most)
    chosen = max(np.split(good, np.flatnonzero(np.diff(good) > 1) + 1), key=len)
    middle = int(chosen[len(chosen) // 2])
    bottom = float(lowest[2] + middle * size)
    return SectionLevel(bottom, bottom + size), int(upright[middle])


def cut(pose: Float64, points: NDArray[np.floating[Any]], level: SectionLevel) -> Float64:
    """Take the points that lie in the slab once moved through the pose, (M, 3) in project coordinates."""
    height = points @ pose[2, :3] + pose[2, 3]
    return moved(pose, points[(height >= level.bottom) & (height <= level.top)])


def between(points: Float64, level: SectionLevel) -> Float64:
    """Take the points, project coordinates, that lie in the slab."""
    return points[(points[:, 2] >= level.bottom) & (points[:, 2] <= level.top)]
