"""LAS and LAZ, through laspy and lazrs.

Format: ASPRS LAS 1.4 R15. A LAS file has no place for the scanner; its units are those of its coordinate
system.
"""

import io
import re
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import GeoKeyDirectoryVlr, WktCoordinateSystemVlr
from numpy.typing import NDArray

from trihedral import _core
from trihedral.atomic import creating
from trihedral.errors import InputError
from trihedral.guarded import blamed_on, open_input
from trihedral.io.detect import detect
from trihedral.io.headers import loose_header
from trihedral.io.las_sizes import check_sizes
from trihedral.io.options import ReadOptions
from trihedral.io.scan_builder import local_origin_for, scan_from
from trihedral.io.writers import Block, Content, PlacedScan, blocks
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.scan import METRES_PER_UNIT, Units

# Bytes of point records that are unpacked at a time.
_CHUNK_BYTES = 1 << 25
# No coordinate that a file's scale and offset can make lies further (file's units).
_FARTHEST = 1e12
# Step of the coordinates that are written (metres); 32 bits then reach 214 km from the offset.
_STEP = 1e-4
# GeoTIFF 1.1, section 7.4 and annex: keys and the EPSG codes of linear units.
_MODEL_TYPE, _PROJECTED_UNITS, _VERTICAL_UNITS = 1024, 3076, 4099
_PROJECTED_SYSTEM, _VERTICAL_SYSTEM = 3072, 4096
# Codes of systems that are not EPSG's own: undefined, or defined by the file's other keys.
_OWN_SYSTEM = 32767
_GEOGRAPHIC_MODEL = 2
_EPSG_UNITS: dict[int, Units] = {9001: "m", 9002: "ft", 9003: "us-ft", 1025: "mm", 1033: "cm"}
_WKT = re.compile(r"\s*[A-Z_]+(CS|CRS)\s*\[")
# A record's length is told in 16 bits.
_LONGEST_RECORD = 65_535
_WKT_UNIT = re.compile(r'\b(?:LENGTH)?UNIT\[\s*"[^"]*"\s*,\s*([0-9.eE+-]+)')


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read the header and the records that tell the units."""
    with _opened(path) as (reader, notes):
        return [_header(path, reader.header, options, notes)]


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, list[str]]]:
    """Give laspy's reader of a file, and notes on what it will not tell."""
    with blamed_on(path):
        try:
            notes = check_sizes(path)
            with open_input(path) as stream, laspy.open(stream, closefd=False) as reader:
                yield reader, notes
        except (lazrs.LazrsError, laspy.errors.LaspyException, struct.error) as error:
            raise InputError(path, f"it is damaged: {error}") from error


def _header(path: Path, header: Any, options: ReadOptions, said: list[str]) -> ScanHeader:
    # What 32 bits can reach must be on Earth; NaN is not.
    with np.errstate(over="ignore"):
        reach = np.abs(header.scales) * 2.0**31 + np.abs(header.offsets)
    if not ((reach < _FARTHEST).all() and header.scales.all()):
        raise InputError(path, "its scales and offsets are not usable numbers", place="byte 131")
    units, notes = _units(path, [*header.vlrs, *(header.evlrs or [])], options)
    names = list(header.point_format.dimension_names)
    return loose_header(
        path,
        detect(path),
        options,
        points=header.point_count,
        has_color="red" in names,
        has_intensity="intensity" in names,
        units=units,
        fields=list(header.point_format.extra_dimension_names),
        notes=[*said, *notes],
    )


def _units(path: Path, records: list[Any], options: ReadOptions) -> tuple[Units | None, list[str]]:
    """Tell the unit that the file's coordinate system states, None where it has none, and what to say of it."""
    found: set[Units] = set()
    named: list[int] = []
    for record in records:
        if isinstance(record, WktCoordinateSystemVlr):
            text = record.string
            if not re.search(r"\b(PROJCS|PROJCRS|LOCAL_CS|ENGCRS|ENGINEERINGCRS|GEOCCS)\b", text):
                if re.search(r"\b(GEOGCS|GEOGCRS|GEODCRS)\b", text):
                    _refuse_angles(path, options)
                continue
            found |= {unit for factor in map(float, _WKT_UNIT.findall(text)) if (unit := _unit_of(factor))}
        elif isinstance(record, GeoKeyDirectoryVlr):
            keys = {key.id: key.value_offset for key in record.geo_keys}
            if keys.get(_MODEL_TYPE) == _GEOGRAPHIC_MODEL:
                _refuse_angles(path, options)
            for unit_key, system in (
                (_PROJECTED_UNITS, _PROJECTED_SYSTEM),
                (_VERTICAL_UNITS, _VERTICAL_SYSTEM),
            ):
                if keys.get(unit_key) in _EPSG_UNITS:
                    found.add(_EPSG_UNITS[keys[unit_key]])
                elif 1023 < keys.get(system, 0) < _OWN_SYSTEM:
                    named.append(keys[system])
    notes = []
    for code in named:
        unit, why_not = _unit_of_system(path, code, options)
        found |= {unit} if unit else set()
        if unit is None and options.units is None:
            notes.append(
                f"the file names the coordinate system EPSG:{code}, whose unit is not known{why_not}"
            )
    if len(found) > 1 and options.units is None:
        raise InputError(
            path,
            f"its coordinate system mixes units: {', '.join(sorted(found))}",
            advice="Convert it to one unit, or state it with --units",
        )
    return found.pop() if len(found) == 1 else None, [] if found else notes


def _unit_of(factor: float) -> Units | None:
    """Give the unit of so many metres."""
    near = (unit for unit, metres in METRES_PER_UNIT.items() if abs(factor / metres - 1) < 1e-7)
    return next(near, None)


