"""Registered data: the scans of a finished job, read again and written with the poses that were found.

In: the folder of a job (`registration.json`). Out: files in project coordinates, one a scan or merged. One
raw scan is in memory at a time, and the inputs are only read.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import output_error
from trihedral.errors import InputError, OptionError, OutputError
from trihedral.export.e57 import e57_scan
from trihedral.export.names import file_name
from trihedral.io import ReadOptions, detect, las, pcd, ply, ptx, read_headers, read_photos, read_scan
from trihedral.io.e57 import E57Scan, copy_with_poses, write_e57
from trihedral.io.writers import Content, PlacedScan
from trihedral.job.hashes import digest
from trihedral.job.inputs import SourceFile
from trihedral.output_folder import OutputFolder
from trihedral.progress import Progress, Silent
from trihedral.report.reading import read_result
from trihedral.report.result import Document
from trihedral.scan import ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT
from trihedral.version import fingerprint

ExportFormat = Literal["e57", "laz", "ply", "pcd", "ptx"]

# Where exports go inside the folder of a job.
EXPORT_FOLDER = "export"
# The stem of a file that holds all scans.
MERGED = "merged"

_WRITERS = {"laz": las.write, "ply": ply.write, "pcd": pcd.write, "ptx": ptx.write}
_WRITING = ("geometry", "scan", "io", "fusion", "export")


@dataclass(frozen=True)
class Exported:
    """What an export wrote and what it could not."""

    files: tuple[Path, ...]
    #: Name of a scan, and why it is not in the files.
    left_out: tuple[tuple[str, str], ...]
    #: What a person should know of the files.
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Placed:
    """A station of the result that has a pose."""

    name: str
    source: Path
    scan_index: int
    points: int
    pose: NDArray[np.float64]
    component: int
    #: Position in project coordinates, metres.
    scanner: NDArray[np.float64]


def export(
    out: Path | str,
    kind: ExportFormat,
    folder: Path | str | None = None,
    *,
    merged: bool = False,
    progress: Progress | None = None,
) -> Exported:
    """Write the registered scans of a finished job.

    An E57 source of which all scans are placed is copied and only its poses are rewritten; everything else is
    read and written anew.
    Scans that are not tied to each other have no common frame and are never merged into one file.

    Parameters
    ----------
    out
        Folder of the job.
    folder
        Where to; by default `export` in the job's folder. Older exports are replaced, and those of the same result
        kept; a file that is not one of them is refused.
    merged
        All scans in one file instead of one file a scan.

    Raises
    ------
    InputError
        If the result cannot be read, no scan is placed, or a source is absent, damaged or changed.
    OutputError
        If a file cannot be written or would replace one that is not ours.
    OptionError
        If the format is unknown.
    """
    if kind not in get_args(ExportFormat):
        raise OptionError(f"export writes {', '.join(get_args(ExportFormat))}, not {kind!r}")
    out, progress = Path(out), progress or Silent()
    document = read_result(out)
    placed, left_out = _stations(document)
    if not placed:
        raise InputError(out / "registration.json", "no scan is placed: there is nothing to export")
    options = _read_options(document)
    crs = (document.get("frame") or {}).get("crs")
    target = out / EXPORT_FOLDER if folder is None else Path(folder)
    if folder is None and target.is_symlink():
        raise OutputError(target, "it is a link", advice="Name the folder that is meant with --output")
    plan = _plan(placed, kind, merged)
    _check_targets([target / name for name in plan], placed)
    notes = _frames(placed)
    with OutputFolder(target) as files:
        files.check(plan)
        hashes = _check_sources(document, placed, progress)
        progress.phase("export", len(placed), "scans", sum(station.points for station in placed), "points")
        program = fingerprint(*_WRITING)
        for name, stations in plan.items():
            # Only the main group of scans is in the project's frame.
            known = None if any(station.component for station in stations) else crs
            of = [
                (hashes[s.source], s.scan_index, s.name, s.pose.tobytes().hex(), s.component)
                for s in stations
            ]
            made_of = digest(program, kind, str(merged), str(options), str(known), str(of))
            if files.holds(name, made_of):
                for station in stations:
                    progress.advance(station.name, station.points)
                continue
            with files.replacing(name, made_of) as path:
                _write(path, kind, stations, merged, options, progress, known, notes)
    return Exported(tuple(target / name for name in plan), tuple(left_out), tuple(notes))


def _write(
    path: Path,
    kind: str,
    stations: Sequence[_Placed],
    merged: bool,
    options: ReadOptions,
    progress: Progress,
    crs: str | None,
    notes: list[str],
) -> None:
    if kind != "e57":
        _write_points(path, kind, stations, options, progress, crs)
    elif not merged and _is_whole_e57(stations, notes):
        _copy_e57(path, stations, options, progress, crs)
    else:
        with _writing(path):
            write_e57(path, _e57_scans(stations, options, progress, notes), crs=crs)


def _stations(document: Document) -> tuple[list[_Placed], list[tuple[str, str]]]:
    placed, left_out = [], []
    for station in document["stations"]:
        if station["pose"] is None:
            left_out.append((station["name"], station["reason"] or "it is not placed"))
            continue
        pose = np.array(station["pose"], dtype=np.float64)
        origin = np.array(station.get("scanner_origin") or (0.0, 0.0, 0.0), dtype=np.float64)
        placed.append(
            _Placed(
                name=station["name"],
                source=Path(station["source"]),
                scan_index=station["scan_index"],
                points=station["points"],
                pose=pose,
                component=station["component"] or 0,
                scanner=pose[:3, :3] @ origin + pose[:3, 3],
            )
        )
    return placed, left_out


def _read_options(document: Document) -> ReadOptions:
    """Read the files as the job did."""
    stated = document["software"].get("options", {}).get("read") or {}
    origin = stated.get("scanner_origin")
    places = [(name, _place(place)) for name, place in stated.get("scanner_origins") or ()]
    for station in document["stations"]:
        # Found from the points: not searched again.
        if station.get("scanner_origin_sigma_m"):
            key = f"{Path(station['source']).name}/{station['scan_index'] + 1}"
            places.append((key, _place(station["scanner_origin"])))
    return ReadOptions(
        units=stated.get("units"),
        scanner_origin=None if origin is None else _place(origin),
        scanner_origins=tuple(places),
    )


def _place(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z


def _plan(placed: Sequence[_Placed], kind: str, merged: bool) -> dict[str, list[_Placed]]:
    """Tell by name which scans go into which file. E57 keeps the scans of a source together that share a frame."""
    groups: dict[tuple[str, Any], list[_Placed]] = {}
    for station in placed:
        if merged:
            number = station.component
            stem = MERGED if number == 0 else f"{MERGED}-{number + 1}"
            groups.setdefault((stem, number), []).append(station)
        elif kind == "e57":
            key = (station.source, station.component)
            groups.setdefault((station.source.stem, key), []).append(station)
        else:
            groups.setdefault((station.name, station.name), []).append(station)
    taken: set[str] = set()
    return {file_name(stem, kind, taken): stations for (stem, _), stations in groups.items()}


def _check_targets(targets: Sequence[Path], placed: Sequence[_Placed]) -> None:
    sources = {station.source.resolve() for station in placed}
    for path in targets:
        if path.resolve() in sources:
            raise OutputError(
                path, "it is one of the scans that were registered", advice="Choose another folder"
            )


def _check_sources(document: Document, placed: Sequence[_Placed], progress: Progress) -> dict[Path, str]:
    """Hold every source against the size and hash it had when it was registered, and give the hashes."""
    known = {entry["path"]: entry for entry in document["inputs"]}
    files = []
    for source in dict.fromkeys(station.source for station in placed):
        if str(source) not in known:
            raise InputError(source, "registration.json does not list it among its inputs")
        if not source.exists():
            raise InputError(
                source,
                "there is no such file",
                advice="Paths are those given to `trihedral register`: export from the same folder",
            )
        files.append(SourceFile.of(source))
        if files[-1].bytes != known[str(source)]["bytes"]:
            raise _changed(source)
    progress.phase("check", len(files), "files", sum(file.bytes for file in files), "bytes")
    for file in files:
        if file.sha256() != known[str(file.path)]["sha256"]:
            raise _changed(file.path)
        progress.advance(file.path.name, file.bytes)
    return {file.path: known[str(file.path)]["sha256"] for file in files}


def _changed(source: Path) -> InputError:
    return InputError(source, "it has changed since it was registered", advice="Register again")


def _frames(placed: Sequence[_Placed]) -> list[str]:
    """Name the scans that are in a frame of their own."""
    apart: dict[int, list[str]] = {}
    for station in placed:
        if station.component:
            apart.setdefault(station.component, []).append(station.name)
    return [
        f"not tied to the first group of scans, in a frame of its own: {', '.join(names)}"
        for _, names in sorted(apart.items())
    ]


def _header(station: _Placed, options: ReadOptions) -> ScanHeader:
    headers = read_headers(station.source, options)
    if station.scan_index >= len(headers):
        raise InputError(
            station.source, f"it has {len(headers)} scans, number {station.scan_index + 1} is wanted"
        )
    return headers[station.scan_index]


def _read(station: _Placed, header: ScanHeader, options: ReadOptions) -> PlacedScan:
    scan = read_scan(header, options)
    if len(scan) != station.points:
        raise InputError(
            station.source,
            f"scan {station.name} has {len(scan)} points, {station.points} were registered",
            advice="Register again",
        )
    return PlacedScan(station.name, scan, station.pose)


def _write_points(
    path: Path,
    kind: str,
    stations: Sequence[_Placed],
    options: ReadOptions,
    progress: Progress,
    crs: str | None,
) -> None:
    headers = [_header(station, options) for station in stations]
    content = Content(
        points=sum(station.points for station in stations),
        color=any(header.has_color for header in headers),
        intensity=any(header.has_intensity for header in headers),
        scanners=tuple(station.scanner for station in stations),
        crs=crs,
    )

    def scans() -> Iterator[PlacedScan]:
        for station, header in zip(stations, headers, strict=True):
            yield _read(station, header, options)
            progress.advance(station.name, station.points)

    _WRITERS[kind](path, scans(), content)


def _is_whole_e57(stations: Sequence[_Placed], notes: list[str]) -> bool:
    """Whether a copy of the source holds these scans and no other, which would lie wherever it was left."""
    source = stations[0].source
    if detect(source) != "e57":
        return False
    others = len(read_headers(source)) - len(stations)
    if others:
        notes.append(
            f"{source.name} is written anew, not copied: it also holds "
            f"{'a scan' if others == 1 else f'{others} scans'} that cannot be placed beside it"
        )
    return not others


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise output_error(path, error) from error


def _copy_e57(
    path: Path, stations: Sequence[_Placed], options: ReadOptions, progress: Progress, crs: str | None
) -> None:
    source = stations[0].source
    poses = {}
    for station in stations:
        pose = station.pose.copy()
        # The copy stays in the unit of its points, which E57 takes for metres whatever it is.
        pose[:3, 3] /= METRES_PER_UNIT[options.units or "m"]
        poses[station.scan_index] = pose
    with _writing(path):
        copy_with_poses(source, path, poses, crs)
    for station in stations:
        progress.advance(station.name, station.points)


def _e57_scans(
    stations: Sequence[_Placed], options: ReadOptions, progress: Progress, notes: list[str]
) -> Iterator[E57Scan]:
    for station in stations:
        header = _header(station, options)
        scan = _read(station, header, options).scan
        photos = read_photos(header)
        bent = sum(any(photo.camera.distortion) for photo in photos)
        if bent:
            notes.append(
                f"{station.name}: {bent} {'picture' if bent == 1 else 'pictures'} straightened, E57 cannot "
                "state a lens distortion"
            )
        yield e57_scan(station.name, scan, station.pose, photos)
        progress.advance(station.name, len(scan))
