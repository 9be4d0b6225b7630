"""The arithmetic that errors, normalised errors and Cramer-Rao bounds are told with."""

import numpy as np
import pytest
from benchmarks.bound import CELL, Cells, centres, information, least, packed, parallel
from benchmarks.truth import CHI_SQUARE_MEDIAN, apart, left_error, normalised_square
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import motion

RNG = np.random.default_rng(3)


def pose(turn: tuple[float, float, float], shift: tuple[float, float, float]) -> np.ndarray:
    return motion(Rotation.from_rotvec(turn).as_matrix(), np.array(shift))


def test_error_is_what_was_put_in() -> None:
    true = pose((0.1, -0.2, 2.9), (5.0, -3.0, 0.4))
    xi = np.array([1e-4, -2e-4, 3e-4, 0.001, -0.002, 0.003])
    found = np.linalg.inv(pose(tuple(xi[:3]), tuple(xi[3:]))) @ true
    assert left_error(true, found) == pytest.approx(xi, abs=1e-12)
    error = apart(true, found)
    assert error.deg == pytest.approx(np.degrees(np.linalg.norm(xi[:3])), rel=1e-6)
    assert error.mm == pytest.approx(1e3 * np.linalg.norm((found - true)[:3, 3]), rel=1e-9)


def test_median_of_normalised_squares_is_that_of_chi_square() -> None:
    root = RNG.normal(size=(6, 6))
    covariance = root @ root.T
    draws = RNG.multivariate_normal(np.zeros(6), covariance, 20_000)
    squares = [normalised_square(draw, covariance) for draw in draws]
    assert np.median(squares) == pytest.approx(CHI_SQUARE_MEDIAN, rel=0.02)


def test_parallel_information_is_that_of_the_difference() -> None:
    a, b = (m @ m.transpose(0, 2, 1) for m in RNG.normal(size=(2, 5, 3, 3)))
    expected = np.linalg.inv(np.linalg.inv(a) + np.linalg.inv(b))
    assert parallel(a, b) == pytest.approx(expected, rel=1e-6)
    # One point knows no slope, so nothing is known of a difference of slopes.
    point = np.zeros((1, 3, 3))
    point[0, 0, 0] = 4.0
    assert parallel(point, b[:1])[0, 1:, 1:] == pytest.approx(np.zeros((2, 2)), abs=1e-9)


def test_cells_come_out_of_their_keys() -> None:
    cell = np.array([[-3, 4, 0], [700, -801, 5]])
    assert centres(packed(np.array([9, 12345]), cell)) == pytest.approx((cell + 0.5) * CELL)


def test_bound_is_what_least_squares_reaches() -> None:
    """Points on the walls of a room, measured twice with noise: a fit that knows which wall is which."""
    sigma_a, sigma_b, runs = 0.002, 0.003, 400
    normals = np.repeat(np.vstack([np.eye(3), -np.eye(3)]), 60, axis=0)
    spread = RNG.integers(-4, 4, size=(len(normals), 3))
    flat = np.abs(normals) > 0
    cell = np.where(flat, (3 * normals).astype(int), spread)
    cell, first = np.unique(cell, axis=0, return_index=True)
    normals = normals[first]
    keys = packed(np.zeros(len(cell), dtype=np.int64), cell)
    order = np.argsort(keys)
    keys, normals = keys[order], normals[order]

    def seen(sigma: float) -> Cells:
        weight = np.full(len(keys), sigma**-2)
        nothing = np.zeros((len(keys), 3))
        return Cells(keys, weight, normals * weight[:, None], nothing, np.zeros((len(keys), 3, 3)))

    b_from_project = pose((0.0, 0.0, 0.7), (1.0, 2.0, 0.3))
    fisher = information(seen(sigma_a), seen(sigma_b), b_from_project)
    places = centres(keys) @ b_from_project[:3, :3].T + b_from_project[:3, 3]
    turned = normals @ b_from_project[:3, :3].T
    jacobian = np.hstack([np.cross(places, turned), turned])
    b_from_a = pose((0.0, 0.0, 0.2), (4.0, -1.0, 0.1))
    noise = RNG.normal(size=(runs, len(keys))) * np.hypot(sigma_a, sigma_b)
    errors = np.linalg.lstsq(jacobian, noise.T)[0].T
    squares = [error @ fisher @ error for error in errors]
    assert np.mean(squares) == pytest.approx(6.0, rel=0.1)
    moved = errors[:, 3:] + np.cross(errors[:, :3], b_from_a[:3, 3])
    bound = least(fisher, b_from_a)
    assert bound.mm == pytest.approx(1e3 * np.sqrt((moved**2).sum(axis=1).mean()), rel=0.1)
    turns = np.degrees(np.sqrt((errors[:, :3] ** 2).sum(axis=1).mean()))
    assert bound.deg == pytest.approx(turns, rel=0.1)
