"""`trihedral register`: the main job."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trihedral.cli import bug
from trihedral.cli.options import JsonProgress, NoProgress, ScanPaths, Threads
from trihedral.cli.terminal import show
from trihedral.cli.threads import limit_threads
from trihedral.errors import InputError

if TYPE_CHECKING:
    from trihedral.io.options import Place
    from trihedral.pair.paper import PaperOptions


class Units(StrEnum):
    """Units that files may be in."""

    m = "m"
    cm = "cm"
    mm = "mm"
    ft = "ft"
    us_ft = "us-ft"


class Method(StrEnum):
    """How pairs are registered and scans brought together."""

    auto = "auto"
    paper = "paper"


class Final(StrEnum):
    """The paper's final alignment."""

    auto = "auto"
    icp = "icp"
    planes = "planes"


class FeatureKind(StrEnum):
    """Features of pictures."""

    surf = "surf"
    sift = "sift"


# Longer than a page: typer makes an option of each parameter.
def register(
    paths: ScanPaths,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for the result; a run goes on in it.")
    ] = Path("out"),
    profile: Annotated[str, typer.Option(help="Tolerance that decides between exit 0 and 4.")] = "exterior",
    units: Annotated[
        Units | None, typer.Option(help="Units of the coordinates in all files; metres if nothing says so.")
    ] = None,
    scanner_origin: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z|FILE",
            help="Where the scanner stood in every file, in metres; or a table (CSV, TOML) of files and positions. "
            "Found from the points, else 0,0,0, if nothing says so.",
        ),
    ] = None,
    shortest_range: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            metavar="METRES",
            help="Points nearer to the scanner are left out: of its tripod, a vehicle, an operator.  [default: 0.1]",
        ),
    ] = None,
    method: Annotated[
        Method,
        typer.Option(help="auto: as good as can be done; paper: Kim, Chen and Cho's (2017) as written."),
    ] = Method.auto,
    final: Annotated[
        Final | None, typer.Option(help="Of the paper's method: its last step; auto: by the overlap.")
    ] = None,
    features: Annotated[
        FeatureKind | None, typer.Option(help="Of the paper's method: features of pictures; surf as it says.")
    ] = None,
    overlap_threshold: Annotated[
        float | None,
        typer.Option(
            min=0.0, max=1.0, help="Of the paper's method: overlap from which ICP is used.  [default: 0.89]"
        ),
    ] = None,
    constraints: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What is known beside the scans: control points, fixed scans, level, pairs. "
            "[default: trihedral.toml or constraints.toml beside the scans]",
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            help="True poses to measure the result against: a truth.json or another registration.json."
        ),
    ] = None,
    threads: Threads = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Dask scheduler whose workers do the work, e.g. tcp://host:8786; they must find the scans and the "
            "output folder under the same paths.",
        ),
    ] = None,
    quiet: NoProgress = False,
    json_progress: JsonProgress = False,
) -> int:
    """Find the pose of every scan, and say how far each may be trusted.

    Writes registration.json, poses.csv and report.html to the output folder and prints a summary.
    A run that was stopped goes on where it was when it is started again; a scan added later costs
    only its own work.

    Exits with 0 when every scan is placed and within tolerance, 3 when scans are not placed or
    ambiguous, 4 when the tolerance is not met, 2 when nothing can be read or the usage is wrong,
    1 when trihedral itself fails.
    """
    limit_threads(threads)
    bug.folder = out

    from trihedral import api
    from trihedral.cli.watch import watching
    from trihedral.io import ReadOptions
    from trihedral.pipeline import Options
    from trihedral.report.summary import summary
    from trihedral.scan.preparation import PrepareOptions
    from trihedral.verdict.profile import profile_named

    paper = _paper_options(method, final, features, overlap_threshold)
    place, places = _origins(scanner_origin, paths)
    read = ReadOptions(units=units.value if units else None, scanner_origin=place, scanner_origins=places)
    prepare = PrepareOptions() if shortest_range is None else PrepareOptions(shortest_range=shortest_range)
    options = Options(method=method.value, read=read, prepare=prepare, paper=paper)
    tolerance = profile_named(profile)
    with watching(quiet=quiet, as_json=json_progress) as progress:
        result = api.register(
            paths,
            out,
            options=options,
            constraints=constraints,
            profile=tolerance,
            reference=reference,
            threads=threads,
            progress=progress,
            dask=dask,
        )
    show(*summary(result.document).split("\n"))
    return result.exit_code


def _paper_options(
    method: Method, final: Final | None, features: FeatureKind | None, overlap_threshold: float | None
) -> "PaperOptions":
    from trihedral.initial.visual.features import FeatureOptions
    from trihedral.overlap.nearest import THRESHOLD, OverlapOptions
    from trihedral.pair.paper import PaperOptions

    if method is not Method.paper and (final or features or overlap_threshold is not None):
        raise typer.BadParameter(
            "--final, --features and --overlap-threshold are of the paper's method: add --method paper"
        )
    return PaperOptions(
        features=FeatureOptions(kind=features.value if features else "surf"),
        final=final.value if final else "auto",
        overlap=OverlapOptions(threshold=THRESHOLD if overlap_threshold is None else overlap_threshold),
    )


def _origins(text: str | None, paths: list[Path]) -> tuple["Place | None", tuple[tuple[str, "Place"], ...]]:
    """One position for all files, or those of a table."""
    if text is None:
        return None, ()
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        pass
    else:
        return (x, y, z), ()
    from trihedral.io.scanner_origins import read_scanner_origins

    table = Path(text)
    if not table.is_file():
        raise typer.BadParameter(
            f"{text!r} is not three numbers like 0,0,1.7, nor a file", param_hint="--scanner-origin"
        )
    places = read_scanner_origins(table)
    _check_names(table, [name for name, _ in places], paths)
    return None, places


def _check_names(table: Path, names: list[str], paths: list[Path]) -> None:
    """Refuse a table that names files of no scan; what cannot be read says so itself, later."""
    from trihedral.io import find_inputs

    try:
        files = find_inputs(paths)
    except InputError:
        return
    known = {name for file in files for name in (file.name, file.stem)}
    for name in names:
        if name not in known and name.rpartition("/")[0] not in known:
            raise InputError(
                table, f"{name!r} is none of the files", advice="Names are those of files, not of folders"
            )
