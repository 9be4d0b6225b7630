"""The jobs of the record: each makes its scans in a folder, or finds them, and says what to register and how."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import trihedral
from trihedral.network.constraints.file import read_constraints
from trihedral.simulate import (
    RigOptions,
    ScannerOptions,
    demo_site,
    make_site,
    make_testbed,
    write_site,
    write_testbed,
)

# Where scans of the constraints' job stand: a national grid, far from zero, turned by the angle of 3, 4 and 5.
GRID_FROM_SITE = np.array(
    [[0.8, -0.6, 0.0, 691_234.0], [0.6, 0.8, 0.0, 5_334_321.0], [0.0, 0.0, 1.0, 512.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True)
class Job:
    """What `trihedral.register` is given, and which files that rests on."""

    inputs: tuple[Path, ...]
    paths: tuple[Path, ...] = ()
    options: trihedral.Options = field(default_factory=trihedral.Options)
    found: bool = False  # the inputs were not made here
    printed: bool = False  # what it gives is recorded to the digits that are printed
    trials: Path | None = None  # a table that was made already, in place of a registration


def demo(folder: Path, shared: Path) -> Job:
    """Take the site of `trihedral demo`."""
    if not (folder / "truth.json").exists():
        demo_site(folder)
    return _scans(folder)


def facade(folder: Path, shared: Path) -> Job:
    """Take the seven real scans of a facade."""
    scans = shared / "data" / "eth-facade"
    return Job(tuple(sorted(scans.glob("*.pcd"))), (scans,), found=True)


def office(folder: Path, shared: Path) -> Job:
    """Make four thin scans of an office, with colour: some links are accepted, some in doubt, some refused."""
    return _site(folder, "office", 2, 4, 100_000, (0.4, 0.8))


def building(folder: Path, shared: Path) -> Job:
    """Make the building of ten stations of `benchmarks.projects`."""
    return _site(folder, "building", 1, 10, 1_000_000, (0.3, 0.7))


def constraints(folder: Path, shared: Path) -> Job:
    """Make four scans of a warehouse, so thin that links are in doubt, and say something of every kind about them."""
    _site(folder, "warehouse", 1, 4, 30_000, (0.3, 0.7))
    stations = json.loads((folder / "truth.json").read_text())["stations"]
    poses = {s["name"]: GRID_FROM_SITE @ np.array(s["project_from_station"]) for s in stations}
    a, b, c, d = sorted(poses)
    (folder / "trihedral.toml").write_text(
        f"""crs = "EPSG:25832"
coordinates = "new"
level = {{sigma_arcsec = 180, stations = ["{a}", "{b}", "{d}"]}}
fixed = {{station = "{b}", pose = {poses[b].tolist()}, sigma_mm = 1, sigma_arcsec = 20}}
forced = {{from = "{d}", to = "{c}"}}
forbidden = {{from = "{b}", to = "{c}"}}

[locked]
from = "{a}"
to = "{b}"
transform = {np.linalg.solve(poses[b], poses[a]).tolist()}
sigma_mm = 2
sigma_arcsec = 30

[control]
points = "control.csv"
measurements = "targets.csv"
sigma_mm = 3
"""
    )
    # Three points about the warehouse, each shown by two scans that err by a few millimetres.
    shown = {"C1": (a, c), "C2": (c, d), "C3": (a, d)}
    places = {"C1": (12.0, 2.0, 1.0), "C2": (18.0, -6.0, 2.5), "C3": (22.0, 9.0, 0.5)}
    points, targets = ["name,x,y,z,check"], ["scan,point,x,y,z,sigma_mm"]
    for number, (point, place) in enumerate(places.items()):
        on_grid = GRID_FROM_SITE @ [*place, 1.0]
        points.append(f"{point},{_numbers(on_grid[:3])},{'yes' if point == 'C3' else 'no'}")
        for scan in shown[point]:
            seen = np.linalg.solve(poses[scan], on_grid)[:3] + 0.001 * np.array([1.0, -1.0, number])
            targets.append(f"{scan},{point},{_numbers(seen)},2")
    (folder / "control.csv").write_text("\n".join(points) + "\n")
    (folder / "targets.csv").write_text("\n".join(targets) + "\n")
    known = read_constraints(folder / "trihedral.toml")
    return replace(_scans(folder), options=trihedral.Options(constraints=known))


def previews(folder: Path, shared: Path) -> Job:
    """Take the demo's site, its pairs chosen by previews as in large jobs."""
    job = demo(folder.with_name("demo"), shared)
    options = trihedral.Options()
    return replace(job, options=replace(options, candidates=replace(options.candidates, all_pairs_up_to=0)))


def paper_icp(folder: Path, shared: Path) -> Job:
    """Make the paper's testbed 3, thin, for its method with ICP at the end."""
    return _paper(folder, "icp")


def paper_planes(folder: Path, shared: Path) -> Job:
    """Make the same for plane matching at the end."""
    return _paper(folder, "planes")


def paper_table(folder: Path, shared: Path) -> Job:
    """Make Table 5 of the paper's experiments: testbed 3 from its pictures and from a coarse start, in every way."""
    arguments = ("--table", 5, "--seed", 1, "--points", 80_000, "--out", folder, "--quiet")
    command = [sys.executable, "-m", "trihedral", "reproduce", *map(str, arguments)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    scans = folder / "testbeds" / "testbed3-1"
    return Job(_files(scans), printed=True, trials=folder / "trials.csv")


JOBS: dict[str, Callable[[Path, Path], Job]] = {
    "demo": demo,
    "facade": facade,
    "office": office,
    "building": building,
    "constraints": constraints,
    "previews": previews,
    "paper-icp": paper_icp,
    "paper-planes": paper_planes,
    "paper-table": paper_table,
}


def _site(
    folder: Path, scene: str, seed: int, stations: int, beams: int, overlap: tuple[float, float]
) -> Job:
    if not (folder / "truth.json").exists():
        for _ in write_site(
            make_site(scene, seed, stations, ScannerOptions().with_beams(beams), overlap=overlap), folder
        ):
            pass
    return _scans(folder)


def _paper(folder: Path, final: str) -> Job:
    # Both ends take the same scans.
    scans = folder.with_name("testbed3")
    if not (scans / "truth.json").exists():
        for _ in write_testbed(
            make_testbed("testbed3", 1, RigOptions(points=40_000, picture_size=(640, 480))), scans
        ):
            pass
    options = trihedral.Options(method="paper")
    options = replace(options, paper=replace(options.paper, final=final))
    return Job(_files(scans), (scans,), options, printed=True)


def _scans(folder: Path) -> Job:
    return Job(_files(folder), (folder,))


def _files(folder: Path) -> tuple[Path, ...]:
    """All but the truth, which no job reads, and hidden ones."""
    return tuple(
        path for path in sorted(folder.iterdir()) if path.name != "truth.json" and path.name[0] != "."
    )


def _numbers(values: np.ndarray) -> str:
    return ",".join(repr(value) for value in values.tolist())
