"""`trihedral simulate`: scans with known truth."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class SceneName(StrEnum):
    """What can be simulated; the same names as `trihedral.simulate.SCENES`, which is slow to import."""

    facade = "facade"
    floors = "floors"
    office = "office"
    site = "site"
    warehouse = "warehouse"


def simulate(
    scene: Annotated[SceneName, typer.Argument(help="What is scanned.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the scans and truth.json.")],
    seed: Annotated[int, typer.Option(min=0, help="Which site: sizes, layout, looks, stations.")] = 1,
    stations: Annotated[int, typer.Option(min=1, help="How many scans.")] = 5,
    points: Annotated[
        int, typer.Option(min=1000, max=50_000_000, help="Beams a scan; some have no return.")
    ] = 2_000_000,
    noise_mm: Annotated[float, typer.Option(min=0.0, help="Range noise, one sigma.")] = 2.0,
    angular_noise_arcsec: Annotated[
        float, typer.Option(min=0.0, help="Noise of the beam's direction, one sigma.")
    ] = 8.0,
    max_range: Annotated[float, typer.Option(min=1.0, help="Metres.")] = 120.0,
    tilt: Annotated[
        float, typer.Option(min=0.0, max=60.0, help="Degrees by which a scan may be off the level.")
    ] = 0.0,
    overlap: Annotated[
        tuple[float, float],
        typer.Option(metavar="LEAST MOST", help="Share of its view that a scan has in common with another."),
    ] = (0.3, 0.7),
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
    json_progress: Annotated[
        bool, typer.Option("--json-progress", help="Progress as JSON, one object a line on standard error.")
    ] = False,
) -> int:
    """Make scans of a site that does not exist, with the true pose of each.

    Writes one E57 file a scan, without poses and with names that tell nothing, and truth.json. The same
    options give the same files. An output folder that this command wrote before is replaced; any other
    must be empty.
    """
    import dataclasses

    from trihedral.cli.watch import watching
    from trihedral.simulate import ScannerOptions, make_site, write_site

    scanner = dataclasses.replace(
        ScannerOptions().with_beams(points),
        range_noise_m=noise_mm / 1000.0,
        angular_noise_arcsec=angular_noise_arcsec,
        max_range_m=max_range,
        tilt_deg=tilt,
    )
    with watching(quiet=quiet, as_json=json_progress) as progress:
        site = make_site(scene.value, seed, stations, scanner, overlap=overlap)
        progress.phase("simulate", stations, "scans", stations * points, "points")
        for scan in write_site(site, out):
            progress.advance(scan.name, points)
    typer.echo(f"{out}: {stations} scans and truth.json")
    return 0
