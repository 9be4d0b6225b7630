import numpy as np
import pytest

from trihedral.final.point_to_plane import pose_covariance

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
