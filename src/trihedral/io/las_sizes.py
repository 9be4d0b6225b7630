"""Sizes and counts that a LAS or LAZ file states, held against the file before a decoder believes them.

Formats: ASPRS LAS 1.4 R15; LASzip, whose record and chunks are as in M. Isenburg, LASzip: lossless compression of LiDAR
data (2013), and its code. A decoder that is told of a chunk larger than memory ends the process.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import lazrs

from trihedral.errors import InputError
from trihedral.guarded import allowed_memory, open_input

_RECORD_HEADER, _EXTENDED_HEADER = 54, 60
_LASZIP = (b"laszip encoded", 22204)
# Kinds of compression: chunks of points, and chunks of layers.
_CHUNKED, _LAYERED = 2, 3
# Layers of the items of layered chunks; of extra bytes one each.
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES = 14
# Chunk size of files whose chunks say their sizes themselves.
_VARIABLE = 0xFFFFFFFF
# What a point takes while it is read: coordinates, intensity, colour, and its share of the block in hand.
_BYTES_PER_POINT = 30


@dataclass(frozen=True)
class _Head:
    """What the public header block says."""

    path: Path
    size: int  # of the file
    points: int
    record: int  # bytes of a point
    points_at: int
    records_at: int  # variable length ones
    records: int
    extended_at: int
    extended: int
    returns: int  # points by number of return, all together
    compressed: bool

    def error(self, reason: str, byte: int) -> InputError:
        return InputError(self.path, reason, place=f"byte {byte}")


def check_sizes(path: Path) -> list[str]:
    """Raise `InputError` unless what the header states fits into the file; notes on what it leaves out."""
    with open_input(path) as stream:
        head = _head(path, stream)
        laszip = _records(head, stream)
        _extended_records(head, stream)
        if not head.compressed:
            held = _uncompressed(head)
        elif laszip is None:
            raise head.error("it is compressed, but has no record that says how", head.records_at)
        else:
            held = max(_compressed(head, stream, laszip), head.returns)
    if head.points * _BYTES_PER_POINT > allowed_memory(head.size):
        raise head.error(
            f"it says that {head.size:,} bytes hold {head.points:,} points: no scan is so dense", 107
        )
    if held <= head.points:
        return []
    return [f"the file holds {held:,} points, its header says {head.points:,}: the others are not read"]


def _head(path: Path, stream: BinaryIO) -> _Head:
    size = stream.seek(0, 2)
    stream.seek(0)
    head = stream.read(375)
    if len(head) < 227:
        raise InputError(path, "the file ends within its LAS header", place=f"byte {len(head)}")
    header_size, points_at, records = struct.unpack_from("<HII", head, 94)
    kind, record = struct.unpack_from("<BH", head, 104)
    points = struct.unpack_from("<I", head, 107)[0]
    returns = sum(struct.unpack_from("<5I", head, 111))
    extended_at = extended = 0
    if (head[24], head[25]) >= (1, 4) and len(head) == 375:
        extended_at, extended, wide = struct.unpack_from("<QIQ", head, 235)
        points = wide or points
        returns = max(returns, sum(struct.unpack_from("<15Q", head, 255)))
    if not 227 <= header_size <= points_at <= size or records * _RECORD_HEADER > points_at - header_size:
        raise InputError(
            path,
            f"its LAS header does not fit the file: header of {header_size} bytes, {records} records, "
            f"points from byte {points_at}, file of {size} bytes",
            place="byte 94",
        )
    if record == 0:
        raise InputError(path, "its points have no bytes", place="byte 105")
    return _Head(
        path,
        size,
        points,
        record,
        points_at,
        header_size,
        records,
        extended_at,
        extended,
        returns,
        bool(kind & 0x80),
    )


def _records(head: _Head, stream: BinaryIO) -> bytes | None:
    """Walk over the records before the points; LASzip's, if there is one."""
    at, laszip = head.records_at, None
    for _ in range(head.records):
        stream.seek(at)
        _, user, number, length = struct.unpack_from("<H16sHH", stream.read(_RECORD_HEADER))
        if at + _RECORD_HEADER + length > head.points_at:
            raise head.error("one of its records reaches into the points", at)
        if (user.rstrip(b"\0"), number) == _LASZIP:
            laszip = stream.read(length)
        at += _RECORD_HEADER + length
    return laszip


