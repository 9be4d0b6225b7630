"""Each stage timed beside the nearest library that does the same, in one run.

    python -m benchmarks.stages

Every measurement is a process of its own, so that peaks of memory are its own. Rounds go over all steps in turn, so
that other work on the machine falls on all of them; the least of the rounds counts.
"""

import argparse
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.table import RESULTS, WORK, machine, markdown

ROOT = Path(__file__).parents[1]
INPUTS = WORK / "stages"
COMMAND = Path(sys.executable).with_name("trihedral")
BARE = ROOT / "target" / "release" / "examples" / "e57_bare"
BEAMS = 5_000_000
TEXT_POINTS = 1_000_000

Work = Callable[[], Any]  # what is timed; what it gives back is put into the notes


@dataclass(frozen=True)
class Step:
    """One line of a table."""

    group: str
    name: str
    make: Callable[[], Work] | None  # sets up outside the time; None for a command that is run as it is
    needs: str = ""  # the module of a peer
    points: int = 0  # that it goes through, where a rate means something
    command: Callable[[], list[str]] | None = None


@dataclass(frozen=True)
class Measured:
    """The best of the rounds."""

    wall: float
    cpu: float  # seconds of all threads
    peak_mb: float
    notes: str


def _scans() -> list[Path]:
    return sorted((INPUTS / "scans").glob("*.e57"))


def _read(path: Path) -> Any:
    from trihedral.io import ReadOptions, read_headers, read_scan

    return read_scan(read_headers(path, ReadOptions())[0], ReadOptions())


def _points(count: int) -> str:
    return f"{count / 1e6:.2f} M points"


def _our_reading(path: Callable[[], Path]) -> Callable[[], Work]:
    def make() -> Work:
        import trihedral.io.xyz  # noqa: F401

        return lambda: _points(len(_read(path())))

    return make


def _our_reading_and_preparing() -> Work:
    import trihedral.io.e57  # noqa: F401
    from trihedral.scan.preparation import prepare

    return lambda: f"{len(prepare(_read(_scans()[0])).surfels)} surfels"


def _our_preparing() -> Work:
    from trihedral.scan.preparation import prepare

    scan = _read(_scans()[0])

    def work() -> str:
        prepared = prepare(scan)
        return f"{len(prepared.surfels)} surfels of {prepared.surfels.spacing:g} m, {len(prepared.patches)} patches"

    return work


def _open3d_preparing() -> Work:
    import open3d

    cloud = open3d.geometry.PointCloud(_doubles(_read(_scans()[0]).xyz))
    search = open3d.geometry.KDTreeSearchParamKNN(20)
    spacing = _prepared()[0].surfels.spacing

    def work() -> str:
        down = cloud.voxel_down_sample(spacing)
        down.estimate_normals(search)
        down.orient_normals_towards_camera_location()
        return f"{len(down.points)} points of {spacing:g} m, normals of 20 neighbours"

    return work


def _gicp_preparing() -> Work:
    import small_gicp

    points = _read(_scans()[0]).xyz.astype("float64")
    spacing = _prepared()[0].surfels.spacing

    def work() -> str:
        cloud, _ = small_gicp.preprocess_points(points, spacing, 20, os.cpu_count())
        return f"{cloud.size()} points of {spacing:g} m, covariances of 20 neighbours"

    return work


def _doubles(points: Any) -> Any:
    import open3d

    return open3d.utility.Vector3dVector(points.astype("float64"))


def _prepared() -> tuple[Any, Any]:
    """Both scans, prepared; kept between processes."""
    from trihedral.scan.prepared import Prepared

    first, second = (Prepared.load(INPUTS / f"{k}.npz") for k in range(2))
    return first, second


def _truth() -> Any:
    """Pose of the first scan in the frame of the second; scanners are at their stations' origins."""
    import numpy as np

    stations = json.loads((INPUTS / "scans" / "truth.json").read_text())["stations"]
    poses = {s["file"]: np.array(s["project_from_station"]) for s in stations}
    first, second = (poses[path.name] for path in _scans())
    return np.linalg.inv(second) @ first


def _start() -> Any:
    """The truth, off by 0.1 m and one degree."""
    import numpy as np

    turned = np.eye(4)
    angle = np.radians(1.0)
    turned[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    turned[:3, 3] = (0.08, -0.06, 0.0)
    return turned @ _truth()


def _error(pose: Any) -> str:
    import math

    import numpy as np

    true = _truth()
    turn = true[:3, :3].T @ pose[:3, :3]
    angle = math.atan2(np.linalg.norm(turn - turn.T) / np.sqrt(8), (np.trace(turn) - 1) / 2)
    millimetres = np.linalg.norm(pose[:3, 3] - true[:3, 3]) * 1e3
    return f"{millimetres:.2f} mm, {math.degrees(angle):.4f} deg off the truth"


def _our_refinement() -> Work:
    from trihedral.final.point_to_plane import RefinementOptions, refine

    a, b = _prepared()
    start, options = _start(), RefinementOptions()
    _ = a.surfel_map, b.surfel_map
    return lambda: _error(refine(a, b, start, options).transform)


def _gicp_clouds() -> Any:
    import small_gicp

    for prepared in _prepared():
        points = prepared.surfels.points.astype("float64")
        yield small_gicp.preprocess_points(points, prepared.surfels.spacing / 4, 20, os.cpu_count())


def _gicp_refinement() -> Work:
    import small_gicp

    (a, _), (b, tree) = _gicp_clouds()
    start, threads = _start(), os.cpu_count()

    def work() -> str:
        found = small_gicp.align(
            b, a, tree, start, "GICP", max_correspondence_distance=0.3, num_threads=threads, max_iterations=50
        )
        return _error(found.T_target_source)

    return work


def _open3d_clouds() -> Any:
    import open3d

    for prepared in _prepared():
        cloud = open3d.geometry.PointCloud(_doubles(prepared.surfels.points))
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(20))
        yield cloud


