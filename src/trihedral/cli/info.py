"""`trihedral info`: what files hold; points are read only of those that do not say where the scanner stood."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trihedral.cli.options import ScanPaths
from trihedral.cli.terminal import show_json, tell
from trihedral.errors import InputError, printable

if TYPE_CHECKING:
    from trihedral.scan import ScanHeader

# Of a larger file the scanner's place is not looked for here.
_MOST_BYTES, _MOST_POINTS = 1 << 30, 30_000_000


def info(
    paths: ScanPaths,
    points: Annotated[
        bool,
        typer.Option("--points", help="Read the points, too: what of their colour and intensity is used."),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Everything as JSON, for programs.")] = False,
) -> int:
    """Show what files hold: scans, points, grid, colour, pictures, poses, scanner origin, units.

    Points are read only where --points asks for it, or of files up to 1 GB that do not say where the scanner stood;
    numbers are as the files declare them. "stated" is what the file or its format says, "found" is what the points
    tell, "assumed" is what `trihedral register` would take for granted.

    Exits with 2 when a file cannot be read; the others are shown all the same.
    """
    from trihedral.io import find_inputs

    described = []
    for path in paths:
        try:
            found = find_inputs([path])
        except InputError as error:
            described.append(_failed(path, error))
            continue
        for file in found:
            try:
                described.append(_describe(file, points))
            except InputError as error:
                described.append(_failed(file, error))
    if as_json:
        show_json(described)
    else:
        for entry in described:
            if "error" not in entry:
                _show(entry)
    for entry in described:
        if "error" in entry:
            tell(entry["error"])
    return 2 if any("error" in entry for entry in described) else 0


def _failed(path: Path, error: Exception) -> dict[str, Any]:
    return {"path": str(path), "error": str(error)}


def _describe(path: Path, points: bool) -> dict[str, Any]:
    from trihedral.io import read_headers

    headers = [_located(header) for header in read_headers(path)]
    return {
        "path": str(path),
        "format": headers[0].format,
        "bytes": path.stat().st_size,
        "scans": [_scan(*_read(header)) if points else _scan(header) for header in headers],
    }


def _read(header: "ScanHeader") -> tuple["ScanHeader", dict[str, Any]]:
    """Read the points as `trihedral register` does: the header with what was found, and what is used of them."""
    from trihedral.io import read_scan
    from trihedral.scan.appearance import telling

    stored = read_scan(header)
    scan = telling(stored)
    share = 0.0 if stored.color is None else 1.0 if stored.colored is None else float(stored.colored.mean())
    used = {"points": len(scan), "colored": share, "color": scan.color is not None}
    return scan.header, {**used, "intensity": scan.intensity is not None}


def _located(header: "ScanHeader") -> "ScanHeader":
    """Say of a file that does not say it where the scanner stood, or why that cannot be told."""
    from trihedral.io import read_scan

    if header.origin_stated and (header.format != "e57" or header.file_pose is not None):
        return header
    if header.source.stat().st_size > _MOST_BYTES or (header.points or 0) > _MOST_POINTS:
        return header
    try:
        found = read_scan(header).header
    except InputError as error:
        return replace(header, notes=(*header.notes, f"{error.reason}. {error.advice}"))
    if found.origin_sigma is None:
        return header
    return replace(
        header, scanner_origin=found.scanner_origin, origin_sigma=found.origin_sigma, notes=found.notes
    )


def _scan(header: "ScanHeader", used: dict[str, Any] | None = None) -> dict[str, Any]:
    from trihedral.io import read_cameras

    return {
        **({} if used is None else {"used": used}),
        "name": header.name,
        "points": header.points,
        "grid": None if header.grid is None else {"rows": header.grid[0], "columns": header.grid[1]},
        "color": header.has_color,
        "intensity": header.has_intensity,
        "photos": [
            {"name": name, "camera": camera.kind, "width": camera.width, "height": camera.height}
            for name, camera in read_cameras(header)
        ],
        "pose": None if header.file_pose is None else header.file_pose.tolist(),
        "scanner_origin": header.scanner_origin.tolist(),
        "origin_stated": header.origin_stated,
        "scanner_origin_sigma_m": header.origin_sigma,
        "units": header.units,
        "units_stated": header.units_stated,
        "notes": list(header.notes),
    }


def _show(entry: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    scans = entry["scans"]
    count = "1 scan" if len(scans) == 1 else f"{len(scans)} scans"
    console.print(
        Text.assemble(
            (printable(entry["path"]), "bold"),
            f": {entry['format'].upper()}, {_size(entry['bytes'])}, {count}",
        )
    )
    for number, scan in enumerate(scans, 1):
        for label, value in _rows(number, scan):
            console.print(Text(f"  {label:<10}{printable(value)}"))


def _rows(number: int, scan: dict[str, Any]) -> list[tuple[str, str]]:
    points = "points not counted" if scan["points"] is None else f"{scan['points']:,} points"
    grid = "no grid" if scan["grid"] is None else "{rows:,} rows x {columns:,} columns".format(**scan["grid"])
    holds = [name for name, there in (("colour", scan["color"]), ("intensity", scan["intensity"])) if there]
    return [
        (f"scan {number}", scan["name"]),
        ("holds", ", ".join([points, grid, *holds])),
        *([("used", _used(scan["used"]))] if "used" in scan else []),
        *(("picture", "{name}: {camera}, {width} x {height}".format(**photo)) for photo in scan["photos"]),
        ("pose", _pose(scan["pose"])),
        (
            "scanner",
            _said(_triple(scan["scanner_origin"]), scan["origin_stated"], scan["scanner_origin_sigma_m"]),
        ),
        ("units", _said(scan["units"], scan["units_stated"])),
        *(("note", note) for note in scan["notes"]),
    ]


def _used(used: dict[str, Any]) -> str:
    parts = [f"{used['points']:,} points"]
    parts += [f"colour ({used['colored']:.1%} of them have one)"] if used["color"] else []
    return ", ".join(parts + (["intensity"] if used["intensity"] else []))


def _said(value: str, stated: bool, sigma: tuple[float, ...] | None = None) -> str:
    if sigma is not None:
        return f"{value} (found from the points, sigma {max(sigma) * 1e3:.1f} mm)"
    return f"{value} ({'stated' if stated else 'assumed'})"


def _triple(values: list[float]) -> str:
    return ", ".join(f"{value:.3f}" for value in values) + " m"


def _pose(rows: list[list[float]] | None) -> str:
    if rows is None:
        return "none in the file"
    heading = math.degrees(math.atan2(rows[1][0], rows[0][0]))
    tilt = math.degrees(math.acos(max(-1.0, min(1.0, rows[2][2]))))
    return f"{_triple([row[3] for row in rows[:3]])}, heading {heading:.2f} deg, tilt {tilt:.2f} deg"


def _size(count: int) -> str:
    value = float(count)
    for unit in ("bytes", "kB", "MB"):
        if value < 1000.0:
            return f"{value:.0f} {unit}" if unit == "bytes" else f"{value:.1f} {unit}"
        value /= 1000.0
    return f"{value:.1f} GB"