def _extended_records(head: _Head, stream: BinaryIO) -> None:
    at = head.extended_at
    for _ in range(head.extended):
        if at + _EXTENDED_HEADER <= head.size:
            stream.seek(at)
            length = struct.unpack_from("<Q", stream.read(_EXTENDED_HEADER), 20)[0]
        else:
            length = 0
        if at + _EXTENDED_HEADER + length > head.size:
            raise head.error("its extended records lie beyond the end of the file", 235)
        at += _EXTENDED_HEADER + length


def _uncompressed(head: _Head) -> int:
    """Points that the file has room for."""
    end = head.extended_at if head.extended and head.extended_at >= head.points_at else head.size
    room = (end - head.points_at) // head.record
    if head.points > room:
        raise head.error(
            f"the header says {head.points} points of {head.record} bytes, the file has room for {room}", 107
        )
    return room


def _compressed(head: _Head, stream: BinaryIO, laszip: bytes) -> int:
    """Points that the chunks hold, as far as they say."""
    if len(laszip) < 34:
        raise head.error("its record of the compression is too short", head.records_at)
    kind, chunk_size, count = struct.unpack_from("<H10xI16xH", laszip)
    if len(laszip) < 34 + 6 * count:
        raise head.error("its record of the compression is cut short", head.records_at)
    items = [struct.unpack_from("<HH", laszip, 34 + 6 * item) for item in range(count)]
    if sum(size for _, size in items) != head.record:
        raise head.error("its record of the compression is of points of another size", head.records_at)
    if kind not in (_CHUNKED, _LAYERED):
        raise head.error(f"it is compressed in the unknown way {kind}", head.records_at)
    # Where all chunks are one, memory is set aside for a whole one.
    if chunk_size == 0 or (chunk_size != _VARIABLE and chunk_size * head.record > allowed_memory(head.size)):
        raise head.error(f"its chunks of {chunk_size:,} points are implausible", head.records_at)
    table_at = _table_at(head, stream)
    stream.seek(head.points_at)
    table: list[tuple[int, int]] = lazrs.read_chunk_table(stream, lazrs.LazVlr(laszip))
    at = head.points_at + 8
    if sum(size for _, size in table) != table_at - at:
        raise head.error("its table of chunks does not fit the file", table_at)
    if kind == _LAYERED:
        layers = sum(size if item == _EXTRA_BYTES else _LAYERS.get(item, 0) for item, size in items)
        held = 0
        for _, size in table:
            held += _layered_chunk(head, stream, at, size, layers)
            at += size
    elif chunk_size == _VARIABLE:
        held = sum(points for points, _ in table)
    else:
        held = (len(table) - 1) * chunk_size + 1 if table else 0
        if len(table) * chunk_size < head.points:
            raise head.error(
                f"its {len(table)} chunks do not hold the {head.points} points that it says", table_at
            )
        return held
    if held < head.points:
        raise head.error(f"its chunks hold {held} of the {head.points} points that it says", table_at)
    return held


def _table_at(head: _Head, stream: BinaryIO) -> int:
    """Find the table of chunks, and hold their number against the file."""
    stream.seek(head.points_at)
    start = stream.read(8)
    table_at = struct.unpack("<q", start)[0] if len(start) == 8 else 0
    if table_at == -1:
        # A writer that could not go back left the place at the end.
        stream.seek(head.size - 8)
        table_at = struct.unpack("<q", stream.read(8))[0]
    if not head.points_at + 8 <= table_at <= head.size - 8:
        raise head.error("its table of chunks is missing: the file is cut short", head.points_at)
    stream.seek(table_at)
    _, chunks = struct.unpack("<II", stream.read(8))
    if chunks > table_at - head.points_at:
        raise head.error(f"its table has {chunks} chunks, too many for the file", table_at)
    return int(table_at)


def _layered_chunk(head: _Head, stream: BinaryIO, at: int, size: int, layers: int) -> int:
    """Points of a chunk, whose layers must fill it: a point as it is, the number of points, the layers' sizes."""
    fixed = head.record + 4 + 4 * layers
    stream.seek(at + head.record)
    sizes = stream.read(4 + 4 * layers)
    if size < fixed or len(sizes) < 4 + 4 * layers:
        raise head.error("a chunk is shorter than its own description", at)
    points, *each = struct.unpack(f"<{1 + layers}I", sizes)
    if fixed + sum(each) != size:
        raise head.error("the layers of a chunk do not fit it", at)
    return int(points)
