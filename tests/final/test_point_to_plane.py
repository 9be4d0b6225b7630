from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.room import room_scan
from trihedral import _core
from trihedral._core import Stage
from trihedral.final.point_to_plane import pose_covariance, refine
from trihedral.scan import Scan
from trihedral.scan.preparation import prepare
from trihedral.simulate import ScannerOptions, make_site

NONE = np.zeros((6, 6))


def normal_equations(
    rng: np.random.Generator, jacobian: np.ndarray, place: np.ndarray, common: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimate, information and scatter of a linear model whose offsets have unit noise and err together by place."""
    offsets = rng.normal(size=len(place)) + common * rng.normal(size=place.max() + 1)[place]
    information = jacobian.T @ jacobian
    estimate = np.linalg.solve(information, jacobian.T @ offsets)
    left = offsets - jacobian @ estimate
    gradients = np.array([jacobian[place == k].T @ left[place == k] for k in range(place.max() + 1)])
    # Both ways of comparing see the same: twice the gradient, and the normal matrix counted half.
    return estimate, information, 4.0 * gradients.T @ gradients


@pytest.mark.parametrize("common", [0.0, 1.0, 3.0])
def test_covariance_is_that_of_repeated_estimates(common: float) -> None:
    rng = np.random.default_rng(5)
    place = np.repeat(np.arange(120), 20)
    # What a place tells of the pose is much the same for all its surfels.
    jacobian = rng.normal(size=(120, 6))[place] + 0.2 * rng.normal(size=(len(place), 6))
    trials = [normal_equations(rng, jacobian, place, common) for _ in range(300)]
    spread = np.cov(np.array([estimate for estimate, _, _ in trials]).T)
    said = np.mean([pose_covariance(info, scatter, 120, 1.0, NONE) for _, info, scatter in trials], axis=0)
    ratio = np.trace(np.linalg.solve(spread, said)) / 6.0
    # The scatter alone would be 1; what is added for the noise is as much again where nothing errs together.
    added = np.trace(np.linalg.solve(spread, np.linalg.inv(trials[0][1]))) / 6.0
    assert added == pytest.approx(1.0, abs=0.15) if common == 0.0 else added < 0.12
    assert ratio == pytest.approx(1.0 + added, abs=0.2)


def test_what_nothing_observes_has_a_sigma_of_a_kilometre() -> None:
    information = np.diag([1e8, 1e8, 1e8, 1e8, 1e8, 0.0])
    covariance = pose_covariance(information, 4.0 * information, 500, 1.0, NONE)
    assert np.sqrt(covariance[5, 5]) == pytest.approx(1e3, rel=1e-6)
    assert np.sqrt(covariance[3, 3]) < 1e-3


def test_few_places_tell_nothing_of_scatter() -> None:
    information = np.eye(6) * 1e6
    covariance = pose_covariance(information, NONE, 5, 7.0, NONE)
    np.testing.assert_allclose(covariance, np.linalg.inv(information) * 7.0, rtol=1e-5)


def test_the_pose_follows_planes_that_are_off_as_a_whole_as_far_as_is_said() -> None:
    a, b = prepare(room_scan(step=0.5, seed=1)), prepare(room_scan(step=0.5, seed=2))
    stages = [Stage(0.03, 40_000, 12, by_variance=True)]
    fit = _core.refine_one(a.surfel_map, b.surfel_map, np.eye(4), stages)
    inverse = np.linalg.inv(fit.information)
    said = inverse @ (fit.planes / 4.0) @ inverse

    found = np.zeros((6, 6))
    normals = b.surfels.normals
    for facing in (*np.eye(3), *-np.eye(3)):
        moves = []
        for metres in (2e-4, -2e-4):
            shift = np.where((normals @ facing > 0.9)[:, None], metres * facing, 0.0)
            surfels = replace(b.surfels, points=(b.surfels.points + shift).astype(np.float32))
            off = _core.refine_one(a.surfel_map, replace(b, surfels=surfels).surfel_map, fit.pose, stages)
            left = off.pose @ np.linalg.inv(fit.pose)
            moves.append(np.concatenate([Rotation.from_matrix(left[:3, :3]).as_rotvec(), left[:3, 3]]))
        slope = (moves[0] - moves[1]) / 4e-4
        found += np.outer(slope, slope)
    # A wall that is off turns nothing; along each axis two walls share what they are off.
    np.testing.assert_allclose(np.diag(said)[3:], np.diag(found)[3:], rtol=0.15)
    assert np.diag(found)[3:] == pytest.approx([0.5] * 3, rel=0.2)


def test_sigmas_of_scans_thinned_in_space_hold_where_cubes_cut_along_the_floor() -> None:
    made = list(make_site("office", 11, 2, ScannerOptions().with_beams(500_000), overlap=(0.5, 0.9)))
    truth = np.linalg.inv(made[1].project_from_station) @ made[0].project_from_station
    header = room_scan(step=10).header
    thinned = []
    for scan, above in zip(made, (0.001, -0.001), strict=True):
        # The floor is half a sigma above a face of the cubes in one scan, and below one in the other.
        floor = np.median(scan.xyz[scan.xyz[:, 2] < -1.2, 2])
        cubes = np.floor((scan.xyz - [0.0, 0.0, floor - above]) / 0.05).astype(np.int64)
        kept = np.sort(np.unique(cubes, axis=0, return_index=True)[1])
        thinned.append(prepare(Scan(header, scan.xyz[kept], np.zeros(3))))
    estimate = refine(*thinned, truth)
    left = estimate.transform @ np.linalg.inv(truth)
    error = np.concatenate([Rotation.from_matrix(left[:3, :3]).as_rotvec(), left[:3, 3]])
    assert error @ np.linalg.solve(estimate.covariance, error) < 12.6, "95 % of six standard normal numbers"
