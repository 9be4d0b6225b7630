"""Surface that is compared in blocks of half a metre: made-up stations whose blocks can be counted by hand."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support.room import HALF, room_scan
from trihedral import _core
from trihedral.geometry.se3 import inverse, motion, rotation_about_z
from trihedral.scan import Scan
from trihedral.scan.preparation import prepare
from trihedral.scan.prepared import Prepared
from trihedral.verdict.blocks import BLOCK, BlockCounts, count_blocks

# Four surfels on a face of a block.
SPACING = 0.25
LOOSE, PATCH, STATIC = 0, 1, 2
CELLS = 720 * 1440
HERE = np.eye(4)
TOLERANCE = {"offset": 0.05, "margin": 0.1, "samples": 20_000}


def panel(x: float, y: tuple[float, float], z: tuple[float, float], kind: int) -> tuple[np.ndarray, int]:
    """Surfels of an upright face `x` m ahead that looks back at the scanner."""
    across, up = (np.arange(low + SPACING / 2, high, SPACING) for low, high in (y, z))
    places = np.stack(np.meshgrid([x], across, up, indexing="ij"), axis=-1).reshape(-1, 3)
    return places, kind


def station(
    *panels: tuple[np.ndarray, int], sees: float = 8.0, sigma: float = 0.002, turned: np.ndarray = HERE
) -> Any:
    """Of some panels, by a scanner whose beams end `sees` metres away all around; 0: it says nothing of space."""
    points = np.concatenate([places for places, _ in panels]) @ turned[:3, :3].T + turned[:3, 3]
    count = len(points)
    none = np.empty((0, 3), np.float32)
    return SimpleNamespace(
        surfel_map=_core.SurfelMap(
            points=points.astype(np.float32),
            normals=np.tile(turned[:3, :3] @ [-1.0, 0.0, 0.0], (count, 1)).astype(np.float32),
            variances=np.full(count, sigma**2, np.float32),
            kinds=np.concatenate([np.full(len(places), kind, np.uint8) for places, kind in panels]),
            spacing=SPACING,
            thin_points=none,
            thin_variances=np.empty(0, np.float32),
            areas=np.full(count, SPACING**2, np.float32),
            sparse_points=none,
            sparse_normals=none,
            seen_nearest=np.full(CELLS, sees, np.float32),
            seen_farthest=np.full(CELLS, sees, np.float32),
        )
    )


def counted(a: Any, b: Any, pose: np.ndarray = HERE) -> BlockCounts:
    return count_blocks(a, b, pose, **TOLERANCE)


def told(counts: BlockCounts) -> tuple[list[float], list[float]]:
    return counts.agreeing.tolist(), counts.conflicting.tolist()


# Eight blocks wide and four high; a box before it, of two blocks.
WALL = panel(5.1, (-2, 2), (-1, 1), STATIC)
BOX = panel(3.1, (0, 1), (0, 0.5), LOOSE)


def test_surface_is_counted_both_ways_by_its_kind() -> None:
    assert told(counted(station(WALL), station(WALL))) == ([0, 0, 64], [0, 0, 0])
    furnished = station(WALL, BOX, panel(4.1, (-1, 0), (-1, 0), PATCH))
    assert told(counted(furnished, furnished)) == ([4, 8, 64], [0, 0, 0])


@pytest.mark.parametrize("kind", [LOOSE, PATCH, STATIC])
def test_a_box_where_the_other_scan_sees_through_is_in_conflict_by_its_blocks(kind: int) -> None:
    with_box = station(WALL, (BOX[0], kind))
    found = counted(with_box, station(WALL))
    conflicting = [0.0, 0.0, 0.0]
    conflicting[kind] = 2.0
    assert told(found) == ([0, 0, 64], conflicting)


@pytest.mark.parametrize("sees", [0.0, 2.0])
def test_a_box_that_the_other_scan_cannot_have_seen_is_in_no_conflict(sees: float) -> None:
    # It says nothing of that space, or saw what hides it.
    found = counted(station(WALL, BOX), station(WALL, sees=sees))
    assert told(found) == ([0, 0, 64], [0, 0, 0])


def test_a_block_is_shared_by_what_agrees_in_it_and_what_does_not() -> None:
    # Columns of surfels, two of each: one in the first block, two in the second, one in the third. A surfel agrees with
    # a neighbour beside it: so do the first two, and the one of the other station.
    wide, narrow = panel(3.1, (0.25, 1.25), (0, 0.5), PATCH), panel(3.1, (0.25, 0.5), (0, 0.5), PATCH)
    assert told(counted(station(wide), station(narrow))) == (
        [0, 1 + 0.5 + 1, 0],
        [0, 0.5 + 1, 0],
    )


def test_a_block_of_which_little_is_known_is_not_counted() -> None:
    lone = panel(3.1, (0, 0.25), (0, 0.25), LOOSE)
    assert told(counted(station(WALL, lone), station(WALL))) == ([0, 0, 64], [0, 0, 0])
    # Behind the wall it is hidden: of a block half and half before and behind what was seen, half is known; with one
    # more layer behind it is less.
    before, behind = panel(3.02, (0, 0.5), (0, 0.5), LOOSE), panel(3.45, (0, 0.5), (0, 0.5), LOOSE)
    farther = panel(3.4, (0, 0.5), (0, 0.5), LOOSE)
    other = station(panel(-5.0, (0, 1), (0, 1), STATIC), sees=3.2, sigma=0.002)
    half = counted(station(before, behind), other)
    assert half.conflicting[LOOSE] == 1.0
    less = counted(station(before, farther, behind), other)
    assert less.conflicting[LOOSE] == 0.0


@pytest.mark.parametrize(
    ("off", "sigma", "misfit"),
    [
        # Two standard deviations of 2 mm, and a millimetre besides, three times over: 9.0 mm.
        ([0.0085, 0.0085], 0.002, 0.0),
        ([0.010, 0.010], 0.002, 1.0),
        ([0.010, 0.002], 0.002, 0.5),
        # The same centimetre off in twice the noise.
        ([0.010, 0.010], 0.004, 0.0),
        # However fine the surfels are, a millimetre is forgiven.
        ([0.0025, 0.0035], 1e-5, 0.5),
    ],
)
def test_the_misfit_is_the_share_that_noise_does_not_explain(
    off: Sequence[float], sigma: float, misfit: float
) -> None:
    def things(*depths: float) -> Any:
        places = (panel(3.1 + d, (y, y + 2), (0, 1), LOOSE) for d, y in zip(depths, (-3, 1), strict=True))
        return station(*places, sigma=sigma)

    assert counted(things(0.0, 0.0), things(*off)).misfit == pytest.approx(misfit)
    assert counted(things(0.0, 0.0), things(*(-one for one in off))).misfit == pytest.approx(misfit)


def test_walls_and_few_surfels_tell_no_misfit() -> None:
    def misfit(count: int, kind: int) -> float:
        return counted(
            station(panel(3.1, (0, count * SPACING), (0, SPACING), kind)),
            station(panel(3.11, (0, count * SPACING), (0, SPACING), kind)),
        ).misfit

    assert misfit(21, LOOSE) == 1.0
    assert misfit(20, LOOSE) == misfit(40, STATIC) == misfit(40, PATCH) == 0.4


def test_both_directions_give_the_same_counts_whatever_the_pose() -> None:
    pose = motion(rotation_about_z(0.7), np.array([1.0, -0.5, 0.2]))
    things = panel(4.11, (-2, -1), (-1, 0.5), LOOSE)
    one = station(WALL, BOX, panel(4.1, (-2, -1), (-1, 0.5), LOOSE))
    other = station(WALL, things, sees=12.0, turned=pose)
    there, back = counted(one, other, pose), counted(other, one, inverse(pose))
    assert there.conflicting[LOOSE] == pytest.approx(2.0) and there.agreeing[STATIC] > 30
    assert back.agreeing == pytest.approx(there.agreeing)
    assert back.conflicting == pytest.approx(there.conflicting)
    assert back.misfit == pytest.approx(there.misfit) and there.misfit == 1.0


# Of a prepared room: a box that stands free, a metre wide.
LOW, HIGH = np.array([1.75, -0.5, -1.0]), np.array([2.75, 0.5, 0.25])


def with_box(scan: Scan) -> tuple[Prepared, np.ndarray]:
    """A room in which a box is placed, and where beams end on it."""
    ranges = np.linalg.norm(scan.xyz, axis=1)
    rays = scan.xyz.astype(np.float64) / ranges[:, None]
    with np.errstate(divide="ignore"):
        near, far = np.sort([LOW / rays, HIGH / rays], axis=0)
    enters = near.max(axis=1)
    hit = (enters > 0) & (enters < far.min(axis=1))
    noise = ranges - np.min(HALF / np.maximum(np.abs(rays), 1e-12), axis=1)
    ranges = np.where(hit, enters + noise, ranges)
    boxed = prepare(replace(scan, xyz=(rays * ranges[:, None]).astype(np.float32)))
    on_box: np.ndarray = rays[hit] * enters[hit, None]
    return boxed, on_box


def blocks_of(points: np.ndarray) -> int:
    return len(np.unique(np.floor(points / BLOCK).astype(int), axis=0))


@pytest.fixture(scope="module")
def empty() -> Prepared:
    return prepare(room_scan(step=0.25, seed=2))


def test_a_room_agrees_with_itself_in_all_its_blocks(empty: Prepared) -> None:
    found = counted(empty, empty)
    assert not found.conflicting.any()
    # Of whole blocks the walls have 12 x 6 and 16 x 6, the ceiling 16 x 12, the floor a disc less that no beam sees.
    unseen = np.pi * (HALF[2] * np.tan(np.radians(30))) ** 2 / BLOCK**2
    assert found.agreeing.sum() == pytest.approx(2 * (2 * (72 + 96 + 192) - unseen), rel=0.03)
    assert found.agreeing[STATIC] > 0.8 * found.agreeing.sum()


def test_a_box_placed_in_one_scan_of_a_room_is_in_conflict(empty: Prepared) -> None:
    boxed, on_box = with_box(room_scan(step=0.25, seed=1))
    found = counted(boxed, empty)
    assert found.conflicting.sum() == pytest.approx(blocks_of(on_box), rel=0.1)
    # The room behind it is hidden, not in conflict.
    assert found.conflicting[STATIC] == 0.0
    assert counted(empty, boxed, HERE).conflicting == pytest.approx(found.conflicting)
