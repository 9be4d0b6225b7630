"""A testbed as files: a rig's profiles and pictures for each scan, and `truth.json`."""

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict
from itertools import combinations
from pathlib import Path

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.io.rig import write_rig
from trihedral.simulate.covisible import reaches, surface_samples
from trihedral.simulate.files import TRUTH, pair_entry, prepare_folder, station_entry, write_truth, writing
from trihedral.simulate.rig import RigScan
from trihedral.simulate.survey import Survey
from trihedral.simulate.testbed_places import HEAD_M
from trihedral.simulate.tracer import dot


def write_testbed(
    survey: Survey, folder: Path | str, done: Callable[[str], None] = lambda what: None
) -> Iterator[tuple[str, RigScan]]:
    """Write a testbed's scans one by one as rigs with their profiles and pictures, then `truth.json`.

    Each name and scan is yielded once its files are there; folder and order are as for `write_site`. `done` is told
    the name of each line scanner and picture that is done.

    Raises
    ------
    OutputError
        The folder holds something else, or cannot be written.
    """
    folder = Path(folder)
    endings = [".toml", *(f"-{one.name}.npz" for one in survey.rig.scanners)]
    endings += [f"-{number:02d}.jpg" for number in range(survey.options.pictures)]
    prepare_folder(folder, [*(f"{name}{ending}" for name in survey.names for ending in endings), TRUTH])
    stations, samples = [], []
    for k, name in enumerate(survey.names):
        one, path = survey.scan(k, done), folder / f"{name}.toml"
        with writing(path):
            write_rig(path, name, one.profiles, survey.rig.camera, one.pictures)
        stations.append(station_entry(path, one.points, survey.poses[k]))
        samples.append(surface_samples(one.still))
        yield name, one
    made = {
        "testbed": survey.name,
        "scene": survey.scene.name,
        "scene_seed": survey.scene.seed,
        "seed": survey.seed,
        "rig": asdict(survey.options),
    }
    write_truth(folder, made, stations, _pairs(survey, samples))


def _pairs(survey: Survey, samples: list[Float64]) -> list[dict[str, object]]:
    """Distance and overlap of each pair, beside the paper's overlap where it states one."""
    first, names = survey.testbed.first, survey.names
    pairs = []
    for a, b in combinations(range(len(survey)), 2):
        shares = _share(survey, b, samples[a]), _share(survey, a, samples[b])
        entry = pair_entry((names[a], names[b]), shares, distance_m=round(survey.distance(a, b), 3))
        pairs.append(entry | {"paper_overlap": survey.testbed.overlap.get((first + a, first + b))})
    return pairs


def _share(survey: Survey, station: int, points: Float64) -> float:
    """Share of (N, 3) points that a station sees: in range, above the robot, not hidden."""
    if not len(points):
        return 0.0
    pose, options = survey.poses[station], survey.options
    head = pose[:3, 3] + HEAD_M * pose[:3, 2]
    offset = points - head
    above = offset @ pose[:3, 2] > math.sin(math.radians(options.lowest_deg)) * np.sqrt(dot(offset, offset))
    return float((reaches(survey.still, head, points, options.max_range_m) & above).mean())
