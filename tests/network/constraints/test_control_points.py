"""Networks with control, fixed scans, level and decided pairs, against the truth they were made from."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.networks import build, worst_error
from scipy.spatial.transform import Rotation

from support.links import with_pose
from trihedral.errors import InputError
from trihedral.geometry.se3 import distance, inverse, motion, transform
from trihedral.model.link import LinkVerdict
from trihedral.model.station import StationStatus
from trihedral.network.constraints.constraints import (
    Constraints,
    Control,
    ControlPoint,
    Fixed,
    LevelScanners,
    Measurement,
    UserPair,
)
from trihedral.network.solve import solve

# A national grid, far from zero, turned.
PROJECT = motion(Rotation.from_euler("z", 2.1).as_matrix(), np.array([691_234.0, 5_334_321.0, 512.0]))
CORNERS = np.array([[0.0, 0.0, 1.0], [30.0, 3.0, 2.5], [28.0, 33.0, 0.5], [2.0, 27.0, 4.0]])
SIGMA, SHOWN = 0.002, 0.001


def control(network, rng, checks=(), read=lambda places: places):
    """Four points in the corners, each shown by the two nearest scans."""
    places = transform(PROJECT, CORNERS)
    given = read(places + SIGMA * rng.normal(size=(4, 3)))
    points = tuple(
        ControlPoint(f"C{k}", tuple(given[k].tolist()), (SIGMA,) * 3, k in checks) for k in range(4)
    )
    measurements = []
    for k, corner in enumerate(CORNERS):
        near = np.argsort([np.linalg.norm(pose[:3, 3] - corner) for pose in network.poses])[:2]
        for s in near.tolist():
            shown = transform(inverse(network.poses[s]), corner[None])[0] + SHOWN * rng.normal(size=3)
            measurements.append(
                Measurement(network.members[s].name, f"C{k}", tuple(shown.tolist()), (SHOWN,) * 3)
            )
    return Constraints(control=Control("control.csv", points, tuple(measurements)))


def pose_errors(network, result):
    """Errors (N, 6) of poses in the project's frame and the sigmas that were stated."""
    errors, sigmas = [], []
    for true, station in zip(network.poses, result.stations, strict=True):
        off = station.pose @ inverse(PROJECT @ true)
        turn = Rotation.from_matrix(off[:3, :3]).as_rotvec()
        errors.append([*turn, *(station.pose - PROJECT @ true)[:3, 3]])
        sigmas.append([*np.radians(station.sigma_rotation_deg), *station.sigma_translation_m])
    return np.array(errors), np.array(sigmas)


def test_residuals_of_two_checks_beside_two_control_points_are_what_was_predicted():
    """Two points leave a turn about the line between them open: the scanners' level, 180 arc seconds, decides it."""
    lean = np.radians(180 / 3600)
    ratios, fits = [], []
    for seed in range(20):
        network = build(16, seed=seed, lean=lean)
        known = replace(control(network, np.random.default_rng(seed), {1, 3}), level=LevelScanners(lean))
        for miss in solve(network.members, network.links, None, known).control:
            ratio = np.array(miss.residual_m) / miss.sigma_m
            (ratios if miss.check else fits).append(ratio)
    # 240 values each, of which those of one point or one tilt are not independent: known to about 10 %.
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.2)
    assert np.sqrt(np.mean(np.square(fits))) == pytest.approx(1.0, abs=0.2)


def test_what_two_control_points_leave_open_is_said():
    network = build(16, seed=1)
    result = solve(network.members, network.links, None, control(network, np.random.default_rng(1), {1, 3}))
    assert "leave 1 of its 6 motions open" in result.frame.text


