"""What is written, read back by programs that are not ours."""

import resource
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
import trimesh
from pypcd4 import PointCloud
from scipy.spatial.transform import Rotation

from trihedral.errors import OutputError
from trihedral.io import las, pcd, ply, ptx, read_headers, read_scan
from trihedral.io.writers import Content, PlacedScan
from trihedral.scan import Scan, ScanHeader


def scan(count: int, seed: int, *, grid: tuple[int, int] | None = None, origin: float = 0.0) -> Scan:
    rng = np.random.default_rng(seed)
    cells = np.arange(count) if grid is None else np.sort(rng.choice(grid[0] * grid[1], count, replace=False))
    header = ScanHeader(
        source=Path(f"s{seed}.e57"),
        scan_index=0,
        name=f"s{seed}",
        format="e57",
        points=count,
        grid=grid,
        has_color=True,
        has_intensity=True,
        photos=0,
        file_pose=None,
        scanner_origin=np.zeros(3),
        origin_stated=True,
        units="m",
        units_stated=True,
    )
    return Scan(
        header,
        rng.normal(0, 10, (count, 3)).astype(np.float32),
        np.full(3, origin),
        intensity=rng.uniform(0, 1, count).astype(np.float32),
        color=rng.integers(0, 256, (count, 3), dtype=np.uint8),
        row=None if grid is None else (cells % grid[0]).astype(np.int32),
        column=None if grid is None else (cells // grid[0]).astype(np.int32),
    )


def pose(seed: int, far: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(rng.normal(0, 1, 3)).as_matrix()
    out[:3, 3] = rng.normal(0, 20, 3) + far
    return out


PLACED = [PlacedScan("a", scan(700, 1), pose(1)), PlacedScan("b", scan(300, 2, origin=3000.0), pose(2))]
FAR = [PlacedScan("a", scan(700, 1), pose(1, 500_000.0)), PlacedScan("b", scan(300, 2), pose(2, 500_000.0))]


def truth(placed: list[PlacedScan]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    xyz = [
        (p.pose[:3, :3] @ (p.scan.xyz.astype(np.float64) + p.scan.local_origin).T).T + p.pose[:3, 3]
        for p in placed
    ]
    return (
        np.concatenate(xyz),
        np.concatenate([p.scan.intensity for p in placed]),
        np.concatenate([p.scan.color for p in placed]),
    )


def content(placed: list[PlacedScan]) -> Content:
    scanners = tuple(p.pose[:3, 3] for p in placed)
    return Content(sum(len(p.scan) for p in placed), True, True, scanners)


@pytest.mark.parametrize("placed", [PLACED, FAR], ids=["near", "far"])
def test_laz_by_laspy(tmp_path: Path, placed: list[PlacedScan]) -> None:
    path = tmp_path / "out.laz"
    las.write(path, iter(placed), content(placed))
    found = laspy.read(path)
    xyz, intensity, color = truth(placed)
    assert found.header.are_points_compressed
    np.testing.assert_allclose(found.xyz, xyz, atol=5.1e-5)
    np.testing.assert_allclose(found.intensity / 65535.0, intensity, atol=1e-5)
    np.testing.assert_array_equal(
        np.stack([found.red, found.green, found.blue], axis=1), color * np.uint16(257)
    )
    assert found.point_source_id.tolist() == [1] * 700 + [2] * 300
    np.testing.assert_allclose(found.header.mins, xyz.min(axis=0), atol=5.1e-5)


@pytest.mark.parametrize("crs", ['PROJCS["ETRS89 / UTM zone 32N",UNIT["metre",1]]', "EPSG:25832"])
def test_laz_names_its_reference_system(tmp_path: Path, crs: str) -> None:
    las.write(tmp_path / "all.laz", iter(PLACED), replace(content(PLACED), crs=crs))
    header = laspy.read(tmp_path / "all.laz").header
    if crs.startswith("PROJCS"):
        assert header.global_encoding.wkt
        assert header.vlrs.get("WktCoordinateSystemVlr")[0].string == crs
    else:
        (record,) = header.vlrs.get_by_id("LASF_Spec", (3,))
        assert record.record_data_bytes() == crs.encode()


@pytest.mark.parametrize("placed", [PLACED, FAR], ids=["near", "far"])
def test_ply_by_trimesh(tmp_path: Path, placed: list[PlacedScan]) -> None:
    path = tmp_path / "out.ply"
    ply.write(path, iter(placed), content(placed))
    found = trimesh.load(path, process=False)
    xyz, _, color = truth(placed)
    np.testing.assert_allclose(found.vertices, xyz, rtol=1e-14)
    np.testing.assert_array_equal(found.colors[:, :3], color)


@pytest.mark.parametrize(("placed", "atol"), [(PLACED, 2e-4), (FAR, 1e-9)], ids=["near", "far"])
def test_pcd_by_pypcd4(tmp_path: Path, placed: list[PlacedScan], atol: float) -> None:
    path = tmp_path / "out.pcd"
    pcd.write(path, iter(placed), content(placed))
    found = PointCloud.from_path(path)
    xyz, intensity, color = truth(placed)
    np.testing.assert_allclose(found.numpy(("x", "y", "z")), xyz, atol=atol)
    np.testing.assert_allclose(found.numpy(("intensity",))[:, 0], intensity)
    np.testing.assert_array_equal(PointCloud.decode_rgb(found.pc_data["rgb"]), color)


def test_pcd_of_one_scan_says_where_the_scanner_is(tmp_path: Path) -> None:
    path = tmp_path / "out.pcd"
    pcd.write(path, iter(PLACED[:1]), content(PLACED[:1]))
    np.testing.assert_allclose(
        PointCloud.from_path(path).metadata.viewpoint[:3], PLACED[0].pose[:3, 3], rtol=1e-6
    )


def test_ptx_keeps_the_grid_and_the_frame(tmp_path: Path) -> None:
    path = tmp_path / "out.ptx"
    placed = [
        PlacedScan("a", scan(700, 1, grid=(30, 40)), pose(1, 1000.0)),
        PlacedScan("b", scan(300, 2), pose(2)),
    ]
    ptx.write(path, iter(placed), content(placed))
    lines = path.read_text().splitlines()
    assert lines[:2] == ["40", "30"]
    matrix = np.array([line.split() for line in lines[6:10]], dtype=float)
    np.testing.assert_allclose(matrix.T, placed[0].pose, atol=1e-9)
    np.testing.assert_allclose(np.array(lines[3].split(), dtype=float), placed[0].pose[:3, 0], atol=1e-9)
    table = np.array([line.split() for line in lines[10 : 10 + 1200]], dtype=float)
    returned = table[:, :3].any(axis=1)
    cells = placed[0].scan.column * 30 + placed[0].scan.row
    np.testing.assert_array_equal(np.flatnonzero(returned), cells)
    np.testing.assert_allclose(table[returned, :3], placed[0].scan.xyz, atol=5.1e-7)
    np.testing.assert_array_equal(table[returned, 4:], placed[0].scan.color)
    assert lines[1210:1212] == ["1", "300"]
    headers = read_headers(path)
    np.testing.assert_allclose(headers[1].file_pose, placed[1].pose, atol=1e-9)
    np.testing.assert_allclose(read_scan(headers[1]).xyz, placed[1].scan.xyz, atol=1e-6)


def test_the_same_scans_give_the_same_bytes(tmp_path: Path) -> None:
    for module in (las, ply, pcd, ptx):
        one, two = tmp_path / f"one{module.__name__}", tmp_path / f"two{module.__name__}"
        module.write(one, iter(PLACED), content(PLACED))
        module.write(two, iter(PLACED), content(PLACED))
        assert one.read_bytes() == two.read_bytes()


def test_scans_are_taken_one_at_a_time(tmp_path: Path) -> None:
    import weakref

    alive: list[weakref.ref[Scan]] = []

    def scans() -> Iterator[PlacedScan]:
        for seed in range(4):
            assert sum(ref() is not None for ref in alive) <= 1
            one = scan(50, seed)
            alive.append(weakref.ref(one))
            yield PlacedScan("s", one, np.eye(4))
            del one

    for module in (las, ply, pcd, ptx):
        alive.clear()
        module.write(tmp_path / module.__name__, scans(), Content(200, True, True, (np.zeros(3),) * 4))


@pytest.mark.parametrize("module", ["las", "ply", "pcd", "ptx"])
def test_a_full_disk_leaves_nothing(tmp_path: Path, module: str) -> None:
    script = f"""
        import numpy as np, sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from pathlib import Path
        from test_writers import PlacedScan, content, scan
        from trihedral.errors import OutputError
        from trihedral.io import {module}
        placed = [PlacedScan("a", scan(100_000, 1), np.eye(4))]
        try:
            {module}.write(Path({str(tmp_path / "out")!r}), iter(placed), content(placed))
        except OutputError as error:
            print(error)
    """

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)],
        capture_output=True,
        text=True,
        preexec_fn=limit,
        check=True,
    )
    assert done.stdout.startswith(f"Cannot write {tmp_path / 'out'}: ")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    for module in (las, ply, pcd, ptx):
        with pytest.raises(OutputError, match="missing"):
            module.write(tmp_path / "missing" / "out", iter(PLACED), content(PLACED))
