import io

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from trihedral.geometry.se3 import motion
from trihedral.initial.visual.scan_features import Picture
from trihedral.report.paper_figures import StationAppearance, link_figures, oblique, plane_view


def test_places_are_where_their_points_are_drawn() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-10, 10, (3000, 3))
    colours = np.full((3000, 3), 200.0)
    mark = np.array([[2.0, -3.0, 34.0]])
    # One black point above all others is nearest to the eye.
    image, to_unit = oblique(
        np.concatenate([points, mark]),
        np.concatenate([colours, [[0, 0, 0]]]),
        500,
        250.0,
        mark,
    )
    x, y = to_unit(mark)[0]
    rows, columns = np.nonzero(np.array(image).max(axis=2) == 0)
    assert abs(columns.mean() - 2 * x) < 2 and abs(rows.mean() - 2 * y) < 2


def test_points_on_planes_are_coloured_and_the_corner_is_inside_the_picture() -> None:
    rng = np.random.default_rng(2)
    floor = np.column_stack([rng.uniform(0, 5, (3000, 2)), np.zeros(3000)])
    planes = [
        {"normal": n, "distance_m": 0.0, "points": 10, "rank": k, "thickness_m": 0.01}
        for k, n in enumerate(np.eye(3).tolist(), start=1)
    ]
    pose = motion(Rotation.from_euler("z", 40, degrees=True).as_matrix(), np.array([3.0, 0, 0]))
    view = plane_view("a", floor, planes, [0.0, 0.0, 0.0], 0.02, pose)
    assert 0 <= view.corner[0] <= 488 and 0 <= view.corner[1] <= view.height
    assert [words.split(" ")[1] for _, words in view.planes] == ["1", "2", "3"]


def test_matches_lie_on_their_pixels_whatever_the_pictures_size() -> None:
    jpeg = io.BytesIO()
    Image.new("RGB", (50, 25)).save(jpeg, "JPEG")
    pictures = {
        "a": [Picture("left", (100, 50), jpeg.getvalue())],
        "b": [Picture("right", (200, 200), jpeg.getvalue())],
    }
    pair = {
        **{"from_picture": "left", "to_picture": "right", "matches": 9, "planar": 4, "agreeing": 1},
        **{"from_pixels": [[49.5, 24.5], [0.0, 0.0]], "to_pixels": [[99.5, 99.5], [5.0, 5.0]]},
        "drawn_agreeing": [True, False],
    }
    link = {
        **{"from": "a", "to": "b", "accepted": True, "transform": None, "method": "icp", "reason": None},
        "evidence": {"visual": {"pairs": [pair]}},
    }
    previews = StationAppearance(lambda name: None, lambda name: pictures[name])
    (figures,) = link_figures({"links": [link]}, {}, previews)
    (matched,) = figures.matched
    half = (1000 - 12) / 2
    middle = [half / 2, half / 4, half + 12 + half / 2, half / 2]
    np.testing.assert_allclose(matched.lines[-1][:4], middle)
    assert [line[4] for line in matched.lines] == [False, True] and matched.height == half
    # A link of the default method has no such figures; one whose pictures are gone has none either.
    assert link_figures({"links": [{**link, "evidence": {"score": 0.5}}]}, {}, previews) == []
    assert link_figures({"links": [link]}, {}, None)[0].matched == []
