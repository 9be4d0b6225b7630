"""`trihedral demo`: a site made here, registered, and compared with its truth."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trihedral.cli import bug
from trihedral.cli.options import NoProgress
from trihedral.cli.terminal import show

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from trihedral.api import Result


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the scans and the result.")] = Path(
        "demo-out"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Which site is made.")] = 4,
    quiet: NoProgress = False,
) -> int:
    """Simulate a small site, register it, and show how close the result is to the truth.

    Leaves the scans in OUT/scans, and registration.json, poses.csv, report.html and picture.png in OUT.
    """
    bug.folder = out

    from trihedral import api
    from trihedral.cli.watch import watching
    from trihedral.output_folder import OutputFolder
    from trihedral.report.overview import write_overview
    from trihedral.report.summary import summary
    from trihedral.simulate.demo import DEMO_STATIONS, demo_site

    with watching(quiet=quiet, as_json=False) as progress:
        progress.phase("Simulating a site", DEMO_STATIONS, "scans", DEMO_STATIONS, "")
        truth = demo_site(out / "scans", seed, lambda name: progress.advance(name, 1.0))
        result = api.register(out / "scans", out, progress=progress)
        with OutputFolder(out) as folder, folder.replacing("picture.png") as picture:
            write_overview(picture, result.document, result.surfaces)
    show(*summary(result.document).split("\n"))
    show(*deviations(result, true_poses(truth)).split("\n"))
    show("", f"Open {out / 'report.html'} in a browser.")
    return result.exit_code


def true_poses(truth: Path) -> dict[str, "NDArray[np.float64]"]:
    """project_from_station of each simulated station, by name."""
    import json

    import numpy as np

    stations = json.loads(truth.read_text("utf-8"))["stations"]
    return {station["name"]: np.array(station["project_from_station"]) for station in stations}


def deviations(result: "Result", truth: "Mapping[str, NDArray[np.float64]]") -> str:
    """Say how far each placed station is from where it truly stood, worst first.

    The truth is in a frame of its own, so both are looked at from the first station that is placed.
    """
    import numpy as np
    from scipy.spatial.transform import Rotation

    placed = {n: s.pose for n, s in result.stations.items() if s.pose is not None and s.component == 0}
    lines = []
    if placed:
        base = next(iter(placed))
        found = np.array([np.linalg.solve(placed[base], pose) for pose in placed.values()])
        true = np.array([np.linalg.solve(truth[base], truth[name]) for name in placed])
        off = np.linalg.solve(true, found)
        millimetres = np.linalg.norm(off[:, :3, 3], axis=1) * 1e3
        degrees = np.degrees(Rotation.from_matrix(off[:, :3, :3]).magnitude())
        lines.append(f"\ndeviation from the truth, seen from {base}, worst first")
        lines += [
            f"  {name:<12} {mm:7.2f} mm {deg:9.4f} deg"
            for mm, deg, name in sorted(zip(millimetres, degrees, placed, strict=True), reverse=True)
            if name != base
        ]
    lines += [
        f"  {name:<12} {'not placed' if station.pose is None else 'placed apart from these'}"
        for name, station in result.stations.items()
        if name not in placed
    ]
    return "\n".join(lines)
