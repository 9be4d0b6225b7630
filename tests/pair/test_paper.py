"""The paper's method for a pair, on a yard whose scans are made here."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trihedral.errors import OptionError
from trihedral.geometry.se3 import distance, inverse, motion, transform
from trihedral.initial.visual.scan_features import PictureFeatures, picture_features, prepare_pictured
from trihedral.model.link import LinkVerdict
from trihedral.overlap.nearest import OverlapOptions
from trihedral.pair.paper import PaperOptions, align_finally, register_pair_by_paper
from trihedral.scan import Scan, ScanHeader
from trihedral.scan.prepared import Prepared

# Station a stands at (4, 3), b at (9, 6) of the yard.
PROJECT_FROM_A = motion(
    Rotation.from_euler("xyz", [2, -3, 20], degrees=True).as_matrix(), np.array([4.0, 3.0, 0])
)
PROJECT_FROM_B = motion(
    Rotation.from_euler("xyz", [-1, 2, 150], degrees=True).as_matrix(), np.array([9.0, 6.0, 0])
)
TRUE = inverse(PROJECT_FROM_B) @ PROJECT_FROM_A
OFF = motion(Rotation.from_euler("xyz", [2, -1, 5], degrees=True).as_matrix(), np.array([0.5, -0.4, 0.1]))


def rectangle(rng: np.random.Generator, origin: list[float], u: list[float], v: list[float]) -> np.ndarray:
    u_, v_ = np.array(u), np.array(v)
    area = np.linalg.norm(np.cross(u_, v_))
    s, t = rng.uniform(size=(2, int(300 * area), 1))
    return origin + s * u_ + t * v_ + rng.normal(scale=0.003, size=s.shape) * np.cross(u_, v_) / area


def pictured(
    seed: int, project_from_station: np.ndarray, noise: float = 0.0, painted: bool = False
) -> Prepared:
    rng = np.random.default_rng(seed)
    cloud = np.concatenate(
        [
            rectangle(rng, [0, 0, -1.6], [14, 0, 0], [0, 10, 0]),
            rectangle(rng, [0, 0, -1.6], [0, 10, 0], [0, 0, 5]),
            rectangle(rng, [0, 10, -1.6], [14, 2, 0], [0, 0, 3]),
            rectangle(rng, [14, 0, -1.6], [0, 7, 0], [0, 0, 4]),
        ]
    )
    header = ScanHeader(
        Path("yard.e57"),
        0,
        "yard",
        "e57",
        len(cloud),
        None,
        True,
        False,
        0,
        None,
        np.zeros(3),
        True,
        "m",
        True,
    )
    shades = rng.integers(0, 256, (40, 40), dtype=np.uint8)
    square = (cloud[:, :2] + cloud[:, 2:]) // 0.5 % 40
    grey = shades[tuple(square.astype(int).T)] if painted else np.full(len(cloud), 120, dtype=np.uint8)
    color = np.repeat(grey[:, None], 3, axis=1)
    xyz = transform(inverse(project_from_station), cloud).astype(np.float32)
    return prepare_pictured(Scan(header, xyz, np.zeros(3), color=color), [])


@pytest.fixture(scope="module")
def pair() -> tuple[Prepared, Prepared]:
    return pictured(1, PROJECT_FROM_A), pictured(2, PROJECT_FROM_B)


def test_either_final_alignment_ends_near_the_truth_and_says_what_it_did(
    pair: tuple[Prepared, Prepared],
) -> None:
    for final, method, limit in (("icp", "icp", 0.1), ("planes", "plane-matching", 0.02)):
        link = align_finally(*pair, OFF @ TRUE, 7, PaperOptions(final=final))
        assert link.method == method and link.verdict is LinkVerdict.ACCEPTED, link.reason
        assert distance(link.transform, TRUE)[0] < limit
        np.testing.assert_array_equal(link.initial_transform, OFF @ TRUE)
        assert link.estimate.residuals is not None and link.estimate.residuals.rmse_m < limit
    planes = link.paper.planes
    assert len(planes.from_) == len(planes.to) == 3
    corner = transform(link.transform, np.array([planes.corner_from]))[0]
    np.testing.assert_allclose(corner, planes.corner_to, atol=1e-6)


def test_the_overlap_of_the_reference_decides(pair: tuple[Prepared, Prepared]) -> None:
    def method(threshold: float) -> str | None:
        options = PaperOptions(overlap=OverlapOptions(threshold=threshold))
        return align_finally(*pair, OFF @ TRUE, 7, options).method

    found = align_finally(*pair, OFF @ TRUE, 7, PaperOptions()).paper.overlap_initial.to
    assert 0.3 < found < 1.0
    assert method(found) == "icp"
    assert method(np.nextafter(found, 1.0)) == "plane-matching"


def test_the_same_seed_gives_the_same_bits_and_the_inverse_pair_the_inverse(
    pair: tuple[Prepared, Prepared],
) -> None:
    a, b = pair
    options = PaperOptions(final="planes")
    one, two = (align_finally(a, b, OFF @ TRUE, 7, options).transform for _ in range(2))
    assert one.tobytes() == two.tobytes()
    back = align_finally(b, a, inverse(OFF @ TRUE), 7, options).transform
    metres, radians = distance(back, inverse(one))
    assert metres < 0.02 and np.degrees(radians) < 0.1


def test_a_wrong_start_is_not_believed(pair: tuple[Prepared, Prepared]) -> None:
    far = motion(translation=np.array([60.0, 0.0, 0.0])) @ TRUE
    for final in ("icp", "planes"):
        link = align_finally(*pair, far, 7, PaperOptions(final=final))
        near = link.transform is not None and distance(link.transform, TRUE)[0] < 0.2
        assert near or link.verdict is not LinkVerdict.ACCEPTED
        assert near or link.reason


def test_scans_whose_pictures_show_nothing_are_refused_with_the_reason(
    pair: tuple[Prepared, Prepared],
) -> None:
    a, b = (replace(one, features=replace(picture_features(one), features=(), pictures=())) for one in pair)
    link = register_pair_by_paper(a, b, 1, PaperOptions())
    assert link.verdict is LinkVerdict.REFUSED and link.transform is None
    assert "pictures gave no pose" in link.reason


def test_a_pictured_scan_outlives_its_file(tmp_path: Path) -> None:
    painted = pictured(1, PROJECT_FROM_A, painted=True)
    one = picture_features(painted)
    assert one.rendered and len(one.pictures) == len(one.features) > 0
    painted.save(tmp_path / "a.npz")
    loaded = Prepared.load(tmp_path / "a.npz", PictureFeatures)
    again = picture_features(loaded)
    loaded.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert again.pictures == one.pictures and again.spacing == one.spacing
    np.testing.assert_array_equal(again.points, one.points)
    (tmp_path / "a.npz").write_bytes((tmp_path / "b.npz").read_bytes()[:-2000])
    with pytest.raises((ValueError, OSError)):
        Prepared.load(tmp_path / "a.npz", PictureFeatures)


def test_the_even_sampling_is_even(pair: tuple[Prepared, Prepared]) -> None:
    """A square metre holds as many points wherever it lies."""
    points = transform(PROJECT_FROM_A, picture_features(pair[0]).points)
    ground = points[np.abs(points[:, 2] + 1.6) < 0.03]
    counts = np.histogram2d(ground[:, 0], ground[:, 1], bins=(6, 4), range=((1, 13), (1, 9)))[0]
    assert counts.min() > 0.7 * counts.mean() and counts.max() < 1.3 * counts.mean()


@pytest.mark.parametrize("bad", [{"final": "best"}, {"offset": 0.0}, {"margin": -1.0}])
def test_options_that_make_no_sense_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(OptionError):
        PaperOptions(**bad)
