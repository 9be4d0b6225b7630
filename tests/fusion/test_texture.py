"""Texture maps and their inverse against rays cast into the same room."""

import dataclasses
import math

import cv2
import numpy as np
import pytest

from support.fusion_room import CYLINDRICAL, PINHOLE, SCANNER, SPHERICAL, Room, looking
from trihedral.errors import InputError
from trihedral.fusion.texture import TextureOptions, colorize, views
from trihedral.scan import CameraModel, Photo, Scan

# Away from the scanner, so that the box hides from the camera what the scanner sees, and the other way round.
ASIDE = looking(5.0, (0.1, 0.6, 1.3))


def unordered(scan: Scan) -> Scan:
    order = np.random.default_rng(0).permutation(len(scan))
    header = dataclasses.replace(scan.header, grid=None)
    return dataclasses.replace(scan, header=header, xyz=scan.xyz[order], row=None, column=None)


def reached(room: Room, points: np.ndarray) -> np.ndarray:
    """(H, W) which of the points (H, W, 3) the scanner saw, by rays and by its field of view."""
    offset = points.reshape(-1, 3) - SCANNER
    distance = np.linalg.norm(offset, axis=1)
    known = np.isfinite(distance)
    seen = np.zeros(len(offset), bool)
    rays = offset[known] / distance[known, None]
    _, length = room.tracer.cast(np.broadcast_to(SCANNER, rays.shape), rays)
    seen[known] = (np.abs(length - distance[known]) < 0.02) & (
        np.abs(rays[:, 2]) < math.sin(math.radians(74))
    )
    return seen.reshape(points.shape[:2])


@pytest.mark.parametrize("camera", [PINHOLE, SPHERICAL, CYLINDRICAL], ids=lambda c: c.kind)
@pytest.mark.parametrize("ordered", [True, False], ids=["grid", "no grid"])
def test_pixels_know_their_points(room: Room, camera: CameraModel, ordered: bool) -> None:
    scan = room.scan if ordered else unordered(room.scan)
    (view,) = views(scan, [room.photo(camera, ASIDE)])
    truth = room.truth(camera, ASIDE)
    assert view.points.shape == truth.shape == (camera.height, camera.width, 3)
    known = np.isfinite(view.points[..., 0])
    off = np.linalg.norm(view.points - truth, axis=2)
    seen = reached(room, truth)
    assert seen.mean() > 0.5
    assert known[seen].mean() > 0.95
    assert known[~seen].mean() < 0.1
    away = known & ~view.edge
    assert away[seen].mean() > 0.8
    # A wall 4 m away seen at up to 60 degrees; range noise is 1 mm.
    assert np.median(off[away]) < 0.003
    assert (off[away] > 0.05).mean() < 0.004
    assert (off[known] > 0.05).mean() < 0.02


def test_no_point_lies_between_two_surfaces(room: Room) -> None:
    (view,) = views(room.scan, [room.photo(PINHOLE, ASIDE)])
    x, y, z = np.moveaxis(view.points[np.isfinite(view.points[..., 0])], -1, 0)
    outside = np.min([4 - abs(x), 3 - abs(y), abs(z), abs(3 - z)], axis=0)
    box = np.maximum.reduce([abs(x - 1.8) - 0.3, abs(y) - 0.5, z - 2.2])
    assert (np.minimum(np.abs(outside), np.abs(box)) > 0.03).mean() < 1e-3