def _unit_of_system(path: Path, code: int, options: ReadOptions) -> tuple[Units | None, str]:
    """Look up the unit of an EPSG system, which takes pyproj; None and why where it is not known."""
    try:
        from pyproj import CRS
        from pyproj.exceptions import CRSError
    except ImportError:
        return None, " without pyproj (pip install 'trihedral[crs]')"
    try:
        system = CRS.from_epsg(code)
    except CRSError:
        return None, ""
    if system.is_geographic:
        _refuse_angles(path, options)
    units = {_unit_of(axis.unit_conversion_factor) for axis in system.axis_info}
    return (units.pop() if len(units) == 1 else None), ""


def _refuse_angles(path: Path, options: ReadOptions) -> None:
    if options.units is None:
        raise InputError(
            path,
            "its coordinates are longitude and latitude, which are no lengths",
            advice="Project it to a metric coordinate system first",
        )


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Read the points that are not flagged as withheld."""
    with _opened(path) as (reader, notes):
        header = _header(path, reader.header, options, notes)
        points = _points(path, reader, METRES_PER_UNIT[header.units])
    return scan_from(header, points)


def _points(path: Path, reader: Any, metres_per_unit: float) -> _core.PointBlock:
    count = reader.header.point_count
    has_color = "red" in reader.header.point_format.dimension_names
    # Memory is taken as it is filled.
    xyz = np.empty((count, 3), np.float32)
    intensity = np.empty(count, np.float32)
    color = np.empty((count, 3), np.uint16) if has_color else None
    origin: NDArray[np.float64] | None = None
    end = withheld = no_return = read = 0
    for chunk in reader.chunk_iterator(max(1, _CHUNK_BYTES // reader.header.point_format.size)):
        read += len(chunk)
        axes = [np.asarray(axis) * metres_per_unit for axis in (chunk.x, chunk.y, chunk.z)]
        flagged = np.asarray(chunk.withheld, dtype=bool)
        keep = ((axes[0] != 0.0) | (axes[1] != 0.0) | (axes[2] != 0.0)) & ~flagged
        kept = int(np.count_nonzero(keep))
        withheld += int(np.count_nonzero(flagged))
        no_return += len(chunk) - kept - int(np.count_nonzero(flagged))
        if kept == 0:
            continue
        # Nearly always all of them: no copy then.
        chosen = slice(None) if kept == len(chunk) else keep
        axes = [axis[chosen] for axis in axes]
        if origin is None:
            origin = local_origin_for(axes)
        begin, end = end, end + kept
        for column, axis in enumerate(axes):
            xyz[begin:end, column] = axis - origin[column]
        intensity[begin:end] = np.asarray(chunk.intensity)[chosen]
        if color is not None:
            for column, channel in enumerate((chunk.red, chunk.green, chunk.blue)):
                color[begin:end, column] = np.asarray(channel)[chosen]
    if read != count:
        raise InputError(path, f"the file ends after {read} of {count} points")
    return _core.PointBlock(
        _first(xyz, end),
        [0.0] * 3 if origin is None else origin.tolist(),
        _first(intensity, end),
        None if color is None or end == 0 else _first(color, end),
        no_return=no_return,
        withheld=withheld,
    )


def _first(values: NDArray[Any], count: int) -> NDArray[Any]:
    """Give the first values, without those behind them in memory."""
    return values if count == len(values) else values[:count].copy()


def write(path: Path, scans: Iterable[PlacedScan], content: Content) -> None:
    """Write a LAZ 1.4 file of project coordinates in steps of 0.1 mm.

    Colour and intensity take the full 16 bits; `point_source_id` is the scan's place in the file, from 1.
    """
    header = laspy.LasHeader(version="1.4", point_format=7 if content.color else 6)
    header.scales = np.full(3, _STEP)
    header.offsets = np.round(np.mean(content.scanners, axis=0))
    header.generating_software = "trihedral"
    if content.crs is not None:
        _name_coordinates(header, content.crs)
    with creating(path) as temporary:
        output = _Output(io.FileIO(temporary, "wb"))
        try:
            with laspy.open(output, mode="w", header=header, do_compress=True) as writer:
                for block in blocks(scans):
                    writer.write_points(_records(block, header, content))
        except lazrs.LazrsError as error:
            raise output.error or error from None
        with temporary.open("rb+") as stream:
            # Day and year of creation, unknown: the same scans give the same bytes.
            stream.seek(90)
            stream.write(bytes(4))


def _name_coordinates(header: Any, crs: str) -> None:
    """State the coordinate reference system: WKT in its record, a mere name as the description of the area."""
    if _WKT.match(crs):
        header.vlrs.append(WktCoordinateSystemVlr(crs))
        header.global_encoding.wkt = True
    else:
        text = crs.encode()[:_LONGEST_RECORD]
        header.vlrs.append(laspy.VLR("LASF_Spec", 3, "coordinate reference system", text))


class _Output(io.BufferedWriter):
    """A file that remembers why it could not be written, which lazrs does not pass on."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            self.error = error
            raise

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self.error = error
            raise


def _records(block: Block, header: Any, content: Content) -> Any:
    records = laspy.ScaleAwarePointRecord.zeros(len(block.xyz), header=header)
    records.x, records.y, records.z = block.xyz.T
    records.return_number[:] = 1
    records.number_of_returns[:] = 1
    records.point_source_id[:] = min(block.station + 1, 65535)
    if content.intensity:
        records.intensity[:] = np.round(np.clip(block.intensity_or_zero(), 0.0, 1.0) * 65535.0)
    if content.color:
        red, green, blue = block.color_or_black().astype(np.uint16).T * np.uint16(257)
        records.red, records.green, records.blue = red, green, blue
    return records
