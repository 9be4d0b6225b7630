"""Colour and intensity that tell nothing of surfaces are not used."""

from dataclasses import replace

import numpy as np
import pytest

from support.room import room_scan
from trihedral.scan import Scan
from trihedral.scan.appearance import telling
from trihedral.scan.preparation import prepare
from trihedral.scan.prepared import Prepared

RNG = np.random.default_rng(8)


def painted(scan: Scan) -> tuple[np.ndarray, np.ndarray]:
    """Intensities and colours of a room with patterns on its walls."""
    x, y, z = scan.xyz.astype(float).T
    grey = 120 + 60 * np.sin(5 * x) * np.cos(4 * y + 2 * z) + RNG.normal(0, 4, len(scan))
    color = np.stack([grey, 0.8 * grey + 10 * np.sin(3 * y), 0.6 * grey + 20], axis=1)
    return (grey / 300).astype(np.float32), np.clip(color, 1, 255).astype(np.uint8)


def jet(values: np.ndarray) -> np.ndarray:
    """A usual scale of false colours."""
    at = (values - values.min()) / np.ptp(values)
    channels = [1.5 - np.abs(4 * at - middle) for middle in (3, 2, 1)]
    return (np.clip(np.stack(channels, axis=1), 0, 1) * 255).astype(np.uint8)


@pytest.fixture(scope="module")
def scan() -> Scan:
    bare = room_scan(step=0.5)
    intensity, color = painted(bare)
    return replace(bare, intensity=intensity, color=color)


def test_what_tells_something_stays(scan: Scan) -> None:
    assert telling(scan) is scan


@pytest.mark.parametrize("of", ["height", "range", "x", "height of a tilted scanner"])
def test_false_colours_are_no_appearance(scan: Scan, of: str) -> None:
    tilt = np.eye(4)
    tilt[1:3, 1:3] = [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]]
    by = {
        "height": scan.xyz[:, 2],
        "x": scan.xyz[:, 0],
        "range": np.linalg.norm(scan.xyz, axis=1),
        "height of a tilted scanner": scan.xyz @ tilt[2, :3].astype(np.float32),
    }[of]
    header = replace(scan.header, file_pose=tilt if "tilted" in of else None)
    found = telling(replace(scan, header=header, color=jet(by)))
    assert found.color is None and found.intensity is scan.intensity
    assert not found.header.has_color and any("and nothing else: not used" in n for n in found.header.notes)


def test_colours_of_the_intensity_leave_the_intensity(scan: Scan) -> None:
    assert scan.intensity is not None
    for color in (
        jet(scan.intensity),
        np.repeat((scan.intensity * 255).astype(np.uint8)[:, None], 3, axis=1),
    ):
        found = telling(replace(scan, color=color))
        assert found.color is None and found.intensity is scan.intensity


def test_paint_that_changes_with_height_is_paint(scan: Scan) -> None:
    """Dark below and light above, with a pattern of a tenth of that."""
    assert scan.color is not None
    below = (scan.xyz[:, 2] < 0)[:, None]
    color = np.where(below, 40, 180) + (scan.color / 8)
    found = telling(replace(scan, color=color.astype(np.uint8)))
    assert found.color is not None
    # Plain walls with a door in a strong colour.
    door = (np.abs(scan.xyz[:, 1]) < 0.4) & (scan.xyz[:, 0] > 3.9) & (scan.xyz[:, 2] < 0.5)
    assert 0.005 < door.mean() < 0.05
    color = np.where(door[:, None], 90, np.where(below, 40, 180) * np.ones(3)).astype(np.uint8)
    assert telling(replace(scan, color=color)).color is not None


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_an_intensity_that_is_the_same_everywhere_is_none(scan: Scan, noise: float) -> None:
    intensity = (0.5 + RNG.normal(0, noise, len(scan))).astype(np.float32)
    # A few odd ones decide nothing.
    intensity[::500] = 1.0
    found = telling(replace(scan, intensity=intensity))
    assert found.intensity is None and found.color is scan.color
    assert np.isnan(prepare(replace(scan, intensity=intensity)).photometry.intensity).all()


def test_one_colour_everywhere_is_none(scan: Scan) -> None:
    color = np.full((len(scan), 3), 128, np.uint8) + RNG.integers(0, 3, (len(scan), 1)).astype(np.uint8)
    assert telling(replace(scan, color=color)).color is None


def test_a_height_given_as_intensity_is_none(scan: Scan) -> None:
    height = (scan.xyz[:, 2] - scan.xyz[:, 2].min()) / np.ptp(scan.xyz[:, 2])
    assert telling(replace(scan, intensity=height.astype(np.float32))).intensity is None


@pytest.mark.parametrize(("factor", "offset"), [(0.001, 0.0), (0.01, 0.4)])
def test_intensities_in_a_corner_of_their_range_are_spread(scan: Scan, factor: float, offset: float) -> None:
    assert scan.intensity is not None
    narrow = replace(scan, intensity=(offset + factor * scan.intensity).astype(np.float32))
    found = telling(narrow).intensity
    assert found is not None and found.max() > 0.9
    assert np.corrcoef(found, scan.intensity)[0, 1] > 0.99


def test_points_without_colour_do_not_count(scan: Scan) -> None:
    assert scan.color is not None
    known = np.arange(len(scan)) % 3 == 0
    color = jet(scan.xyz[:, 2]) * known[:, None]
    assert telling(replace(scan, color=color, colored=known)).color is None
    color = scan.color * known[:, None]
    assert telling(replace(scan, color=color, colored=known)).color is not None


def test_notes_are_kept_with_the_prepared_scan(scan: Scan, tmp_path) -> None:
    prepared = prepare(replace(scan, color=jet(scan.xyz[:, 2])))
    assert any("colour shows" in note for note in prepared.notes)
    assert np.isnan(prepared.surfels.color).all()
    prepared.save(tmp_path / "a.npz")
    assert Prepared.load(tmp_path / "a.npz").notes == prepared.notes
