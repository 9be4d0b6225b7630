"""Both directions of a pair are one: their verdict, their poses, and how well these are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

from support import links
from support.room import room_view
from trihedral.geometry.se3 import adjoint, inverse, motion, skew
from trihedral.model.link import LinkVerdict, PairResult, PoseEstimate, Residuals
from trihedral.pair import auto
from trihedral.pair.auto import AutoOptions, register_pair
from trihedral.scan.prepared import Prepared

ORIGINS = (np.array([20.0, -30.0, 5.0]), np.array([-7.0, 11.0, 2.0]))


def exponential(xi: np.ndarray) -> np.ndarray:
    """The motion of a twist ``(omega, v)``."""
    twist = np.zeros((4, 4))
    twist[:3, :3], twist[:3, 3] = skew(xi[:3]), xi[3:]
    moved: np.ndarray = expm(twist)
    return moved


def logarithm(motion: np.ndarray) -> np.ndarray:
    """The twist ``(omega, v)`` of a motion."""
    twist = np.real(logm(motion))
    return np.array([twist[2, 1], twist[0, 2], twist[1, 0], *twist[:3, 3]])


def centred(pose: np.ndarray, a_origin: np.ndarray, b_origin: np.ndarray) -> np.ndarray:
    """A pose between station coordinates, between frames in whose origins the scanners stand."""
    return motion(None, -b_origin) @ pose @ motion(None, a_origin)


def pose_of(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return motion(Rotation.from_rotvec(rng.normal(size=3)).as_matrix(), 5 * rng.normal(size=3))


def covariance_of(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(6, 6))
    covariance: np.ndarray = 1e-6 * root @ root.T
    return covariance


def test_the_covariance_of_an_inverted_pose_is_what_differences_tell() -> None:
    pose, covariance = pose_of(1), covariance_of(2)
    estimate = PoseEstimate(pose, covariance, Residuals(0.1, 0.2, 0.3, 0.4), 1.5, 200)
    back = estimate.inverted(*ORIGINS)
    assert back.transform == pytest.approx(np.linalg.inv(pose), abs=1e-12)
    assert (back.residuals, back.chi_square, back.compared) == (estimate.residuals, 1.5, 200)
    # What a small motion on the left, about the scanner of b, does on the left of the inverse, about that of a.
    there = centred(pose, *ORIGINS)
    step = 1e-5
    columns = []
    for unit in np.eye(6):
        plus, minus = (
            logarithm(np.linalg.inv(exponential(sign * step * unit) @ there) @ there) for sign in (1, -1)
        )
        columns.append((plus - minus) / (2 * step))
    by = np.array(columns).T
    expected = by @ covariance @ by.T
    assert back.covariance == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.abs(expected).max())


def test_a_pose_inverted_twice_is_itself() -> None:
    estimate = PoseEstimate(pose_of(3), covariance_of(4))
    again = estimate.inverted(*ORIGINS).inverted(*ORIGINS[::-1])
    assert again.transform == pytest.approx(estimate.transform, abs=1e-12)
    assert again.covariance == pytest.approx(estimate.covariance, rel=1e-9)
    assert PoseEstimate(pose_of(3)).inverted(*ORIGINS).covariance is None


def test_an_inverted_result_swaps_its_ends() -> None:
    evidence = links.evidence(overlap_from=0.6, overlap_to=0.3)
    result = PairResult(
        verdict=LinkVerdict.AMBIGUOUS,
        reason="another",
        estimate=PoseEstimate(pose_of(5)),
        initial_transform=pose_of(6),
        overlap_from=0.6,
        overlap_to=0.3,
        alternatives=(PoseEstimate(pose_of(7)), PoseEstimate(pose_of(8))),
        evidence=evidence,
    )
    back = result.inverted(*ORIGINS)
    assert (back.verdict, back.reason) == (LinkVerdict.AMBIGUOUS, "another")
    assert (back.overlap_from, back.overlap_to) == (0.3, 0.6)
    assert back.evidence == replace(evidence, overlap_from=0.3, overlap_to=0.6)
    assert back.initial_transform == pytest.approx(np.linalg.inv(pose_of(6)))
    for rival, seed in zip(back.alternatives, (7, 8), strict=True):
        assert rival.transform == pytest.approx(np.linalg.inv(pose_of(seed)))
    nothing = PairResult(verdict=LinkVerdict.REFUSED, reason="no pose was found")
    assert nothing.inverted(*ORIGINS) == nothing


def seen(box: bool, paint: int | None) -> tuple[Prepared, Prepared, np.ndarray]:
    """Two scans of a room, whose scanners do not stand in the origins of their stations, and ``b_from_a``."""
    a, from_a = room_view((0.5, -0.3, 0.1), 33.0, (4.0, -3.0), box=box, paint=paint, origin=ORIGINS[0])
    b, from_b = room_view((-1.0, 0.8, 0.0), -71.0, seed=2, box=box, paint=paint, origin=ORIGINS[1])
    return a, b, motion(None, ORIGINS[1]) @ inverse(from_b) @ from_a @ motion(None, -ORIGINS[0])


@pytest.mark.parametrize(("box", "paint"), [(True, 3), (False, None)])
def test_both_directions_give_one_verdict_inverse_poses_and_one_covariance(
    box: bool, paint: int | None
) -> None:
    a, b, truth = seen(box, paint)
    there, back = register_pair(a, b, AutoOptions()), register_pair(b, a, AutoOptions())
    assert (back.verdict, back.reason) == (there.verdict, there.reason)
    assert there.accepted is box
    assert there.estimate is not None and back.estimate is not None
    assert there.covariance is not None and there.initial_transform is not None
    assert back.initial_transform == pytest.approx(inverse(there.initial_transform), abs=1e-9)
    # Half a turn takes a bare room onto itself.
    assert len(back.alternatives) == len(there.alternatives) == (0 if box else 1)
    poses = [there.estimate, *there.alternatives]
    for one, other in zip(poses, [back.estimate, *back.alternatives], strict=True):
        assert other.transform == pytest.approx(np.linalg.inv(one.transform), abs=1e-9)
        carried = adjoint(centred(other.transform, *ORIGINS[::-1]))
        assert one.covariance is not None
        expected = carried @ one.covariance @ carried.T
        assert other.covariance == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.abs(expected).max())
    # One of them is the true one.
    off = [np.linalg.norm((one.transform - truth) @ [*ORIGINS[0], 1.0]) for one in poses]
    assert min(off) < 0.001
    assert (back.overlap_from, back.overlap_to) == (there.overlap_to, there.overlap_from)
    assert there.evidence is not None and back.evidence is not None
    assert back.evidence == replace(
        there.evidence, overlap_from=there.evidence.overlap_to, overlap_to=there.evidence.overlap_from
    )
    assert there.overlap_from != there.overlap_to
    assert (there.runner_up, there.hypotheses) == (back.runner_up, back.hypotheses)


def test_scans_of_as_many_surfels_are_worked_on_in_one_order_too(monkeypatch: pytest.MonkeyPatch) -> None:
    a, _, _ = seen(box=True, paint=None)
    b = replace(a, surfels=replace(a.surfels, points=a.surfels.points + np.float32(0.25)))
    worked_on = []

    def noted(one: Prepared, other: Prepared, options: AutoOptions) -> PairResult:
        worked_on.append((one, other))
        return PairResult(verdict=LinkVerdict.REFUSED)

    monkeypatch.setattr(auto, "_in_order", noted)
    register_pair(a, b, AutoOptions())
    register_pair(b, a, AutoOptions())
    (first, second), again = worked_on
    assert again[0] is first and again[1] is second and first is not second
