"""Poses of all sources brought together: each distinct, each source on its switch, none where there is none."""

import sys
from pathlib import Path

import numpy as np
import pytest

from trihedral.errors import OptionError
from trihedral.geometry.motion import distance, inverse
from trihedral.initial.described import described
from trihedral.initial.hypotheses import SOURCES, HypothesisOptions, hypotheses
from trihedral.pipeline import Options, prepare_scan
from trihedral.scan.preparation import prepare

sys.path.append(str(Path(__file__).resolve().parent))
from textured_room import scan_room

ALL = HypothesisOptions(sources=("views", "rectified", "corners", "shape", "plan"))


@pytest.fixture(scope="module")
def pair():
    made = []
    for seed, (position, rotation) in enumerate(
        (((0.8, -0.4, 0.1), (25, 0, 0)), ((-0.6, 0.3, 0.0), (-70, 3, 0)))
    ):
        scan, pose = scan_room(position, rotation, seed=seed)
        made.append((described(prepare(scan), scan, ALL), pose))
    (a, a_pose), (b, b_pose) = made
    return a, b, inverse(b_pose) @ a_pose


def test_every_source_alone_gives_only_its_own_poses(pair):
    a, b, true = pair
    for source in SOURCES:
        found = hypotheses(a, b, HypothesisOptions(sources=(source,)))
        assert {h.source for h in found} <= {source}
        # A plain box has nothing that is not plane but its edges.
        if source != "shape":
            assert min(distance(h.pose, true)[0] for h in found) < 0.6


def test_together_they_give_distinct_poses_and_the_plan_comes_last(pair):
    a, b, _ = pair
    found = hypotheses(a, b, ALL)
    sources = [h.source for h in found]
    assert sources[-1] == "plan" and sources == sorted(sources, key=ALL.sources.index)
    poses = np.array([h.pose for h in found])
    for k in range(0, len(poses), 17):
        for other in poses[:k]:
            off, turned = distance(poses[k], other)
            at_origin = np.linalg.norm(poses[k][:3, 3] - other[:3, 3])
            assert max(off, at_origin) >= 0.0999 or turned >= np.radians(0.99)


def test_a_job_describes_scans_for_the_sources_it_asks_for():
    scan, _ = scan_room((0.8, -0.4, 0.1), (25, 0, 0))
    bare = prepare_scan(scan, Options(hypotheses=HypothesisOptions(sources=("plan",))))
    rich = prepare_scan(scan, Options(hypotheses=HypothesisOptions(sources=("rectified",))))
    assert not len(bare.corner_points) and not len(bare.rectified_points)
    assert len(rich.rectified_points) and not len(rich.view_points)
    sizes = [
        np.asarray(value).nbytes
        for name, value in described(prepare(scan), scan, ALL).arrays().items()
        if name.split("_")[0] in ("view", "rectified", "facet", "corner", "shape")
    ]
    assert sum(sizes) < 3e6


@pytest.mark.parametrize("sources", [(), ("stars",), ("plan", "plan")])
def test_sources_are_known_and_named_once(sources):
    with pytest.raises(OptionError, match="sources"):
        HypothesisOptions(sources=sources)
