"""A prepared scan against the surfaces it was made from."""

from dataclasses import fields, replace

import numpy as np
import pytest

from support.room import HALF, off_wall, room_scan
from trihedral.errors import InputError
from trihedral.scan import Scan
from trihedral.scan.preparation import PrepareOptions, prepare
from trihedral.scan.prepared import Prepared
from trihedral.scan.surfels import faces_down


def test_surfels_lie_on_the_walls_and_face_the_scanner():
    prepared = prepare(room_scan())
    planar = prepared.surfels.planar
    assert planar.mean() > 0.9
    assert np.percentile(off_wall(prepared.surfels.points[planar]), 99) < 0.002
    assert np.median(off_wall(prepared.surfels.points[planar])) < 0.0007, (
        "a surfel's plane averages many points"
    )
    facing = np.einsum("ij,ij->i", prepared.surfels.points[planar], prepared.surfels.normals[planar])
    assert (facing < 0).all()
    assert np.allclose(np.linalg.norm(prepared.surfels.normals[planar], axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("with_grid", [True, False])
def test_far_surface_that_has_no_planes_is_left_as_thin_points_on_it(with_grid):
    passage = np.array([80.0, 1.53, 1.51])
    scan = room_scan(half=passage)
    prepared = prepare(scan if with_grid else replace(scan, row=None, column=None))
    thin = prepared.surfels.points[prepared.thin]
    assert len(thin) > 1000 and not (prepared.thin & prepared.surfels.planar).any()
    # Beams of 0.2 degrees are half a voxel apart there, or farther; nearer walls have planes.
    assert np.percentile(np.linalg.norm(thin, axis=1), 5) > 0.5 * prepared.surfels.spacing / np.radians(0.2)
    assert np.percentile(off_wall(thin, passage), 95) < 0.006, "single beams, 2 mm of noise each"
    assert len(prepared.surfel_map) == prepared.surfels.planar.sum(), "they are no surfels"


def test_a_room_without_far_surface_has_no_thin_points():
    assert not prepare(room_scan()).thin.any()


def test_noise_is_what_was_put_in():
    for noise in (0.001, 0.004):
        assert prepare(room_scan(noise)).noise.range_noise == pytest.approx(noise, rel=0.1)


def test_patches_are_the_six_walls():
    prepared = prepare(room_scan())
    x, y, z = 2 * HALF
    expected = sorted([x * y] * 2 + [x * z] * 2 + [y * z] * 2, reverse=True)
    large = prepared.patches.areas[:6]
    # The floor has a hole below the scanner: its beams start 60 degrees below the level.
    assert np.allclose(large[2:], expected[2:], rtol=0.15)
    assert np.allclose(np.abs(prepared.patches.normals[:6]).max(axis=1), 1, atol=1e-4)
    for index, normal in enumerate(prepared.patches.normals[:6]):
        distance = np.median(prepared.surfels.points[prepared.surfels.patch == index] @ normal)
        axis = np.argmax(np.abs(normal))
        assert distance == pytest.approx(-HALF[axis], abs=0.0005)


def test_large_coordinates_lose_nothing():
    near = prepare(room_scan())
    far = prepare(
        room_scan(origin=(2_600_000.25, 1_200_000.5, 500.0), local_origin=(2_600_000.0, 1_200_000.0, 500.0))
    )
    assert np.allclose(far.scanner_origin, (2_600_000.25, 1_200_000.5, 500.0), atol=1e-6)
    assert len(far.surfels.points) == pytest.approx(len(near.surfels.points), rel=0.01)
    assert np.percentile(off_wall(far.surfels.points[far.surfels.planar]), 99) < 0.002


def test_what_is_saved_comes_back(tmp_path):
    prepared = prepare(room_scan(step=0.5))
    path = tmp_path / "scan.npz"
    prepared.save(path)
    loaded = Prepared.load(path)
    for part in ("surfels", "patches", "free_space", "noise", "photometry", "sparse_planes"):
        for field in fields(getattr(prepared, part)):
            kept, again = (getattr(getattr(one, part), field.name) for one in (prepared, loaded))
            assert np.array_equal(kept, again, equal_nan=True), f"{part}.{field.name}"
    assert loaded.scanned_points == prepared.scanned_points


def test_a_damaged_file_is_refused(tmp_path):
    path = tmp_path / "scan.npz"
    prepare(room_scan(step=1.0)).save(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError):
        Prepared.load(path)


def test_a_scan_of_nothing_but_its_tripod_is_refused():
    scan = room_scan(step=1.0)
    tripod = Scan(scan.header, scan.xyz * np.float32(1e-3), scan.local_origin)
    with pytest.raises(InputError, match=r"point"):
        prepare(tripod)


def test_what_is_nearer_than_the_shortest_range_is_left_out():
    scan = room_scan(step=1.0)
    nearest = prepare(scan, PrepareOptions(shortest_range=2.0)).surfels.points
    assert np.linalg.norm(prepare(scan).surfels.points, axis=1).min() < 1.8
    # A surfel is the mean of its points, on the plane of its neighbours too.
    assert np.linalg.norm(nearest, axis=1).min() > 1.95


def test_colour_is_unknown_where_no_point_has_one():
    scan = room_scan(step=0.5)
    left = scan.xyz[:, 1] > 0.0
    # A pattern: one colour everywhere tells nothing, and is not kept.
    light = (np.floor(scan.xyz[:, 0]) + np.floor(scan.xyz[:, 2])) % 2 == 0
    color = np.where(light[:, None], np.uint8([200, 100, 50]), np.uint8([20, 10, 5])) * left[:, None]
    found = prepare(replace(scan, color=color, colored=left))
    side = found.surfels.points[:, 1]
    known = np.isfinite(found.surfels.color).all(axis=1)
    assert known[side > 0.1].all() and not known[side < -0.1].any()
    np.testing.assert_allclose(
        found.surfels.color[known] / found.surfels.color[known][:, :1],
        [[1.0, 0.5, 0.25]] * known.sum(),
        atol=1e-6,
    )
    assert found.surfels.color[known].max() == pytest.approx(200 / 255)


@pytest.mark.parametrize("with_grid", [True, False])
def test_surfels_stand_for_all_of_the_surface_however_thinly_it_was_seen(with_grid):
    passage = np.array([30.0, 1.53, 1.51])
    scan = room_scan(half=passage)
    prepared = prepare(scan if with_grid else replace(scan, row=None, column=None))
    planar = prepared.surfels.planar
    points = prepared.surfels.points[planar]
    areas = prepared.surfels.areas(prepared.noise.angular_step)[planar]
    for low, high in ((2.0, 5.0), (10.0, 16.0)):
        # One wall along the passage, from so far to so far, as high as the passage.
        wall = (np.abs(points[:, 1] - passage[1]) < 0.02) & (points[:, 0] > low) & (points[:, 0] < high)
        assert areas[wall].sum() == pytest.approx((high - low) * 2 * passage[2], rel=0.2)


def test_in_a_scan_thinned_in_space_a_surfel_stands_for_a_face_of_its_voxel():
    scan = room_scan()
    _, kept = np.unique(np.floor(scan.xyz / 0.04).astype(int), axis=0, return_index=True)
    prepared = prepare(replace(scan, xyz=scan.xyz[kept], row=None, column=None))
    assert prepared.surfels.areas(prepared.noise.angular_step) == pytest.approx(prepared.surfels.spacing**2)


@pytest.mark.parametrize("wrong", ["shuffled", "counted"])
def test_a_grid_that_is_none_is_left_out_and_said(wrong):
    scan = room_scan()
    count = np.arange(len(scan))
    rows = {"shuffled": np.random.default_rng(1).permutation(scan.row), "counted": count // 517}[wrong]
    columns = {"shuffled": scan.column, "counted": count % 517}[wrong]
    off = replace(scan, row=rows.astype(np.int32), column=columns.astype(np.int32))
    without = prepare(replace(scan, row=None, column=None))
    prepared = prepare(off)
    assert np.array_equal(prepared.surfels.points, without.surfels.points)
    assert prepared.noise.range_noise == pytest.approx(0.002, rel=0.2)
    assert any("rows and columns" in note for note in prepared.notes)
    assert not any("rows and columns" in note for note in prepare(scan).notes)


def test_without_a_grid_noise_and_step_are_those_of_the_grid():
    scan = room_scan(0.003)
    order = np.random.default_rng(2).permutation(len(scan))
    gridless = replace(
        scan, xyz=scan.xyz[order], row=None, column=None, intensity=None, color=None, colored=None
    )
    on_grid, by_direction = prepare(scan).noise, prepare(gridless).noise
    assert by_direction.range_noise == pytest.approx(0.003, rel=0.15)
    assert by_direction.angular_step == pytest.approx(on_grid.angular_step, rel=0.1)


def test_ground_with_normals_of_noise_is_no_ceiling():
    rng = np.random.default_rng(3)
    spread = rng.uniform(-1, 1, (1000, 2)) * 30
    ground = np.column_stack([spread, np.full(1000, -1.7)]).astype(np.float32)
    ceiling = np.column_stack([spread / 10, np.full(1000, 1.1)]).astype(np.float32)
    down = np.tile(np.float32([0, 0, -1]), (1000, 1))
    assert not faces_down(ground, down, np.array([0, 0, 1])).any()
    assert faces_down(ceiling, down, np.array([0, 0, 1])).all()