def test_hidden_points_take_no_colour(room: Room) -> None:
    texture = colorize(room.scan, [room.photo(PINHOLE, ASIDE)])
    xyz = room.scan.xyz.astype(np.float64)
    towards = xyz - ASIDE[:3, 3]
    distance = np.linalg.norm(towards, axis=1)
    _, length = room.tracer.cast(np.broadcast_to(ASIDE[:3, 3], xyz.shape), towards / distance[:, None])
    hidden = length < distance - 0.1
    behind = towards @ ASIDE[:3, 2] < 0
    assert (hidden & ~behind).sum() > 300
    assert texture.colored[behind].sum() == 0
    assert texture.colored[hidden].mean() < 0.01
    pixels = cv2.projectPoints(
        xyz[~behind],
        cv2.Rodrigues(ASIDE[:3, :3].T)[0],
        -ASIDE[:3, :3].T @ ASIDE[:3, 3],
        np.array([[240.0, 0, 161], [0, 242.0, 118], [0, 0, 1]]),
        np.array(PINHOLE.distortion),
    )[0][:, 0]
    inside = ((pixels > 2) & (pixels < [317, 237])).all(axis=1)
    shown = np.flatnonzero(~behind)[inside]
    # OpenCV's polynomial folds what is far outside into the picture again.
    wide = np.linalg.norm(towards[shown] @ ASIDE[:3, :2], axis=1) > 0.9 * (towards[shown] @ ASIDE[:3, 2])
    shown = shown[~hidden[shown] & ~wide]
    assert len(shown) > 5000
    assert texture.colored[shown].mean() > 0.97
    assert (texture.color[~texture.colored] == 0).all()


