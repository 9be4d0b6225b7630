"""`trihedral simulate`: scans with known truth."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer


class SceneName(StrEnum):
    """What can be simulated; the names of `trihedral.simulate.SCENES` and `TESTBEDS`, which are slow to import."""

    building = "building"
    corridor = "corridor"
    estate = "estate"
    facade = "facade"
    floors = "floors"
    gallery = "gallery"
    hall = "hall"
    office = "office"
    rooms = "rooms"
    site = "site"
    warehouse = "warehouse"
    testbed1 = "testbed1"
    testbed2 = "testbed2"
    testbed3 = "testbed3"


def simulate(
    scene: Annotated[SceneName, typer.Argument(help="What is scanned.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the scans and truth.json.")],
    seed: Annotated[int, typer.Option(min=0, help="Which site: sizes, layout, looks, stations.")] = 1,
    stations: Annotated[
        int | None, typer.Option(min=1, help="How many scans.  [default: 5; a testbed has its own]")
    ] = None,
    points: Annotated[
        int | None,
        typer.Option(
            min=1000,
            max=50_000_000,
            help="Beams a scan; some have no return.  [default: 2,000,000; testbeds 600,000, at most 22,800,000]",
        ),
    ] = None,
    noise_mm: Annotated[
        float | None, typer.Option(min=0.0, help="Range noise, one sigma.  [default: 2; testbeds 8]")
    ] = None,
    angular_noise_arcsec: Annotated[
        float | None,
        typer.Option(min=0.0, help="Noise of the beam's direction, one sigma.  [default: 8; testbeds 36]"),
    ] = None,
    max_range: Annotated[
        float | None, typer.Option(min=1.0, help="Metres.  [default: 120; testbeds 80]")
    ] = None,
    tilt: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=60.0,
            help="Degrees by which a scan may be off the level.  [default: 0; not for testbeds]",
        ),
    ] = None,
    light_changes: Annotated[
        bool,
        typer.Option(
            "--light-changes", help="Each scan has its own sun and lamps, and shadows; not for testbeds."
        ),
    ] = False,
    overlap: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LEAST MOST",
            help="Share of its view that a scan has in common with another.  [default: 0.3 0.7; not for testbeds]",
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
    json_progress: Annotated[
        bool, typer.Option("--json-progress", help="Progress as JSON, one object a line on standard error.")
    ] = False,
) -> int:
    """Make scans of a site that does not exist, with the true pose of each.

    Writes one E57 file a scan, without poses and with names that tell nothing, and truth.json. The testbeds
    are those of Kim, Chen and Cho (2017): a rig's raw profiles and pictures, at the distances that the paper
    states. The same options give the same files. An output folder that this command wrote before is replaced;
    any other must be empty.
    """
    given = {"noise_mm": noise_mm, "angular_noise_arcsec": angular_noise_arcsec, "max_range": max_range}
    if scene.value.startswith("testbed"):
        own = {
            "--stations": stations,
            "--tilt": tilt,
            "--light-changes": light_changes or None,
            "--overlap": overlap,
        }
        for name, value in own.items():
            if value is not None:
                raise typer.BadParameter("a testbed has its own, those of the paper", param_hint=name)
        count = _testbed(scene.value, out, seed, points, given, quiet=quiet, as_json=json_progress)
    else:
        count = stations or 5
        _scenes(
            scene.value,
            out,
            seed,
            count,
            points or 2_000_000,
            given | {"tilt": tilt},
            overlap or (0.3, 0.7),
            light_changes=light_changes,
            quiet=quiet,
            as_json=json_progress,
        )
    typer.echo(f"{out}: {count} scans and truth.json")
    return 0


def _changes(given: dict[str, float | None]) -> dict[str, float]:
    """Give the options of the scanner that were given, under their own names and units."""
    named = {
        "noise_mm": ("range_noise_m", 1e-3),
        "angular_noise_arcsec": ("angular_noise_arcsec", 1.0),
        "max_range": ("max_range_m", 1.0),
        "tilt": ("tilt_deg", 1.0),
    }
    return {named[key][0]: value * named[key][1] for key, value in given.items() if value is not None}


def _scenes(
    scene: str,
    out: Path,
    seed: int,
    stations: int,
    points: int,
    given: dict[str, float | None],
    overlap: tuple[float, float],
    *,
    light_changes: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    import dataclasses

    from trihedral.cli.watch import watching
    from trihedral.simulate import ScannerOptions, make_site, write_site

    changes: dict[str, Any] = _changes(given)
    scanner = dataclasses.replace(ScannerOptions(light_changes=light_changes).with_beams(points), **changes)
    with watching(quiet=quiet, as_json=as_json) as progress:
        site = make_site(scene, seed, stations, scanner, overlap=overlap)
        progress.phase("simulate", stations, "scans", stations * points, "points")
        for scan in write_site(site, out):
            progress.advance(scan.name, points)


def _testbed(
    name: str,
    out: Path,
    seed: int,
    points: int | None,
    given: dict[str, float | None],
    *,
    quiet: bool,
    as_json: bool,
) -> int:
    from trihedral.cli.watch import watching
    from trihedral.simulate import RigOptions, make_testbed, write_testbed

    changes: dict[str, Any] = _changes(given)
    if "angular_noise_arcsec" in changes:
        changes["angular_noise_deg"] = changes.pop("angular_noise_arcsec") / 3600.0
    if points is not None:
        changes["points"] = points
    options = RigOptions(**changes)
    with watching(quiet=quiet, as_json=as_json) as progress:
        survey = make_testbed(name, seed, options)
        steps = len(survey.rig.scanners) + options.pictures
        progress.phase("simulate", len(survey) * steps, "sweeps and pictures", len(survey) * steps, "")
        for _ in write_testbed(survey, out, lambda what: progress.advance(what, 1.0)):
            pass
    return len(survey)