def test_poses_are_in_the_frame_of_the_control_and_sigmas_cover_them():
    ratios = []
    for seed in range(10):
        network = build(16, seed=seed)
        result = solve(network.members, network.links, None, control(network, np.random.default_rng(seed)))
        errors, sigmas = pose_errors(network, result)
        assert np.abs(errors[:, 3:]).max() < 0.02
        ratios.append(errors / sigmas)
    # The sigmas hold half a millimetre a link that simulated links do not err by.
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.15
    assert "control points" in result.frame.text


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (lambda p: p[:, [1, 0, 2]], "x and y exchanged"),
        (lambda p: p[:, [0, 2, 1]], "y and z exchanged"),
        (lambda p: 1000 * p, "units of millimetres"),
        (lambda p: p / 0.3048, "units of feet"),
        (lambda p: 1000 * p[:, [1, 0, 2]], "x and y exchanged and units of millimetres"),
    ],
)
@pytest.mark.parametrize("flat", [False, True])
def test_swapped_axes_and_wrong_units_are_caught_with_the_evidence(read, said, flat, monkeypatch):
    if flat:
        monkeypatch.setattr(f"{__name__}.CORNERS", CORNERS * [1, 1, 0])
    network = build(16, seed=4)
    with pytest.raises(InputError) as error:
        solve(network.members, network.links, None, control(network, np.random.default_rng(4), read=read))
    assert said in str(error.value) and "control.csv" in str(error.value) and "fit to" in str(error.value)