def test_a_point_has_the_colour_of_its_pixel(room: Room) -> None:
    photo = room.photo(PINHOLE, ASIDE)
    image = cv2.imdecode(np.frombuffer(photo.data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    texture = colorize(room.scan, [photo])
    seen = np.flatnonzero(texture.colored)
    local = (room.scan.xyz[seen] - ASIDE[:3, 3]) @ ASIDE[:3, :3]
    pixels = cv2.projectPoints(
        local.astype(np.float64),
        np.zeros(3),
        np.zeros(3),
        np.array([[240.0, 0, 161], [0, 242.0, 118], [0, 0, 1]]),
        np.array(PINHOLE.distortion),
    )[0][:, 0]
    expected = cv2.remap(
        image, pixels[:, :1].astype(np.float32), pixels[:, 1:].astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )[:, 0]  # fmt: skip
    # OpenCV interpolates in steps of 1/32 pixel.
    assert np.abs(texture.color[seen].astype(int) - expected).max() <= 12
    assert np.abs(texture.color[seen].astype(int) - expected).mean() < 1.0


def test_overlapping_pictures_agree_and_leave_no_seam(room: Room) -> None:
    quiet = {"vignette": 0.0, "noise": 0.0, "spread": 0.0, "white_spread": 0.0, "automatic": 0.0}
    place = (0.0, 0.0, 1.5)
    photos = [room.photo(PINHOLE, looking(h, place), f"p{h}", **quiet) for h in (150.0, 190.0)]
    reference = colorize(room.scan, photos)
    dark = cv2.imdecode(np.frombuffer(photos[1].data, np.uint8), cv2.IMREAD_COLOR)
    dark = np.rint(dark * 0.7).astype(np.uint8)
    photos[1] = dataclasses.replace(photos[1], data=cv2.imencode(".png", dark)[1].tobytes())
    texture = colorize(room.scan, photos)
    gains = np.array([use.gain for use in texture.photos])
    assert gains[1] / gains[0] == pytest.approx(1 / 0.7, rel=0.02)
    both = texture.colored & reference.colored
    ratio = texture.color[both].sum(axis=1) / np.maximum(reference.color[both].sum(axis=1), 1)
    # One exposure everywhere: what is left is the common factor.
    assert np.std(ratio) < 0.03
    plain = colorize(room.scan, photos, TextureOptions(equalise=False))
    assert np.std(plain.color[both].sum(axis=1) / np.maximum(reference.color[both].sum(axis=1), 1)) > 0.1


def test_the_border_of_a_picture_leaves_no_step(room: Room) -> None:
    """A white and a black picture: where they meet, colours change gradually."""
    place = (0.0, 0.0, 1.5)
    flat = [np.full((240, 320, 3), value, np.uint8) for value in (200, 100)]
    photos = [
        Photo(str(h), "png", cv2.imencode(".png", image)[1].tobytes(), PINHOLE, looking(h, place))
        for h, image in zip((150.0, 190.0), flat, strict=True)
    ]
    texture = colorize(room.scan, photos, TextureOptions(equalise=False))
    scan = room.scan
    level = scan.row == 150
    order = np.argsort(scan.column[level])
    values = texture.color[level][order, 0].astype(int)
    kept = texture.colored[level][order]
    assert {100, 200} <= set(values[kept])
    assert np.abs(np.diff(values[kept])).max() <= 12


def test_a_picture_that_sees_nothing_is_named(room: Room) -> None:
    away = looking(0.0, (60.0, 0.0, 1.0))
    with pytest.raises(InputError, match=r"no picture sees any point of the scan \(lost: it shows nothing"):
        colorize(room.scan, [room.photo(PINHOLE, away, "lost")])
    texture = colorize(room.scan, [room.photo(PINHOLE, away, "lost"), room.photo(PINHOLE, ASIDE, "good")])
    assert [bool(use.reason) for use in texture.photos] == [True, False]
    assert views(room.scan, [room.photo(PINHOLE, away, "lost")]) == []


def test_pictures_that_cannot_be_used_say_why(room: Room) -> None:
    photo = room.photo(PINHOLE, ASIDE)
    nowhere = dataclasses.replace(photo, name="nowhere", station_from_camera=None)
    visual = dataclasses.replace(photo, name="visual", camera=CameraModel("visual-reference", 320, 240))
    bare = dataclasses.replace(photo, name="bare", camera=CameraModel("pinhole", 320, 240))
    with pytest.raises(InputError) as error:
        colorize(room.scan, [nowhere, visual, bare])
    for part in ("nowhere: nothing says where", "visual: it is a visual reference", "bare: its camera"):
        assert part in str(error.value)
    assert [v.name for v in views(room.scan, [nowhere, photo, visual, photo])] == ["photo", "photo (2)"]


@pytest.mark.parametrize("function", [colorize, views])
def test_damaged_pictures_are_refused(room: Room, function: object) -> None:
    photo = room.photo(PINHOLE, ASIDE)
    cut = dataclasses.replace(photo, data=photo.data[: len(photo.data) // 2])
    with pytest.raises(InputError, match=r"room.e57, picture photo: it is no PNG"):
        function(room.scan, [cut])
    other = dataclasses.replace(photo, camera=dataclasses.replace(PINHOLE, width=640))
    with pytest.raises(InputError, match=r"has 320 x 240 pixels, its camera is described for 640 x 240"):
        function(room.scan, [other])


def test_large_pictures_become_views_of_a_bounded_size(room: Room) -> None:
    (view,) = views(room.scan, [room.photo(PINHOLE, ASIDE)], TextureOptions(longest_side=160))
    assert view.image.shape == (120, 160, 3)
    small = room.truth(
        dataclasses.replace(PINHOLE, width=160, height=120, focal=(120.0, 121.0), centre=(80.25, 58.75)),
        ASIDE,
    )
    away = np.isfinite(view.points[..., 0]) & ~view.edge
    assert np.median(np.linalg.norm(view.points - small, axis=2)[away]) < 0.004


def test_a_scan_far_from_the_origin_keeps_its_points_near_its_local_origin(room: Room) -> None:
    shift = np.array([431_000.0, 5_412_000.0, 300.0])
    header = dataclasses.replace(room.scan.header, scanner_origin=SCANNER + shift)
    scan = dataclasses.replace(room.scan, header=header, local_origin=shift)
    pose = ASIDE.copy()
    pose[:3, 3] += shift
    photo = room.photo(PINHOLE, ASIDE)
    (far,) = views(scan, [dataclasses.replace(photo, station_from_camera=pose)])
    (near,) = views(room.scan, [photo])
    both = np.isfinite(far.points[..., 0]) & np.isfinite(near.points[..., 0])
    assert both.sum() > 0.99 * np.isfinite(near.points[..., 0]).sum()
    assert np.abs(far.points[both] - near.points[both]).max() < 1e-3


def test_the_same_whatever_the_number_of_threads(room: Room) -> None:
    first, second = (views(room.scan, [room.photo(SPHERICAL, ASIDE)])[0] for _ in range(2))
    assert np.array_equal(first.points, second.points, equal_nan=True)
    assert math.isfinite(float(np.nanmean(first.points)))
