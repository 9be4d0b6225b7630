"""The constraints file: what it says is understood, what makes no sense is refused with its place."""

import json

import numpy as np
import pytest

from trihedral.errors import InputError, OptionError
from trihedral.job.inputs import find_files
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.constraints.file import find_constraints, read_constraints
from trihedral.network.constraints.names import resolved
from trihedral.pipeline import Options

POSE = "[[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]"

FULL = f"""
crs = "EPSG:25832"
coordinates = "new"

[level]
sigma_arcsec = 180

[fixed]
station = "a"
pose = {POSE}

[[forced]]
from = "a"
to = "b"

[[forbidden]]
from = "a"
to = "c"

[[locked]]
from = "b"
to = "c"
transform = {POSE}
sigma_mm = 2

[control]
units = "mm"
points = "control.csv"
sigma_mm = 3

[[control.point]]
name = "P9"
xyz = [1000, 2000, 3000]
check = true

[[control.measurement]]
scan = "a"
point = "P9"
xyz = [1, 2, 3]
sigma_mm = [1, 1, 2]
"""


@pytest.fixture
def write(tmp_path):
    (tmp_path / "control.csv").write_text(
        "# made by hand\nname,x,y,z,check\nP1,1000,0,500,no\nP2,0,1000,0,yes\n"
    )

    def write(text):
        path = tmp_path / "trihedral.toml"
        path.write_text(text)
        return path

    return write


def test_everything_is_read_in_metres_and_radians(write):
    found = read_constraints(write(FULL))
    assert found.crs == "EPSG:25832" and found.coordinates == "new"
    assert found.level.sigma == pytest.approx(180 / 3600 * np.pi / 180) and found.level.stations is None
    assert found.fixed[0].station == "a" and found.fixed[0].pose[0] == (0, -1, 0, 5)
    assert [(p.from_station, p.to_station) for p in found.forced + found.forbidden] == [
        ("a", "b"),
        ("a", "c"),
    ]
    assert found.locked[0].sigma_translation == 0.002
    points = {point.name: point for point in found.control.points}
    assert points["P1"].place == (1.0, 0.0, 0.5) and not points["P1"].check and points["P2"].check
    assert points["P9"].place == (1.0, 2.0, 3.0) and points["P9"].sigma == (0.003,) * 3
    # What a scan shows is in the scan's unit, whatever the control is in.
    assert found.control.measurements[0].place == (1.0, 2.0, 3.0)
    assert found.control.measurements[0].sigma == (0.001, 0.001, 0.002)


@pytest.mark.parametrize(
    ("old", "new", "place", "said"),
    [
        ('crs = "EPSG:25832"', 'csr = "EPSG:25832"', "csr", "Is it crs"),
        ("sigma_arcsec = 180", "sigma_arsec = 180", "level.sigma_arcsec", "missing"),
        ("sigma_arcsec = 180", "sigma_arcsec = 180\nsigma = 2", "level.sigma", "means nothing"),
        ("sigma_arcsec = 180", "sigma_arcsec = -1", "level.sigma_arcsec", "above 0"),
        ('coordinates = "new"', 'coordinates = "old"', "coordinates", "auto, keep, new"),
        ("[1, 0, 0, 6]", "[1, 1, 0, 6]", "fixed.pose", "not a rotation"),
        ('to = "c"\n\n', 'to = "b"\n\n', "forbidden[1]", "forced too"),
        ('from = "a"\nto = "b"', 'from = "a"', "forced[1].to", "missing"),
        ('units = "mm"', 'units = "yd"', "control.units", "one of m, cm, mm, ft"),
        ("xyz = [1, 2, 3]", "xyz = [1, 2]", "control.measurement[1].xyz", "three numbers"),
        ('point = "P9"', 'point = "P8"', "control.measurements", "Points are P1"),
        ('name = "P9"', 'name = "P1"', "control", "twice"),
        ("control.csv", "contrl.csv", "contrl.csv", "no such file"),
        ("[level]", "[level", "trihedral.toml", "no valid TOML"),
    ],
)
def test_nonsense_is_refused_with_its_place(write, old, new, place, said):
    assert old in FULL
    with pytest.raises(InputError) as error:
        read_constraints(write(FULL.replace(old, new)))
    assert place in str(error.value) and said in str(error.value)


def test_lines_of_a_control_file_are_named(write, tmp_path):
    (tmp_path / "control.csv").write_text("P1,1000,0,500\nP2,0,1,5 m,2\n")
    with pytest.raises(InputError, match=r"control.csv, line 2: .*numbers"):
        read_constraints(write(FULL))


def test_poses_come_from_an_adjusted_project(write, tmp_path):
    stations = [
        {"name": "a", "component": 0, "pose": np.eye(4).tolist()},
        {"name": "b", "component": 1, "pose": np.eye(4).tolist()},
        {"name": "c", "component": None, "pose": None},
    ]
    (tmp_path / "old.json").write_text(json.dumps({"stations": stations}))
    found = read_constraints(write('[fixed]\nfrom = "old.json"'))
    assert [fixed.station for fixed in found.fixed] == ["a"]
    # A scan of the old project that is not in this job is no error; one that was asked for is.
    assert resolved(found, {"z": []}).fixed == ()
    with pytest.raises(InputError, match="places no scan 'b'"):
        read_constraints(write('[fixed]\nfrom = "old.json"\nstations = ["b"]'))


def test_scans_may_be_called_by_their_files_and_unknown_ones_are_named(write):
    found = read_constraints(write('[[forced]]\nfrom = "hall.e57"\nto = "roof"'))
    names = resolved(found, {"hall": ["hall.e57"], "roof": ["roof.e57"]}).forced[0]
    assert (names.from_station, names.to_station) == ("hall", "roof")
    with pytest.raises(InputError, match=r"forced\[1\].to: no scan is called 'roof'. Is it roof-1"):
        resolved(found, {"hall": ["hall.e57"], "roof-1": []})
    with pytest.raises(InputError, match="several"):
        resolved(found, {"h1": ["hall.e57"], "h2": ["hall.e57"], "roof": []})


def test_it_is_found_beside_the_scans_and_two_are_too_many(write, tmp_path):
    path = write("")
    assert find_constraints([tmp_path]) == path
    assert find_constraints([tmp_path / "a.e57"]) == path
    assert find_constraints([tmp_path / "elsewhere" / "a.e57"]) is None
    (tmp_path / "constraints.toml").write_text("")
    with pytest.raises(InputError, match="--constraints"):
        find_constraints([tmp_path])


def test_its_control_points_are_not_taken_for_a_scan(write, tmp_path):
    (tmp_path / "control.csv").write_text(
        "101,1000.5,0.25,500.125,2\n102,1001.5,0.25,500.125,2\n103,1,2,3,2\n"
    )
    path = write(
        '[control]\npoints = "control.csv"\n[[control.measurement]]\nscan="a"\npoint="101"\nxyz=[1,2,3]'
    )
    (tmp_path / "a.xyz").write_text("1 2 3\n4 5 6\n7 8 10\n")
    assert len(find_files([tmp_path])[0]) == 2, "by its content it might be one"
    found, failures = find_files([tmp_path], read_constraints(path).files)
    assert [file.path.name for file in found] == ["a.xyz"] and failures == []


def test_the_paper_takes_no_constraints():
    with pytest.raises(OptionError, match="no constraints"):
        Options(method="paper", constraints=Constraints(crs="EPSG:25832"))
