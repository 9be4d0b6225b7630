import os
import subprocess
import sys

import numpy as np
import pytest

from support.yard import yard
from trihedral.final.planes.segmentation import segment


def test_planes_are_found_largest_first_and_share_no_point() -> None:
    found = segment(yard(4), seed=7)
    sizes = [p.points for p in found]
    assert sizes == sorted(sizes, reverse=True)
    together = np.concatenate([p.inliers for p in found])
    assert len(np.unique(together)) == len(together)
    expected = [
        ([0, 0, 1], 1.6),
        ([1, 0, 0], 0.0),
        ([-np.sin(np.radians(10)), np.cos(np.radians(10)), 0], 0.0),
    ]
    for got, (normal, distance_) in zip(found, expected, strict=False):
        assert abs(got.normal @ normal) > 0.99999
        assert got.distance == pytest.approx(distance_, abs=0.003)


def test_same_seed_same_bits_whatever_the_number_of_threads() -> None:
    script = """
import numpy as np
from trihedral.final.planes.segmentation import segment
rng = np.random.default_rng(1)
points = rng.uniform(-5, 5, (20000, 3)); points[:8000, 2] = rng.normal(scale=0.01, size=8000)
points[8000:12000, 0] = rng.normal(scale=0.01, size=4000)
for plane in segment(points, 3):
    print(plane.normal.tobytes().hex(), plane.distance.hex(), plane.inliers.sum())
"""
    runs = {
        subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "RAYON_NUM_THREADS": str(threads)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in (1, 2, 5)
    }
    assert len(runs) == 1 and runs.pop().count("\n") >= 2
