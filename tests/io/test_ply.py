from pathlib import Path

import numpy as np
import pytest
import trimesh

from trihedral.errors import InputError
from trihedral.io import read_headers, read_scan


def mesh() -> trimesh.Trimesh:
    shape = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    rng = np.random.default_rng(3)
    shape.visual.vertex_colors = rng.integers(0, 256, (len(shape.vertices), 4), dtype=np.uint8)
    return shape


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_mesh_of_another_writer(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "mesh.ply"
    truth = mesh()
    path.write_bytes(trimesh.exchange.ply.export_ply(truth, encoding=encoding))
    [header] = read_headers(path)
    assert (header.format, header.points, header.has_color) == ("ply", len(truth.vertices), True)
    scan = read_scan(header)
    np.testing.assert_allclose(scan.xyz, truth.vertices, atol=1e-6)
    np.testing.assert_array_equal(scan.color, truth.visual.vertex_colors[:, :3])


def test_big_endian_with_lists_before_and_within_the_points(tmp_path: Path) -> None:
    path = tmp_path / "big.ply"
    rng = np.random.default_rng(5)
    points = rng.normal(0, 3, (40, 3))
    body = bytearray()
    for size in (3, 0):
        body += np.array(size, ">u1").tobytes() + np.arange(size, dtype=">i4").tobytes()
    for index, point in enumerate(points):
        body += point[::-1].astype(">f8").tobytes()
        body += np.array(index % 4, ">u2").tobytes() + np.zeros(index % 4, ">f4").tobytes()
        body += np.array(index * 10, ">u2").tobytes()
    header = (
        "ply\r\nformat binary_big_endian 1.0\r\ncomment c\r\nelement face 2\r\n"
        "property list uchar int vertex_indices\r\nelement vertex 40\r\nproperty double z\r\n"
        "property double y\r\nproperty double x\r\nproperty list ushort float seen\r\n"
        "property ushort scalar_Intensity\r\nend_header\r\n"
    )
    path.write_bytes(header.encode() + body)
    scan = read_scan(read_headers(path)[0])
    np.testing.assert_allclose(scan.xyz, points, rtol=1e-6)
    np.testing.assert_allclose(scan.intensity, np.arange(40) / 39, atol=1e-6)
    path.write_bytes(header.encode() + body[:-5])
    with pytest.raises(InputError, match="ends within"):
        read_scan(read_headers(path)[0])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("ply\nformat ascii 1.0\nelement face 1\nproperty int a\nend_header\n1\n", "no element 'vertex'"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "no x, y and z"),
        ("ply\nformat ascii 1.0\nelement vertex 900000000\nproperty float x\nend_header\n1\n", "too short"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty flot x\nend_header\n1\n", "line 4"),
        ("ply\nformat ascii 1.0\nelement vertex 1\n", "within its PLY header"),
    ],
)
def test_bad_headers(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "bad.ply"
    path.write_text(text)
    with pytest.raises(InputError, match=reason):
        read_headers(path)
