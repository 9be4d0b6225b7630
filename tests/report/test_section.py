"""The section: cut where walls are, and a known slip between stations is measured as it is."""

import numpy as np
import pytest

from trihedral.report import to_document
from trihedral.report.section import choose_level, cut, trusted
from trihedral.report.wall_offsets import wall_offsets, worst_places


def offsets_of(site, only=None):
    document = to_document(site.registration, ())
    poses = {name: pose for name, pose in trusted(document).items() if only is None or name in only}
    level = choose_level(poses, site.samples).widened(0.3)
    slabs = {name: cut(pose, site.samples[name], level) for name, pose in poses.items()}
    return wall_offsets(slabs, {name: pose[:3, 3] for name, pose in poses.items()})


def test_the_cut_goes_through_walls_not_floor_or_ceiling(site):
    poses = trusted(to_document(site.registration, ()))
    level = choose_level(poses, site.samples)
    # The floor lies at 0 and the ceiling at 2.8; both hold far more points than any cut through walls.
    assert 0.3 < level.bottom < level.top < 2.5
    assert level.top - level.bottom == pytest.approx(0.1)


def test_right_poses_show_offsets_below_the_noise(site):
    offsets = offsets_of(site)
    assert len(offsets) > 20
    # 2 mm of noise on pieces of dozens of points: the median over a metre lies below.
    assert max(abs(offset.metres) for offset in offsets) < 0.0015


@pytest.mark.parametrize("slip", [0.008, -0.021])
def test_a_slip_across_the_walls_is_found_with_its_size_and_sign(site_with_slip, slip):
    offsets = offsets_of(site_with_slip({"s2": (0.0, slip)}))
    touched = [offset for offset in offsets if "s2" in offset.stations and abs(offset.across[1]) > 0.9]
    assert len({offset.stations for offset in touched}) >= 3
    for offset in touched:
        # Of the second station over the first, along `across`, which may point up or down the y axis.
        expected = slip * np.sign(offset.across[1]) * (1 if offset.stations[1] == "s2" else -1)
        assert offset.metres == pytest.approx(expected, abs=0.0015)
    others = [offset for offset in offsets if "s2" not in offset.stations]
    assert all(abs(offset.metres) < 0.0015 for offset in others)
    assert "s2" in worst_places(offsets, 4)[0].stations


def test_the_two_faces_of_a_thin_wall_are_not_compared(site):
    # Between the rooms and the corridor stand faces at y = 6 and y = 6.1, seen from opposite sides.
    offsets = offsets_of(site, {"s1", "s4"})
    assert all(abs(offset.metres) < 0.01 for offset in offsets)


def test_large_coordinates_change_nothing(site):
    document = to_document(site.registration, ())
    shift = np.array([512_345.25, 5_234_567.5, 431.0])
    poses, moved_poses = trusted(document), trusted(document)
    for pose in moved_poses.values():
        pose[:3, 3] += shift
    found = []
    for chosen in (poses, moved_poses):
        level = choose_level(chosen, site.samples).widened(0.3)
        slabs = {name: cut(pose, site.samples[name], level) for name, pose in chosen.items()}
        found.append(wall_offsets(slabs, {name: pose[:3, 3] for name, pose in chosen.items()}))
    near, far = found
    assert len(near) == pytest.approx(len(far), rel=0.1)
    assert max(abs(offset.metres) for offset in far) < 0.0015


def test_nothing_to_cut_is_no_error():
    level = choose_level({}, {})
    assert level.top > level.bottom
    assert wall_offsets({}, {}) == []
    empty = np.zeros((0, 3))
    assert wall_offsets({"a": empty, "b": empty}, {"a": np.zeros(3), "b": np.zeros(3)}) == []


def test_the_cut_keeps_clear_of_lying_surfaces_and_of_empty_heights():
    """Four walls 3 m high, a table over a third of the room at 1.5 m, one lamp far above."""
    rng = np.random.default_rng(5)
    side, up = rng.uniform(0, 9, 40_000), rng.uniform(0, 3, 40_000)
    zero, nine = np.zeros(10_000), np.full(10_000, 9.0)
    walls = [
        *(
            np.stack([side[:10_000], zero, up[:10_000]], 1),
            np.stack([side[10_000:20_000], nine, up[10_000:20_000]], 1),
        ),
        *(
            np.stack([zero, side[20_000:30_000], up[20_000:30_000]], 1),
            np.stack([nine, side[30_000:], up[30_000:]], 1),
        ),
    ]
    floor = np.stack([rng.uniform(0, 9, 30_000), rng.uniform(0, 9, 30_000), np.zeros(30_000)], 1)
    table = np.stack([rng.uniform(1, 8, 9_000), rng.uniform(3, 7, 9_000), np.full(9_000, 1.5)], 1)
    lamp = np.array([[4.0, 4.0, 30.0]])
    level = choose_level({"a": np.eye(4)}, {"a": np.concatenate([*walls, floor, table, lamp])})
    assert 0.2 < level.bottom < level.top < 3.0
    assert not level.bottom - 0.01 <= 1.5 <= level.top + 0.01
    flat = choose_level({"a": np.eye(4)}, {"a": floor})
    assert flat.top > flat.bottom
