"""Lifting on views whose surfaces have closed forms: planes, depth jumps, holes."""

import numpy as np
import pytest

from trihedral.initial.visual.lifting import lift
from trihedral.scan.view import View

FOCAL, WIDTH, HEIGHT = 200.0, 120, 90
NEAR, FAR = 2.0, 6.0


def rays(pixels):
    x, y = np.asarray(pixels, dtype=float).T
    return np.column_stack([(x - 60) / FOCAL, (y - 45) / FOCAL, np.ones(len(x))])


def on_plane(pixels, normal, distance):
    d = rays(pixels)
    return d * (distance / (d @ normal))[:, None]


def view(points, edge=None):
    shape = (HEIGHT, WIDTH)
    edge = np.zeros(shape, dtype=bool) if edge is None else edge
    return View("v", np.zeros(shape, np.uint8), points.reshape(HEIGHT, WIDTH, 3).astype(np.float32), edge)


@pytest.fixture
def pixel_grid():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.fixture
def step(pixel_grid):
    """A near board before a far wall: left of column 50 near; edges flagged on both sides of the jump."""
    depth = np.where(pixel_grid[:, 0] < 50, NEAR, FAR)
    edge = np.zeros((HEIGHT, WIDTH), dtype=bool)
    edge[:, 49:51] = True
    return rays(pixel_grid) * depth[:, None], edge


@pytest.mark.parametrize("normal", [(0, 0, 1.0), (0.6, 0, 0.8), (0.3, -0.8, 0.5)])
def test_points_of_a_plane_lie_where_the_ray_meets_it(pixel_grid, normal):
    places = np.random.default_rng(0).uniform((0, 0), (WIDTH - 1, HEIGHT - 1), (500, 2))
    found, footprint = lift(view(on_plane(pixel_grid, normal, 3.0)), places)
    true = on_plane(places, normal, 3.0)
    assert (np.linalg.norm(found - true, axis=1) < 0.02 * footprint).all()
    beside = on_plane(places + np.array([1, 0]), normal, 3.0)
    below = on_plane(places + np.array([0, 1]), normal, 3.0)
    expected = (np.linalg.norm(beside - true, axis=1) + np.linalg.norm(below - true, axis=1)) / 2
    assert np.allclose(footprint, expected, rtol=0.05)


def test_nothing_is_lifted_across_a_depth_edge(step):
    points, edge = step
    places = np.column_stack([np.linspace(45, 55, 101), np.full(101, 40.3)])
    found, footprint = lift(view(points, edge), places)
    known = np.isfinite(found).all(axis=1)
    assert (known == np.isfinite(footprint)).all()
    assert not known[(places[:, 0] > 48) & (places[:, 0] < 51)].any()
    assert known[(places[:, 0] < 47.99) | (places[:, 0] > 51.01)].all()
    # Never between the two surfaces.
    depth = found[known, 2]
    assert (np.isclose(depth, NEAR) | np.isclose(depth, FAR)).all()


def test_a_lone_corner_of_another_surface_is_noticed_without_a_flag(pixel_grid):
    points = (rays(pixel_grid) * 3.0).reshape(HEIGHT, WIDTH, 3)
    points[30, 40] *= 2
    found, _ = lift(view(points), [[39.5, 29.5], [40.5, 30.5], [42.5, 30.5]])
    assert np.isnan(found[:2]).all() and np.isfinite(found[2]).all()


def test_beside_a_hole_the_pixel_itself_is_taken(pixel_grid):
    points = (rays(pixel_grid) * 3.0).reshape(HEIGHT, WIDTH, 3)
    points[20, 21] = np.nan
    found, footprint = lift(view(points), [[20.3, 20.2], [20.9, 20.1], [21.0, 20.0]])
    assert np.allclose(found[0], points[20, 20], atol=1e-6)
    assert np.isnan(found[1:]).all()
    assert np.isfinite(footprint[0]) and np.isnan(footprint[1:]).all()


def test_a_pixel_alone_has_no_footprint_and_is_not_lifted(pixel_grid):
    points = np.full((HEIGHT, WIDTH, 3), np.nan)
    points[10, 10] = (0, 0, 3)
    found, footprint = lift(view(points), [[10, 10]])
    assert np.isnan(found).all() and np.isnan(footprint).all()


def test_outside_the_picture_nothing_is_known(pixel_grid):
    places = [[-1, 5], [5, -0.6], [WIDTH, 5], [5, HEIGHT - 0.4], [np.nan, 5]]
    found, _ = lift(view(rays(pixel_grid) * 3.0), places)
    assert np.isnan(found).all()
    rim, _ = lift(view(rays(pixel_grid) * 3.0), [[-0.4, 3], [WIDTH - 0.6, HEIGHT - 0.6]])
    assert np.isfinite(rim).all()


def test_no_places_are_no_points(pixel_grid):
    found, footprint = lift(view(rays(pixel_grid)), np.empty((0, 2)))
    assert found.shape == (0, 3) and footprint.shape == (0,)
