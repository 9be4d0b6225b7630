"""`trihedral info`: what files hold, without reading their points."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trihedral.cli.options import ScanPaths
from trihedral.errors import InputError, printable

if TYPE_CHECKING:
    from trihedral.scan import ScanHeader


def info(
    paths: ScanPaths,
    as_json: Annotated[bool, typer.Option("--json", help="Everything as JSON, for programs.")] = False,
) -> int:
    """Show what files hold: scans, points, grid, colour, pictures, poses, scanner origin, units.

    Points are not read, so it is quick, and numbers are as the files declare them. "stated" is what the
    file or its format says, "assumed" is what `trihedral register` would take for granted.

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
                described.append(_describe(file))
            except InputError as error:
                described.append(_failed(file, error))
    if as_json:
        typer.echo(json.dumps(described, indent=1, ensure_ascii=False))
    else:
        for entry in described:
            if "error" not in entry:
                _show(entry)
    for entry in described:
        if "error" in entry:
            typer.echo(entry["error"], err=True)
    return 2 if any("error" in entry for entry in described) else 0


def _failed(path: Path, error: Exception) -> dict[str, Any]:
    return {"path": str(path), "error": str(error)}


def _describe(path: Path) -> dict[str, Any]:
    from trihedral.io import read_headers

    headers = read_headers(path)
    return {
        "path": str(path),
        "format": headers[0].format,
        "bytes": path.stat().st_size,
        "scans": [_scan(header) for header in headers],
    }


def _scan(header: "ScanHeader") -> dict[str, Any]:
    from trihedral.io import read_cameras

    return {
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
        *(("picture", "{name}: {camera}, {width} x {height}".format(**photo)) for photo in scan["photos"]),
        ("pose", _pose(scan["pose"])),
        ("scanner", _said(_triple(scan["scanner_origin"]), scan["origin_stated"])),
        ("units", _said(scan["units"], scan["units_stated"])),
        *(("note", note) for note in scan["notes"]),
    ]


def _said(value: str, stated: bool) -> str:
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
