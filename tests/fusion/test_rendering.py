"""Views of simulated rooms with closed forms: pixels, 3D points, edges, holes, gridded or not."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from trihedral.errors import InputError, OptionError
from trihedral.fusion.rendering import RenderingOptions, rendered_views
from trihedral.scan import Scan, ScanHeader

STEP = np.radians(0.3)
BOX = np.array([4.0, 3.0, 1.5])  # half sizes of a room, the scanner in its middle
OPTIONS = RenderingOptions(views=6)


def shade(points):
    """A pattern on the walls that is smooth at 0.2 degrees."""
    x, y, z = np.asarray(points, dtype=float).T
    return 120 + 60 * np.sin(4 * x + 1) * np.cos(3 * y) + 40 * np.sin(5 * z)


def scan_of(directions, row=None, column=None, origin=(0.0, 0.0, 0.0), local=(0.0, 0.0, 0.0), **values):
    with np.errstate(divide="ignore"):
        xyz = directions * np.min(BOX / np.abs(directions), axis=1)[:, None]
    grey = np.clip(shade(xyz), 0, 255).astype(np.uint8)
    header = ScanHeader(
        Path("room.e57"),
        0,
        "room",
        "e57",
        len(xyz),
        None,
        True,
        True,
        0,
        None,
        np.array(origin),
        True,
        "m",
        True,
    )
    stored = (xyz + np.array(origin) - np.array(local)).astype(np.float32)
    content = {"color": np.repeat(grey[:, None], 3, axis=1), "row": row, "column": column, **values}
    return Scan(header, stored, np.array(local), **content)


def grid(full=True, upside_down=False, clockwise=False):
    elevation = np.arange(np.radians(-60), np.radians(60), STEP)
    azimuth = np.arange(0, 2 * np.pi if full else np.radians(140), STEP)
    row, column = (k.ravel() for k in np.meshgrid(range(len(elevation)), range(len(azimuth)), indexing="ij"))
    e, a = elevation[row], azimuth[column]
    directions = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    if upside_down:
        row = row.max() - row
    if clockwise:
        column = column.max() - column
    return directions, row.astype(np.int32), column.astype(np.int32)


def check(view, offset=(0.0, 0.0, 0.0), loosest=0.02):
    """Each pixel shows the room where its own ray meets it, in place and in brightness."""
    size = len(view.edge)
    focal = size / 2 / np.tan(OPTIONS.field_of_view / 2)
    yaw = np.radians(float(view.name.split()[0]))
    across = (np.arange(size) - (size - 1) / 2) / focal
    right, down = (k.ravel() for k in np.meshgrid(across, across))
    rays = np.column_stack([np.cos(yaw) + right * np.sin(yaw), np.sin(yaw) - right * np.cos(yaw), -down])
    with np.errstate(divide="ignore"):
        true = rays * np.min(BOX / np.abs(rays), axis=1)[:, None]
    found = view.points.reshape(-1, 3) - np.array(offset)
    known = np.isfinite(found).all(axis=1) & ~view.edge.ravel()
    off = np.linalg.norm(found[known] - true[known], axis=1)
    assert np.percentile(off, 95) < loosest, np.percentile(off, [50, 95, 100])
    grey = view.image.reshape(len(true), -1)[:, 0].astype(float)[known]
    assert np.corrcoef(grey, shade(true[known]))[0, 1] > 0.98
    return known.mean()


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("clockwise", [False, True])
def test_a_gridded_scan_is_shown_ray_by_ray(upside_down, clockwise):
    views = rendered_views(scan_of(*grid(True, upside_down, clockwise)), OPTIONS)
    assert [view.name for view in views] == ["0 deg", "60 deg", "120 deg", "180 deg", "240 deg", "300 deg"]
    for view in views:
        assert check(view, loosest=0.002) > 0.97


def test_part_of_a_circle_gives_the_views_that_show_it():
    views = rendered_views(scan_of(*grid(full=False)), OPTIONS)
    assert [view.name for view in views] == ["0 deg", "60 deg", "120 deg"]
    shown = [check(view, loosest=0.002) for view in views]
    assert shown[1] > 0.97 and shown[0] < 0.6


def test_an_unordered_scan_is_shown_too():
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(500_000, 3))
    directions = directions[np.abs(directions[:, 2]) < 1.5 * np.linalg.norm(directions[:, :2], axis=1)]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    views = rendered_views(scan_of(directions), OPTIONS)
    assert len(views) == 6
    for view in views:
        # A cell holds a point anywhere in it: half a cell of 0.5 degrees at 4 m.
        assert check(view, loosest=0.04) > 0.8


def test_a_grid_that_is_not_one_of_angles_is_projected():
    directions, row, column = grid()
    tilt = np.radians(20)
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    for view in rendered_views(scan_of(directions @ turn.T, row, column), OPTIONS):
        check(view, loosest=0.03)


def test_the_scanner_may_stand_anywhere_in_its_coordinates():
    origin, local = np.array([500_010.0, 20.0, -3.0]), np.array([500_000.0, 0.0, 0.0])
    for view in rendered_views(scan_of(*grid(), origin=origin, local=local), OPTIONS):
        assert check(view, offset=origin - local, loosest=0.002) > 0.97


def test_depth_jumps_are_flagged_and_no_point_lies_between_the_surfaces():
    directions, row, column = grid()
    scan = scan_of(directions, row, column)
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    near = np.abs(azimuth) < np.radians(10)
    near &= np.abs(directions[:, 2]) < 0.2
    scan.xyz[near] /= 2
    view = rendered_views(scan, OPTIONS)[0]
    x = view.points[..., 0]
    known = np.isfinite(x)
    middle = known & (np.abs(view.points[..., 1]) < 0.9) & (np.abs(view.points[..., 2]) < 0.7)
    board, wall = np.abs(x - 2) < 0.01, np.abs(x - 4) < 0.01
    assert board.sum() > 1000
    assert (board | wall)[middle & ~view.edge].all()
    jump = board[:, 1:] != board[:, :-1]
    beside = view.edge[:, 1:] | view.edge[:, :-1]
    inner = middle[:, 1:] & middle[:, :-1]
    assert beside[jump & inner].all()


def test_small_holes_are_painted_but_have_no_points_and_large_ones_make_no_rim():
    directions, row, column = grid()
    lost = (np.random.default_rng(0).random(len(row)) < 0.1) | (
        (column > 70) & (column < 120) & (row > 170) & (row < 220)
    )
    whole = rendered_views(scan_of(directions, row, column), OPTIONS)
    holed = rendered_views(scan_of(directions[~lost], row[~lost], column[~lost]), OPTIONS)
    for one, two in zip(whole, holed, strict=True):
        known = np.isfinite(two.points[..., 0])
        assert known.mean() < 0.99
        inside = known[1:-1, 1:-1]
        difference = np.abs(one.image.astype(int) - two.image.astype(int))[1:-1, 1:-1, 0][inside]
        assert np.percentile(difference, 95) < 12


def test_intensity_looks_the_same_near_and_far():
    directions, row, column = grid()
    scan = scan_of(directions, row, column)
    reflectance = (shade(scan.xyz) / 255).astype(np.float32)
    fall_off = np.linalg.norm(scan.xyz, axis=1).astype(np.float32) ** -2
    views = [
        rendered_views(scan_of(directions, row, column, color=None, intensity=values), OPTIONS)
        for values in (reflectance * 0.5, reflectance * fall_off, reflectance * 0.004)
    ]
    for alike in zip(*views, strict=True):
        assert alike[0].image.ndim == 2 and alike[0].image.std() > 20
        for other in alike[1:]:
            assert np.corrcoef(alike[0].image.ravel(), other.image.ravel())[0, 1] > 0.9


def test_what_cannot_be_shown_is_said():
    directions, row, column = grid(full=False)
    bare = scan_of(directions, row, column, color=None)
    with pytest.raises(InputError, match=r"room\.e57.*neither colour nor intensity"):
        rendered_views(bare)
    with pytest.raises(InputError, match="no intensity"):
        rendered_views(scan_of(directions, row, column), RenderingOptions(paint="intensity"))
    with pytest.raises(InputError, match="no points"):
        rendered_views(scan_of(np.empty((0, 3))))


def test_a_handful_of_points_is_no_crash():
    rng = np.random.default_rng(0)
    for count in (1, 2, 30):
        directions = rng.normal(size=(count, 3))
        rendered_views(scan_of(directions / np.linalg.norm(directions, axis=1, keepdims=True)))
    one_row = grid()[0][:1200]
    column = np.arange(1200, dtype=np.int32)
    rendered_views(scan_of(one_row, np.zeros(1200, np.int32), column))


@pytest.mark.parametrize(
    "wrong",
    [
        {"views": 0},
        {"field_of_view": 3.2},
        {"paint": "depth"},
        {"most_pixels": 10},
        {"hole": -1},
        {"contrast_radius": 0},
    ],
)
def test_options_that_make_no_sense_are_refused(wrong):
    with pytest.raises(OptionError):
        RenderingOptions(**wrong)


@pytest.mark.parametrize("gridded", [True, False])
def test_points_without_colour_are_no_black_surface(gridded: bool) -> None:
    """Of a band about the horizon only the colour is known: beyond it the picture carries on, without a rim."""
    scan = scan_of(*grid()) if gridded else scan_of(grid()[0])
    elevation = np.arctan2(scan.xyz[:, 2], np.hypot(scan.xyz[:, 0], scan.xyz[:, 1]))
    known = np.abs(elevation) < np.radians(15)
    gaps = dataclasses.replace(scan, color=scan.color * known[:, None], colored=known)
    for whole, view in zip(rendered_views(scan, OPTIONS), rendered_views(gaps, OPTIONS), strict=True):
        rows = len(view.image)
        band = slice(round(0.35 * rows), round(0.65 * rows))
        np.testing.assert_allclose(view.image[band].astype(int), whole.image[band], atol=6)
        assert view.image.min() > 0.5 * whole.image[band].min()
        # Points are known where colours are not.
        np.testing.assert_array_equal(np.isfinite(view.points), np.isfinite(whole.points))
