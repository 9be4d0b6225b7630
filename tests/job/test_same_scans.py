"""A scan that comes twice is used once, and is no evidence for itself."""

import numpy as np
import pytest

import trihedral
from support.stations import in_project, stations
from trihedral.io.e57 import E57Scan, write_e57


@pytest.mark.parametrize(
    "form", ["shuffled without a grid", "in project coordinates", "a third of the points"]
)
def test_a_copy_verifies_nothing(tmp_path, form):
    scans = stations("office", 12, 150_000)
    for scan in scans:
        whole = E57Scan(scan.name, scan.xyz, intensity=scan.intensity, row=scan.row, column=scan.column)
        write_e57(tmp_path / f"{scan.name}.e57", [whole])
    last, rng = scans[1], np.random.default_rng(1)
    order = rng.permutation(len(last))
    points = {
        "shuffled without a grid": last.xyz[order],
        "in project coordinates": np.round(in_project(last, (4e5, 5e6, 300.0)), 3),
        "a third of the points": last.xyz[order[::3]],
    }[form]
    write_e57(tmp_path / "copy.e57", [E57Scan("copy", points)])
    result = trihedral.register(tmp_path)
    assert sorted(result.stations) == sorted(scan.name for scan in scans)
    [failure] = result.failures
    assert failure.path.endswith("copy.e57") and f"the same scan as {last.name}.e57" in failure.reason
    assert result.exit_code == 3
    assert all(station.status != "verified" for station in result.stations.values())
