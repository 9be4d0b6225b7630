from pathlib import Path

import numpy as np
import pytest

from trihedral.errors import InputError
from trihedral.io import ReadOptions, read_headers, read_scan


def write_ptx(path: Path, pose: np.ndarray, grid: np.ndarray) -> None:
    """A grid of rows x columns x values, as the format's description has it."""
    rotation, translation = pose[:3, :3], pose[:3, 3]
    rows, columns = grid.shape[:2]
    lines = [str(columns), str(rows), " ".join(map(str, translation))]
    lines += [" ".join(map(str, axis)) for axis in rotation.T]
    lines += [" ".join(map(str, row)) for row in pose.T]
    for column in range(columns):
        for row in range(rows):
            lines.append(" ".join(f"{value:.6g}" for value in grid[row, column]))
    with path.open("a", encoding="utf-8") as stream:
        stream.write("\n".join(lines) + "\n")


def rigid(angle: float, translation: tuple[float, float, float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose[:3, 3] = translation
    return pose


def test_two_scans_with_poses_and_missing_returns(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "site.ptx"
    first = rng.uniform(-9, 9, (4, 5, 4)).round(3)
    first[..., 3] = 0.25
    first[1, 2] = [0, 0, 0, 0.5]
    second = np.concatenate([rng.uniform(-9, 9, (3, 2, 4)).round(3), np.full((3, 2, 3), 7)], axis=2)
    second[..., 3] = 1
    poses = [rigid(0.3, (10, -20, 1.5)), rigid(-2.0, (0, 3, 0))]
    write_ptx(path, poses[0], first)
    write_ptx(path, poses[1], second)
    headers = read_headers(path)
    assert [header.name for header in headers] == ["site-1", "site-2"]
    assert [header.grid for header in headers] == [(4, 5), (3, 2)]
    assert [header.has_color for header in headers] == [False, True]
    for header, pose in zip(headers, poses, strict=True):
        assert header.origin_stated and header.units_stated
        np.testing.assert_allclose(header.file_pose, pose, atol=1e-9)
    scan = read_scan(headers[0])
    assert len(scan) == 19
    np.testing.assert_allclose(scan.xyz, first[scan.row, scan.column, :3], rtol=1e-6)
    assert (1, 2) not in set(zip(scan.row.tolist(), scan.column.tolist(), strict=True))
    scan = read_scan(headers[1])
    np.testing.assert_allclose(scan.xyz, second[scan.row, scan.column, :3], rtol=1e-6)
    assert (scan.color == 7).all()


def test_the_matrix_agrees_with_position_and_axes_of_a_real_file(shared: Path) -> None:
    [header] = read_headers(shared / "data/formats/ptx/complex-transform.ptx")
    np.testing.assert_allclose(header.file_pose[:3, 3], [-3.028748, -3.819741, -1.384333])
    np.testing.assert_allclose(header.file_pose[:3, 0], [0.999979, -0.003604, -0.005365], atol=2e-6)
    scan = read_scan(header)
    assert header.points == 12 and len(scan) == 4


def test_real_files_read_or_say_what_is_missing(shared: Path) -> None:
    folder = shared / "data/formats/ptx"
    colored = folder / "1.2-with-color.ptx"
    with pytest.raises(InputError, match="--scanner-origin"):
        read_scan(read_headers(colored)[0])
    table = np.loadtxt(colored, skiprows=10)
    options = ReadOptions(units="m", scanner_origin=tuple(table[:, :3].mean(axis=0)))
    scan = read_scan(read_headers(colored, options)[0], options)
    np.testing.assert_allclose(scan.xyz + scan.local_origin, table[:, :3], atol=2e-4)
    np.testing.assert_array_equal(scan.color, table[:, 4:])
    with pytest.raises(InputError, match=r"ripple\.ptx, line 10: .*4444 columns of 10014"):
        read_headers(folder / "ripple.ptx")
    stretched, plain = read_headers(folder / "multiple-and-transform.ptx")
    assert stretched.file_pose is None and any("rigid" in note for note in stretched.notes)
    np.testing.assert_array_equal(plain.file_pose, np.eye(4))


@pytest.mark.parametrize("cut", [0.3, 0.6, 0.95])
def test_a_cut_file_is_refused(tmp_path: Path, cut: float) -> None:
    path = tmp_path / "cut.ptx"
    write_ptx(path, np.eye(4), np.ones((20, 30, 4)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * cut)])
    with pytest.raises(InputError, match=r"cut\.ptx, line \d+"):
        read_headers(path)


def test_units_scale_points_and_pose(tmp_path: Path) -> None:
    path = tmp_path / "mm.ptx"
    grid = np.full((2, 2, 4), 2500.0)
    write_ptx(path, rigid(0.0, (4000, 0, 0)), grid)
    with pytest.raises(InputError, match="--units"):
        read_scan(read_headers(path)[0])
    options = ReadOptions(units="mm")
    [header] = read_headers(path, options)
    assert header.file_pose[0, 3] == 4.0
    assert (read_scan(header, options).xyz == 2.5).all()
