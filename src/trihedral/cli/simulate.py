"""`trihedral simulate`: scans with known truth."""

import dataclasses
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trihedral.cli.options import JsonProgress, NoProgress
from trihedral.cli.terminal import show

if TYPE_CHECKING:
    from trihedral.progress import Progress


class SceneName(StrEnum):
    """What can be simulated; the names of `trihedral.simulate.SCENES` and `TESTBEDS`, which are slow to import."""

    building = "building"
    corridor = "corridor"
    estate = "estate"
    facade = "facade"
    floors = "floors"
    gallery = "gallery"
    hall = "hall"
    hotel = "hotel"
    office = "office"
    rooms = "rooms"
    site = "site"
    warehouse = "warehouse"
    testbed1 = "testbed1"
    testbed2 = "testbed2"
    testbed3 = "testbed3"


class PatternName(StrEnum):
    """The names of `trihedral.simulate.patterns.PATTERNS`."""

    regular = "regular"
    leaning = "leaning"
    jittered = "jittered"
    gaps = "gaps"
    sweeps = "sweeps"
    tilting = "tilting"
    rings = "rings"


# Longer than a page: typer makes an option of each parameter.
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
    pattern: Annotated[
        PatternName | None,
        typer.Option(help="Directions that are measured in.  [default: regular; not for testbeds]"),
    ] = None,
    pulse_length: Annotated[
        float | None,
        typer.Option(
            min=0.001,
            help="Metres over which echoes of a beam that meets several surfaces are mixed.  [default: 0.3; not for "
            "testbeds]",
        ),
    ] = None,
    beam_mrad: Annotated[
        float | None,
        typer.Option(min=0.0, help="Full angle of the beam, milliradians.  [default: 0.3; not for testbeds]"),
    ] = None,
    returns: Annotated[
        int | None,
        typer.Option(
            min=1, max=3, help="Echoes of a beam that are written down.  [default: 1; not for testbeds]"
        ),
    ] = None,
    export: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND[,KIND...]",
            help="The same scans as people's exports have them, in a folder of their own: nogrid, thinned=0.03, "
            "random=0.2, window=180, hanging, merged, laz and others (docs/simulator.md); may be repeated, not "
            "for testbeds.",
        ),
    ] = None,
    quiet: NoProgress = False,
    json_progress: JsonProgress = False,
) -> int:
    """Make scans of a site that does not exist, with the true pose of each.

    Writes one E57 file a scan, without poses and with names that tell nothing, and truth.json. The testbeds
    are those of Kim, Chen and Cho (2017): a rig's raw profiles and pictures, at the distances that the paper
    states. The same options give the same files. An output folder that this command wrote before is replaced;
    any other must be empty.
    """
    given = (
        ("range_noise_m", noise_mm, 1e-3),
        ("angular_noise_arcsec", angular_noise_arcsec, 1.0),
        ("max_range_m", max_range, 1.0),
        ("tilt_deg", tilt, 1.0),
        ("pulse_length_m", pulse_length, 1.0),
        ("beam_divergence_rad", beam_mrad, 1e-3),
    )
    changes: dict[str, Any] = {name: value * unit for name, value, unit in given if value is not None}
    if returns is not None:
        changes["returns"] = returns
    if scene.value.startswith("testbed"):
        own = {"--stations": stations, "--tilt": tilt, "--light-changes": light_changes or None}
        own |= {"--pulse-length": pulse_length, "--beam-mrad": beam_mrad, "--returns": returns}
        for name, value in {**own, "--overlap": overlap, "--pattern": pattern, "--export": export}.items():
            if value is not None:
                raise typer.BadParameter("a testbed has its own, those of the paper", param_hint=name)

    from trihedral.cli.watch import watching

    with watching(quiet=quiet, as_json=json_progress) as progress:
        if scene.value.startswith("testbed"):
            count = _testbed(progress, scene.value, out, seed, points, changes)
        else:
            count = stations or 5
            changes["light_changes"] = light_changes
            shared = overlap or (0.3, 0.7)
            beams = points or 2_000_000
            beam_pattern = (pattern or PatternName.regular).value
            _scenes(
                progress, scene.value, out, seed, count, beams, changes, shared, beam_pattern, export or []
            )
    show(f"{out}: {count} scans and truth.json")
    return 0


def _scenes(
    progress: "Progress",
    scene: str,
    out: Path,
    seed: int,
    stations: int,
    points: int,
    changes: dict[str, Any],
    overlap: tuple[float, float],
    pattern: str,
    exports: list[str],
) -> None:
    from trihedral.simulate import ScannerOptions, make_site, parse_variant, write_exports

    scanner = dataclasses.replace(ScannerOptions().with_beams(points), **changes)
    variants = [parse_variant(text) for text in exports]
    site = make_site(scene, seed, stations, scanner, overlap=overlap, pattern=pattern)
    progress.phase("simulate", stations, "scans", stations * points, "points")
    for scan in write_exports(site, out, variants):
        progress.advance(scan.name, points)


def _testbed(
    progress: "Progress", name: str, out: Path, seed: int, points: int | None, changes: dict[str, Any]
) -> int:
    from trihedral.simulate import RigOptions, make_testbed, write_testbed

    if "angular_noise_arcsec" in changes:
        changes["angular_noise_deg"] = changes.pop("angular_noise_arcsec") / 3600.0
    if points is not None:
        changes["points"] = points
    options = RigOptions(**changes)
    survey = make_testbed(name, seed, options)
    steps = len(survey.rig.scanners) + options.pictures
    progress.phase("simulate", len(survey) * steps, "sweeps and pictures", len(survey) * steps, "")
    for _ in write_testbed(survey, out, lambda what: progress.advance(what, 1.0)):
        pass
    return len(survey)
