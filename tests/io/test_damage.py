"""Damaged files of every format: an `InputError` that names the file, or points that are whole. Never anything else."""

from pathlib import Path

import laspy
import numpy as np
import pytest
import trimesh
from pypcd4 import Encoding, PointCloud

from trihedral.errors import InputError
from trihedral.io import ReadOptions, read_headers, read_scan

OPTIONS = ReadOptions(units="m", scanner_origin=(0.0, 0.0, 0.0))


def sample(kind: str, folder: Path) -> bytes:
    rng = np.random.default_rng(6)
    xyz = rng.normal(0, 5, (60, 3)).round(2)
    path = folder / "sample"
    rows = "\n".join(f"{x} {y} {z} 0.5 1 2 3" for x, y, z in xyz) + "\n"
    unit = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    if kind in ("las", "laz"):
        las = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
        las.header.scales = [0.001] * 3
        las.x, las.y, las.z = xyz.T
        las.write(path.with_suffix(f".{kind}"))
        return path.with_suffix(f".{kind}").read_bytes()
    if kind.startswith("pcd"):
        PointCloud.from_xyz_points(xyz.round().astype(np.float32)).save(path, encoding=Encoding(kind[4:]))
        assert f"DATA {kind[4:]}\n".encode() in path.read_bytes()
        return path.read_bytes()
    if kind.startswith("ply"):
        mesh = trimesh.creation.icosphere(subdivisions=1)
        return bytes(trimesh.exchange.ply.export_ply(mesh, encoding=kind[4:]))
    return {"xyz": rows, "pts": f"60\n{rows}", "ptx": f"6\n10\n{unit}{rows}"}[kind].encode()


KINDS = ["xyz", "pts", "ptx", "las", "laz", "ply-ascii", "ply-binary"]
KINDS += ["pcd-ascii", "pcd-binary", "pcd-binary_compressed"]


@pytest.mark.parametrize("kind", KINDS)
def test_damage(tmp_path: Path, kind: str) -> None:
    whole = sample(kind, tmp_path)
    path = tmp_path / "damaged.bin"
    path.write_bytes(whole)
    assert len(read_scan(read_headers(path, OPTIONS)[0], OPTIONS)) > 40
    rng = np.random.default_rng(7)
    refused = 0
    for round_ in range(150):
        data = bytearray(whole)
        # Half of the blows fall on the head, where the counts are.
        reach = min(300, len(data)) if round_ % 2 else len(data)
        for at in rng.integers(0, reach, rng.integers(1, 5)):
            data[at] = rng.integers(0, 256)
        if round_ % 5 == 0:
            data = data[: rng.integers(0, len(data))]
        path.write_bytes(data)
        try:
            for header in read_headers(path, OPTIONS):
                scan = read_scan(header, OPTIONS)
                assert np.isfinite(scan.xyz).all() and np.isfinite(scan.local_origin).all()
                for values in (scan.intensity, scan.color, scan.row, scan.column):
                    assert values is None or len(values) == len(scan)
        except InputError as error:
            assert "damaged.bin" in str(error)
            refused += 1
    assert refused > 20