def test_control_that_fits_or_misses_honestly_is_not_refused():
    def one_wrong(places):
        return places + np.array([[0.3, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])

    network = build(16, seed=4)
    result = solve(
        network.members, network.links, None, control(network, np.random.default_rng(4), read=one_wrong)
    )
    worst = max(result.control, key=lambda miss: miss.standardised)
    assert worst.point == "C0" and worst.standardised > 10


def test_fixed_scans_keep_their_poses_and_new_ones_join_them():
    network = build(16, seed=5)
    fixed = tuple(
        Fixed(m.name, tuple(map(tuple, (PROJECT @ pose).tolist())), 1e-4, 5e-6)
        for m, pose in list(zip(network.members, network.poses, strict=True))[:10]
    )
    result = solve(network.members, network.links, None, Constraints(fixed=fixed))
    errors, _ = pose_errors(network, result)
    assert np.abs(errors[:10, 3:]).max() < 4e-4, "they may move by their sigma"
    assert np.abs(errors[10:, 3:]).max() < 5e-3
    assert all(s.status is StationStatus.VERIFIED for s in result.stations)


def test_fixed_scans_tie_parts_that_no_link_ties():
    network = build(16, seed=5)
    upper = {m.name for m in network.members[8:]}
    apart = [k for k in network.links if (k.from_station in upper) == (k.to_station in upper)]
    chosen = [0, 1, 8, 9]
    fixed = tuple(
        Fixed(network.members[k].name, tuple(map(tuple, (PROJECT @ network.poses[k]).tolist())), 1e-4, 5e-6)
        for k in chosen
    )
    assert {s.component for s in solve(network.members, apart).stations} == {0, 1}
    result = solve(network.members, apart, None, Constraints(fixed=fixed))
    assert {s.component for s in result.stations} == {0}
    assert np.abs(pose_errors(network, result)[0][:, 3:]).max() < 0.01


def test_a_scan_that_contradicts_two_fixed_ones_is_refused_not_bent():
    network = build(16, seed=5)
    links = list(network.links)
    wrong = next(k for k, link in enumerate(links) if link.to_station == "s0012")
    links[wrong] = with_pose(links[wrong], motion(None, np.array([0, 2.0, 0])) @ links[wrong].transform)
    fixed = tuple(
        Fixed(m.name, tuple(map(tuple, (PROJECT @ pose).tolist())), 1e-4, 5e-6)
        for m, pose in list(zip(network.members, network.poses, strict=True))[:10]
    )
    result = solve(network.members, links, None, Constraints(fixed=fixed))
    assert [k for k, link in enumerate(result.links) if not link.accepted] == [wrong]
    assert np.abs(pose_errors(network, result)[0][:, 3:]).max() < 5e-3


def test_level_rights_the_frame_within_its_sigma():
    sigma = np.radians(180 / 3600)
    network = build(30, seed=6)  # stations lean by 0.6 degrees: far more
    straight = [
        motion(Rotation.from_euler("z", 0.3 * k).as_matrix(), p[:3, 3]) for k, p in enumerate(network.poses)
    ]
    rng = np.random.default_rng(6)
    leaning = [
        motion(Rotation.from_rotvec([*sigma * rng.normal(size=2), 0]).as_matrix() @ p[:3, :3], p[:3, 3])
        for p in straight
    ]
    number = {m.name: k for k, m in enumerate(network.members)}
    links = [
        with_pose(k, inverse(leaning[number[k.to_station]]) @ leaning[number[k.from_station]])
        for k in network.links
    ]
    result = solve(network.members, links, None, Constraints(level=LevelScanners(sigma)))
    found = Rotation.from_matrix([s.pose[:3, :3] for s in result.stations])
    true = Rotation.from_matrix([p[:3, :3] for p in leaning])
    frame = (found * true.inv()).mean().as_matrix()
    tilt = np.arccos(frame[2, 2])
    # The mean of 30 scanners' verticals; one alone, as without this, leans by sigma.
    assert tilt < 3 * sigma / np.sqrt(30)
    assert all(s.sigma_rotation_deg[0] < 1.5 * np.degrees(sigma) / np.sqrt(30) for s in result.stations)


def test_one_wrong_link_forced_by_hand_among_sixty_is_refused_and_named():
    network = build(20, links_a_station=3.0, seed=7)
    assert len(network.links) == 60
    link = network.links[31]
    wrong = motion(Rotation.from_euler("z", 0.4).as_matrix(), np.array([2.0, 1.0, 0.0])) @ link.transform
    pair = UserPair(link.from_station, link.to_station, tuple(map(tuple, wrong.tolist())), 0.01, 1e-3)
    result = solve(network.members, network.links, None, Constraints(source="trihedral.toml", forced=(pair,)))
    refused = [k for k in result.links if not k.accepted]
    assert [(k.from_station, k.to_station) for k in refused] == [(link.from_station, link.to_station)]
    assert "forced" in refused[0].reason and "misses its start" in refused[0].reason
    assert worst_error(network, result) < 0.005


def test_a_doubtful_link_that_is_forced_takes_part_and_a_forbidden_one_does_not():
    network = build(9, seed=8)
    first, second = network.links[3], network.links[7]
    links = [
        replace(k, verdict=LinkVerdict.DOUBTFUL, reason="little") if k is first else k for k in network.links
    ]
    wishes = Constraints(
        source="t.toml",
        forced=(UserPair(first.to_station, first.from_station),),
        forbidden=(UserPair(second.from_station, second.to_station),),
    )
    result = solve(network.members, links, None, wishes)
    by_ends = {frozenset((k.from_station, k.to_station)): k for k in result.links}
    assert by_ends[frozenset((first.from_station, first.to_station))].accepted
    forbidden = by_ends[frozenset((second.from_station, second.to_station))]
    assert not forbidden.accepted and "t.toml" in forbidden.reason


def test_a_locked_pair_keeps_the_pose_given_whatever_was_found():
    network = build(9, seed=8)
    link = network.links[3]
    a, b = (
        next(k for k, m in enumerate(network.members) if m.name == n)
        for n in (link.from_station, link.to_station)
    )
    given = motion(None, np.array([0.0, 0.004, 0.0])) @ inverse(network.poses[a]) @ network.poses[b]
    # Given from `to` to `from`, the other way about than the link.
    pair = UserPair(link.to_station, link.from_station, tuple(map(tuple, given.tolist())), 1e-5, 1e-7)
    result = solve(network.members, network.links, None, Constraints(locked=(pair,)))
    found = inverse(result.stations[a].pose) @ result.stations[b].pose
    assert distance(found, given)[0] < 1e-4


def test_coordinates_of_the_files_are_kept_where_the_result_agrees_with_them():
    network = build(16, seed=9)
    rng = np.random.default_rng(9)

    def filed(k):
        off = motion(None, 0.003 * rng.normal(size=3)) if k else motion(None, np.array([0, 7.0, 0]))
        return off @ PROJECT @ network.poses[k]

    members = [
        replace(m, header=replace(m.header, file_pose=filed(k))) for k, m in enumerate(network.members)
    ]
    result = solve(members, network.links)
    errors, _ = pose_errors(network, result)
    assert np.abs(errors[:, 3:]).max() < 0.005, "one file that is off by 7 m pulls nothing"
    assert "15 of 16" in result.frame.text
    new = solve(members, network.links, None, Constraints(coordinates="new"))
    assert any(np.array_equal(s.pose, np.eye(4)) for s in new.stations)
