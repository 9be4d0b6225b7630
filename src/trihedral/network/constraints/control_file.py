"""Control points and where scans show them, as the constraints file or tables that it names have them."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from trihedral.errors import InputError
from trihedral.guarded import read_text
from trihedral.network.constraints.constraints import Control, ControlPoint, Measurement
from trihedral.network.constraints.names import nearest
from trihedral.network.constraints.table import ConstraintTable
from trihedral.scan.scan import METRES_PER_UNIT, Units

# Metres, where the file gives none.
_SIGMA = (0.002, 0.002, 0.002)


def control_of(table: ConstraintTable | None) -> Control:
    """Points and where scans show them, from the table that says so or names files of them."""
    if table is None:
        return Control("")
    units = cast(Units, table.choice("units", tuple(METRES_PER_UNIT), "m"))
    scale = METRES_PER_UNIT[units]
    sigma, measured = table.sigma("sigma_mm", _SIGMA), table.sigma("measurement_sigma_mm", _SIGMA)
    points: list[ControlPoint] = []
    for row in [*_rows(table, "points", ("name",), ("check",)), *table.tables("point")]:
        name, (x, y, z) = row.name("name"), row.triple("xyz")
        own = row.sigma("sigma_mm", sigma)
        points.append(ControlPoint(name, (scale * x, scale * y, scale * z), own, row.flag("check")))
        row.done()
    measurements: list[Measurement] = []
    for row in [*_rows(table, "measurements", ("scan", "point"), ()), *table.tables("measurement")]:
        scan, point, place = row.name("scan"), row.name("point"), row.triple("xyz")
        own = row.sigma("sigma_mm", measured)
        measurements.append(Measurement(scan, point, place, own))
        row.done()
    table.done()
    source = str(table.path.parent / table.values["points"]) if "points" in table.values else str(table.path)
    names = [point.name for point in points]
    for name in names:
        if names.count(name) > 1:
            raise InputError(source, f"point {name!r} is given twice", place="control")
    for measurement in measurements:
        if measurement.point not in names:
            raise InputError(
                table.path,
                f"scan {measurement.station} measures point {measurement.point!r}, which has no coordinates",
                place="control.measurements",
                advice=nearest(measurement.point, names, "Points are"),
            )
    if points and not measurements:
        raise table.error("measurements", "are missing: nothing says where the scans show the points")
    return Control(source, tuple(points), tuple(measurements))


def _rows(
    table: ConstraintTable, key: str, names: Sequence[str], flags: Sequence[str]
) -> list[ConstraintTable]:
    """Rows of a CSV file that the table names: names, x, y, z, sigma_mm; a heading may change their order."""
    file = table.text(key, None)
    if file is None:
        return []
    path = table.path.parent / file
    columns = [*names, "x", "y", "z", "sigma_mm", *flags]
    try:
        lines = list(csv.reader(read_text(path).splitlines()))
    except csv.Error:
        raise InputError(path, "it is not a CSV file") from None
    except InputError as error:
        raise InputError(path, error.reason, place=error.place, advice=f"{table.path} names it") from None
    result: list[ConstraintTable] = []
    for number, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in line]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if not result and {"x", "y", "z"} <= {cell.lower() for cell in cells}:
            columns = [cell.lower() for cell in cells]
            continue
        result.append(_row(path, number, dict(zip(columns, cells, strict=False)), names, flags))
    return result


def _row(
    path: Path, line: int, cells: Mapping[str, str], names: Sequence[str], flags: Sequence[str]
) -> ConstraintTable:
    place = f"line {line}"
    values: dict[str, Any] = {key: text for key, text in cells.items() if key not in ("x", "y", "z")}
    for name in names:
        if not values.get(name):
            raise InputError(path, f"lacks a {name}", place=place)
    try:
        values["xyz"] = [float(cells[axis]) for axis in "xyz"]
        if cells.get("sigma_mm"):
            values["sigma_mm"] = float(cells["sigma_mm"])
        else:
            values.pop("sigma_mm", None)
    except (KeyError, ValueError):
        reason, advice = "x, y, z and sigma must be numbers", "Points, not commas, before decimals"
        raise InputError(path, reason, place=place, advice=advice) from None
    for flag in flags:
        word = str(values.pop(flag, "")).lower()
        if word not in ("", "0", "1", "no", "yes", "false", "true", flag):
            raise InputError(path, f"{word!r} is neither yes nor no", place=f"{place}, {flag}")
        values[flag] = word in ("1", "yes", "true", flag)
    return ConstraintTable(path, place, values)