def _open3d_refinement() -> Work:
    import open3d

    a, b = _open3d_clouds()
    start = _start()
    method = open3d.pipelines.registration.TransformationEstimationPointToPlane()

    def work() -> str:
        found = open3d.pipelines.registration.registration_icp(a, b, 0.3, start, method)
        return _error(found.transformation)

    return work


def _our_index() -> Work:
    a, _ = _prepared()

    def work() -> str:
        return f"{len(a.surfel_map)} surfels"

    return work


def _gicp_index() -> Work:
    import small_gicp

    points = _prepared()[0].surfels.points.astype("float64")

    def work() -> str:
        small_gicp.KdTree(points, os.cpu_count())
        return f"{len(points)} points"

    return work


def _our_pair() -> Work:
    from trihedral.pair.auto import AutoOptions, register_pair

    a, b = _prepared()
    options = AutoOptions()

    def work() -> str:
        link = register_pair(a, b, options)
        return f"{link.verdict}, {'no pose' if link.transform is None else _error(link.transform)}"

    return work


def _kiss_pair() -> Work:
    import kiss_matcher
    import small_gicp

    a, b = (prepared.surfels.points for prepared in _prepared())
    (cloud_a, _), (cloud_b, tree) = _gicp_clouds()
    threads = os.cpu_count()

    def work() -> str:
        matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(0.2))
        coarse = matcher.estimate(a, b)
        pose = _start() * 0
        pose[:3, :3], pose[:3, 3], pose[3, 3] = coarse.rotation, coarse.translation, 1.0
        found = small_gicp.align(
            cloud_b, cloud_a, tree, pose, "PLANE_ICP", max_correspondence_distance=0.3, num_threads=threads
        )
        return _error(found.T_target_source)

    return work


def _numpy_text() -> Work:
    import numpy as np

    return lambda: _points(len(np.loadtxt(INPUTS / "points.xyz")))


def _laspy_laz() -> Work:
    import laspy

    def work() -> str:
        return _points(len(laspy.read(INPUTS / "points.laz").xyz))

    return work


def _bare(scans: int) -> Callable[[], list[str]]:
    return lambda: [str(BARE), *(str(path) for path in _scans()[:scans])]


def _job() -> list[str]:
    out = INPUTS / "job"
    shutil.rmtree(out, ignore_errors=True)
    return [str(COMMAND), "register", *(str(path) for path in _scans()), "-o", str(out), "--quiet"]


# The first of each group is what the others are told in.
STEPS = (
    Step("reading", "crate e57, bare iteration", None, points=BEAMS, command=_bare(1)),
    Step("reading", "trihedral, read", _our_reading(lambda: _scans()[0]), points=BEAMS),
    Step("reading", "trihedral, read and prepare", _our_reading_and_preparing, points=BEAMS),
    Step("preparing", "trihedral, prepare", _our_preparing, points=BEAMS),
    Step("preparing", "Open3D, voxels and normals", _open3d_preparing, "open3d", BEAMS),
    Step("preparing", "small_gicp, voxels and covariances", _gicp_preparing, "small_gicp", BEAMS),
    Step("search index", "trihedral, station", _our_index),
    Step("search index", "small_gicp, k-d tree", _gicp_index, "small_gicp"),
    Step("refinement", "trihedral, refine", _our_refinement),
    Step("refinement", "small_gicp, GICP", _gicp_refinement, "small_gicp"),
    Step("refinement", "Open3D, point to plane", _open3d_refinement, "open3d"),
    Step("pair", "trihedral, register_pair", _our_pair),
    Step("pair", "KISS-Matcher, then small_gicp", _kiss_pair, "kiss_matcher"),
    Step("job", "crate e57, bare iteration over both files", None, points=2 * BEAMS, command=_bare(2)),
    Step("job", "trihedral register", None, points=2 * BEAMS, command=_job),
    Step("text", "trihedral, XYZ", _our_reading(lambda: INPUTS / "points.xyz"), points=TEXT_POINTS),
    Step("text", "NumPy, loadtxt", _numpy_text, points=TEXT_POINTS),
    Step("LAZ", "trihedral, LAZ", _our_reading(lambda: INPUTS / "points.laz"), points=TEXT_POINTS),
    Step("LAZ", "laspy, read", _laspy_laz, points=TEXT_POINTS),
)


