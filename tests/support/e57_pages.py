"""An E57 file's pages and XML, taken apart and put together without the code under test."""

import struct
from pathlib import Path

PAGE, PAYLOAD = 1024, 1020

_TABLE = []
for _byte in range(256):
    for _ in range(8):
        _byte = (_byte >> 1) ^ (0x82F63B78 if _byte & 1 else 0)
    _TABLE.append(_byte)


def crc32c(data: bytes) -> int:
    """CRC-32C (RFC 3720, appendix B.4)."""
    value = 0xFFFFFFFF
    for byte in data:
        value = _TABLE[(value ^ byte) & 0xFF] ^ (value >> 8)
    return value ^ 0xFFFFFFFF


assert crc32c(b"123456789") == 0xE3069283


def pages(path: Path) -> list[bytes]:
    data = path.read_bytes()
    assert len(data) % PAGE == 0
    return [data[at : at + PAGE] for at in range(0, len(data), PAGE)]


def check_checksums(path: Path) -> None:
    for number, page in enumerate(pages(path)):
        assert page[PAYLOAD:] == struct.pack(">I", crc32c(page[:PAYLOAD])), f"page {number}"


def header(path: Path) -> tuple[int, int, int]:
    """Physical length, physical offset and logical length of the XML section."""
    mark, major, minor, length, offset, size, page = struct.unpack("<8sIIQQQQ", path.read_bytes()[:48])
    assert (mark, major, minor, page) == (b"ASTM-E57", 1, 0, PAGE)
    return length, offset, size


def content(path: Path) -> bytes:
    """All logical bytes."""
    return b"".join(page[:PAYLOAD] for page in pages(path))


def logical(physical: int) -> int:
    return physical // PAGE * PAYLOAD + physical % PAGE


def xml(path: Path) -> str:
    _, offset, size = header(path)
    return content(path)[logical(offset) : logical(offset) + size].decode()


def seal(data: bytes) -> bytes:
    """Cut logical bytes into pages with checksums."""
    data += bytes(-len(data) % PAYLOAD)
    parts = [data[at : at + PAYLOAD] for at in range(0, len(data), PAYLOAD)]
    return b"".join(part + struct.pack(">I", crc32c(part)) for part in parts)


def with_xml(path: Path, text: str, target: Path, *, before: bytes = b"", after: bytes = b"") -> Path:
    """Write the file's binary part with another XML text; `after` is data that follows it."""
    _, offset, _ = header(path)
    binary = content(path)[: logical(offset)] + before
    encoded = text.encode()
    start = len(binary)
    body = bytearray(binary + encoded + after)
    length = -(-len(body) // PAYLOAD) * PAGE
    body[16:40] = struct.pack("<QQQ", length, start // PAYLOAD * PAGE + start % PAYLOAD, len(encoded))
    target.write_bytes(seal(bytes(body)))
    return target
