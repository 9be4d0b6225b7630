"""What the instrument does, on scenes of a few surfaces where the answer is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from trihedral.errors import OptionError
from trihedral.simulate import ReturnKind, ScannerOptions, SimulatedScan
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import Mesh, MeshBuilder
from trihedral.simulate.scanner import scan
from trihedral.simulate.scene import Light
from trihedral.simulate.snapshot import Snapshot
from trihedral.simulate.tracer import Tracer

EXACT = ScannerOptions(
    range_noise_m=0.0, signal_noise_m=0.0, angular_noise_arcsec=0.0, dropout_share=0.0, weakest_signal=0.0
)


def preview(mesh: Mesh, options: ScannerOptions, height: float = 1.7) -> SimulatedScan:
    pose = np.eye(4)
    pose[2, 3] = height
    return scan(Snapshot(Tracer(mesh), len(mesh), Light()), pose, options, (1, 2), "a")


def project(one: SimulatedScan) -> np.ndarray:
    return one.xyz.astype(float) @ one.project_from_station[:3, :3].T + one.project_from_station[:3, 3]


def wall_at(distance: float, material: str, *, half: float = 30.0) -> MeshBuilder:
    b = MeshBuilder(7)
    b.quad((distance, -half, -half), (0, 2 * half, 0), (0, 0, 2 * half), M[material])
    return b


def test_oblique_ground_is_not_tilted_or_lowered_by_the_beams_footprint() -> None:
    # A sloping plane with posts on it, so that many footprints lie over edges; no noise at all.
    slope = np.array([0.03, -0.02])
    b = MeshBuilder(3)
    corner = np.array([-60.0, -60.0, -60.0 * slope.sum()])
    b.quad(corner, (120, 0, 120 * slope[0]), (0, 120, 120 * slope[1]), M["asphalt"])
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-12, 12, (150, 2)):
        if math.hypot(x, y) > 1.5:
            b.tube([(x, y, -3.0), (x, y, 0.9)], 0.05, M["steel"], sides=10)
    options = replace(EXACT, beam_divergence_rad=0.0006, beam_diameter_m=0.008, max_range_m=50.0)
    one = preview(b.mesh(), options.with_beams(400_000))
    ground = one.face < 2
    mixed = ground & (one.kind == ReturnKind.MIXED)
    assert mixed.sum() > 30
    points = project(one)[ground & ~mixed]
    # Least squares ...
    rows = np.column_stack([points[:, :2], np.ones(len(points))])
    a, c, height = np.linalg.lstsq(rows, points[:, 2], rcond=None)[0]
    assert abs(a - slope[0]) * 30 < 2e-5 and abs(c - slope[1]) * 30 < 2e-5 and abs(height) < 2e-5
    # ... and medians in rings about the scanner, edges included.
    all_ground = project(one)[ground]
    error = all_ground[:, 2] - all_ground[:, :2] @ slope
    distance = np.hypot(*all_ground[:, :2].T)
    for near, far in ((2, 5), (5, 10), (10, 20), (20, 40)):
        ring = (distance > near) & (distance < far)
        assert abs(np.median(error[ring])) < 2e-5


def test_angular_noise_does_not_lower_oblique_ground() -> None:
    b = MeshBuilder(3)
    b.quad((-60, -60, 0), (120, 0, 0), (0, 120, 0), M["concrete"])
    one = preview(b.mesh(), replace(EXACT, angular_noise_arcsec=20.0, max_range_m=40.0).with_beams(400_000))
    points = project(one)
    distance = np.hypot(*points[:, :2].T)
    for near, far in ((2, 5), (5, 10), (10, 20), (20, 35)):
        z = points[(distance > near) & (distance < far), 2]
        assert abs(z.mean()) < max(4 * z.std() / math.sqrt(len(z)), 2e-5)


def test_range_noise_follows_signal() -> None:
    options = replace(EXACT, range_noise_m=0.002, signal_noise_m=0.001).with_beams(300_000)
    for distance in (5.0, 20.0):
        one = preview(wall_at(distance, "paint-dark").mesh(), options, height=0.0)
        head_on = one.xyz[:, 0] / one.true_range > 0.99
        error = (np.linalg.norm(one.xyz.astype(float), axis=1) - one.true_range)[head_on]
        # Reflectance about 0.45; the stated law: signal = reflectance * (10 m / range)^2.
        expected = math.sqrt(0.002**2 + 0.001**2 * 0.5 / (0.45 * (10 / distance) ** 2))
        assert len(error) > 1000
        assert abs(error.std() / expected - 1) < 0.08
        assert abs(error.mean()) < 4 * expected / math.sqrt(len(error))


@pytest.mark.parametrize(("gap", "between_expected"), [(0.12, True), (1.5, False)])
def test_echoes_nearer_than_the_pulse_mix_and_others_do_not(gap: float, between_expected: bool) -> None:
    b = wall_at(10.0, "concrete")
    b.quad((10.0 - gap, -0.8, -0.8), (0, 1.6, 0), (0, 0, 1.6), M["concrete"])
    options = replace(EXACT, elevation_min_deg=-8.0, elevation_max_deg=8.0, angular_step_deg=0.05)
    one = preview(b.mesh(), options, height=0.0)
    x = one.xyz[:, 0].astype(float)
    between = (x > 10.0 - gap + 0.004) & (x < 10.0 - 0.004)
    assert (between.sum() > 20) == between_expected
    assert np.all(one.kind[between] == ReturnKind.MIXED)
    thin = preview(b.mesh(), replace(options, mixed_pixels=False), height=0.0)
    xt = thin.xyz[:, 0].astype(float)
    assert not np.any((xt > 10.0 - gap + 0.001) & (xt < 9.999))


def test_glass_lets_most_beams_through_and_shows_some_ghosts() -> None:
    b = MeshBuilder(5)
    b.quad((4.0, -6.0, -3.0), (0, 12.0, 0), (0, 0, 6.0), M["glass"])
    b.quad((9.0, -30.0, -10.0), (0, 60.0, 0), (0, 0, 10.0), M["rubber"])
    b.quad((-1.5, -30.0, -10.0), (0, 60.0, 0), (0, 0, 20.0), M["paint"])
    one = preview(b.mesh(), EXACT.with_beams(300_000), height=0.0)
    beyond = one.kind == ReturnKind.THROUGH_GLASS
    ghosts = one.kind == ReturnKind.GHOST
    panes = one.kind == ReturnKind.GLASS
    assert beyond.sum() > ghosts.sum() > 50 and panes.sum() > 10
    x = one.xyz[:, 0].astype(float)
    assert np.abs(x[beyond] - 9.0).max() < 1e-4
    assert np.abs(x[panes] - 4.0).max() < 1e-4
    # The wall behind the scanner appears as far behind the pane as it is before it.
    assert np.abs(x[ghosts] - (4.0 + 5.5)).max() < 1e-2
    delayed = preview(b.mesh(), replace(EXACT, glass_delay_m=0.002).with_beams(300_000), height=0.0)
    ranges = np.linalg.norm(delayed.xyz.astype(float), axis=1)
    expected = 9.0 / (delayed.xyz[:, 0] / ranges) + 0.002
    behind = delayed.kind == ReturnKind.THROUGH_GLASS
    assert np.abs(ranges - expected)[behind].max() < 1e-4


def test_dark_far_and_oblique_surfaces_give_no_return() -> None:
    options = replace(EXACT, weakest_signal=3e-3).with_beams(200_000)
    dark = preview(wall_at(30.0, "rubber").mesh(), options, height=0.0)
    light = preview(wall_at(30.0, "paint").mesh(), options, height=0.0)
    assert len(light) > 1.5 * len(dark)
    steepest = (light.xyz[:, 0] / light.true_range).min()
    assert steepest < (dark.xyz[:, 0] / dark.true_range).min()


def test_drop_outs_are_as_frequent_as_stated() -> None:
    options = replace(EXACT, dropout_share=0.05).with_beams(200_000)
    whole = preview(wall_at(5.0, "paint").mesh(), EXACT.with_beams(200_000), height=0.0)
    some = preview(wall_at(5.0, "paint").mesh(), options, height=0.0)
    assert abs((1 - len(some) / len(whole)) - 0.05) < 0.005


def test_grid_cells_are_directions() -> None:
    options = replace(EXACT, angular_step_deg=1.0)
    one = preview(wall_at(5.0, "paint").mesh(), options, height=0.0)
    assert one.grid == (150, 360)
    elevation = np.degrees(np.arcsin(one.xyz[:, 2] / one.true_range))
    azimuth = np.degrees(np.arctan2(one.xyz[:, 1], one.xyz[:, 0]))
    assert np.abs(elevation - (89.5 - one.row)).max() < 1e-3
    assert np.abs((azimuth + one.column + 180.0) % 360.0 - 180.0).max() < 1e-3
    assert len(np.unique(one.column.astype(np.int64) * 1000 + one.row)) == len(one)


@pytest.mark.parametrize(
    "bad",
    [
        {"angular_step_deg": 0.0},
        {"elevation_min_deg": 50.0, "elevation_max_deg": 40.0},
        {"range_noise_m": -1.0},
        {"dropout_share": 1.0},
        {"min_range_m": 5.0, "max_range_m": 4.0},
        {"range_noise_m": math.nan},
        {"tilt_deg": 90.0},
    ],
)
def test_options_that_make_no_sense_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(OptionError):
        ScannerOptions(**bad)