def make_inputs() -> None:
    """Simulate two scans and prepare them; write the first million points as text and LAZ."""
    import laspy
    import numpy as np

    from trihedral.scan.preparation import prepare

    if not (INPUTS / "scans" / "truth.json").exists():
        INPUTS.mkdir(parents=True, exist_ok=True)
        options = ("--seed", "1", "--stations", "2", "--points", str(BEAMS), "--quiet")
        unfinished = INPUTS / "scans.part"
        subprocess.run([COMMAND, "simulate", "office", *options, "--out", unfinished], check=True)
        unfinished.rename(INPUTS / "scans")
    for k, path in enumerate(_scans()):
        scan = _read(path)
        prepare(scan).save(INPUTS / f"{k}.npz")
        if k == 0 and not (INPUTS / "points.laz").exists():
            points = np.asarray(scan.xyz[:TEXT_POINTS], dtype=np.float64)
            np.savetxt(INPUTS / "points.xyz", points, fmt="%.4f")
            las = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
            las.header.scales = [1e-4] * 3
            las.xyz = points
            las.write(INPUTS / "points.laz")


def _run_here(index: int) -> None:
    """Be the process of one step."""
    make = STEPS[index].make
    assert make is not None
    work = make()
    wall, cpu = time.perf_counter(), time.process_time()
    notes = work()
    result = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu, "notes": notes}
    print(json.dumps(result))


def measure(index: int) -> Measured | str:
    """Run one step in a process of its own; why it failed, if it did."""
    step = STEPS[index]
    in_python = [sys.executable, "-m", "benchmarks.stages", "--step", str(index)]
    command = in_python if step.command is None else step.command()
    began = time.perf_counter()
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT
    )
    assert process.stdout is not None
    said = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        return f"failed with {process.returncode}"
    peak = usage.ru_maxrss / 1024
    if step.command is not None:
        return Measured(wall, usage.ru_utime + usage.ru_stime, peak, said.strip().splitlines()[0])
    result = json.loads(said.splitlines()[-1])
    return Measured(result["wall"], result["cpu"], peak, result["notes"])


def best(rounds: list[Measured | str]) -> Measured | str:
    """The least of each figure over the rounds; a failure if one failed."""
    good = [one for one in rounds if isinstance(one, Measured)]
    if len(good) < len(rounds):
        return next(one for one in rounds if isinstance(one, str))
    return Measured(
        min(one.wall for one in good),
        min(one.cpu for one in good),
        max(one.peak_mb for one in good),
        good[0].notes,
    )


def table(found: dict[int, Measured | str]) -> str:
    """All groups; ratios are to the first line of the group."""
    rows = []
    for index, step in enumerate(STEPS):
        one = found[index]
        if isinstance(one, str):
            rows.append([step.group, step.name, *["-"] * 6, one])
            continue
        base = found[next(k for k, other in enumerate(STEPS) if other.group == step.group)]
        ratios = ["-", "-"]
        if isinstance(base, Measured):
            ratios = [f"{one.wall / base.wall:.2f}", f"{one.cpu / max(base.cpu, 1e-9):.2f}"]
        times = [f"{one.wall:.3f}", f"{one.cpu:.3f}"]
        rate = f"{step.points / one.wall / 1e6:.1f}" if step.points else "-"
        rows.append([step.group, step.name, *times, *ratios, rate, f"{one.peak_mb:.0f}", one.notes])
    return markdown(
        [
            "stage",
            "who",
            "wall s",
            "CPU s",
            "wall, ratio",
            "CPU, ratio",
            "M points/s",
            "peak MB",
            "what came out",
        ],
        rows,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=RESULTS / "stages.md")
    parser.add_argument("--step", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--make-inputs", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step is not None:
        _run_here(options.step)
        return 0
    if options.make_inputs:
        make_inputs()
        return 0

    stated = machine()
    # A process's peak counts what its parent held when it began: this one stays small.
    subprocess.run([sys.executable, "-m", "benchmarks.stages", "--make-inputs"], check=True, cwd=ROOT)
    build = ["cargo", "build", "--release", "--quiet", "-p", "trihedral-core", "--example", "e57_bare"]
    subprocess.run(build, check=True, cwd=ROOT)
    rounds: dict[int, list[Measured | str]] = {k: [] for k in range(len(STEPS))}
    for number in range(options.rounds):
        for index, step in enumerate(STEPS):
            missing = step.needs and importlib.util.find_spec(step.needs) is None
            one = "not installed" if missing else measure(index)
            rounds[index].append(one)
            print(f"round {number + 1}: {step.name}: {one}", flush=True)
    text = table({index: best(found) for index, found in rounds.items()})
    print(text)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(
        "# Stages beside the nearest libraries\n\n"
        f"Written by `make bench`: the least of {options.rounds} rounds, every line in a process of its own. "
        "Ratios are to the first line of a stage. "
        f"Inputs: two simulated office scans of {BEAMS:,} beams, and {TEXT_POINTS:,} points of the first. "
        f"Machine: {stated}.\n\n{text}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
