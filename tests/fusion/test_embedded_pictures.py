"""Pictures embedded in E57 files, of every kind that can be mapped, written and read back."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from support.fusion_room import CYLINDRICAL, PINHOLE, SPHERICAL, Room, looking
from trihedral.errors import InputError
from trihedral.fusion.texture import colorize, straightened, views
from trihedral.io import read_headers, read_photos, read_scan
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.scan import CameraModel

# E57 states no lens distortion.
STRAIGHT = dataclasses.replace(PINHOLE, distortion=())
PLACE = looking(25.0, (0.3, 0.4, 1.4))


@pytest.mark.parametrize("camera", [STRAIGHT, SPHERICAL, CYLINDRICAL], ids=lambda c: c.kind)
def test_every_kind_of_picture_maps_as_before_it_was_stored(
    room: Room, tmp_path: Path, camera: CameraModel
) -> None:
    photo = room.photo(camera, PLACE)
    pose = looking(140.0, (100.0, 50.0, 2.0))
    scan = room.scan
    stored = E57Scan("room", scan.xyz, pose=pose, row=scan.row, column=scan.column, photos=[photo])
    write_e57(tmp_path / "room.e57", [stored])
    (header,) = read_headers(tmp_path / "room.e57")
    # E57 puts scanners at the origin of their coordinates; this one stood 1.5 m above.
    header = dataclasses.replace(header, scanner_origin=scan.header.scanner_origin)
    found = dataclasses.replace(read_scan(header), header=header)
    (again,) = read_photos(header)
    before, after = colorize(scan, [photo]), colorize(found, [again])
    assert before.colored.sum() > 5000
    assert (before.colored != after.colored).mean() < 2e-3
    both = before.colored & after.colored
    assert np.abs(before.color[both].astype(int) - after.color[both]).mean() < 0.5
    (view,) = views(found, [again])
    truth = room.truth(camera, PLACE)
    away = np.isfinite(view.points[..., 0]) & ~view.edge
    assert away.mean() > 0.4
    assert np.median(np.linalg.norm(view.points - truth, axis=2)[away]) < 0.003


def test_real_files_with_pictures_are_mapped_or_say_why_not(shared: Path) -> None:
    folder = shared / "data" / "formats" / "e57"
    (header,) = read_headers(folder / "tiny_pc_and_images.e57")
    photos = read_photos(header)
    assert {photo.camera.kind for photo in photos} == {
        "visual-reference",
        "spherical",
        "pinhole",
        "cylindrical",
    }
    scan = read_scan(header)
    # One point, which the one picture with a pose does not show; the others have none.
    with pytest.raises(InputError, match="no picture sees any point of the scan") as error:
        colorize(scan, photos)
    assert "visual: it is a visual reference" in str(error.value)
    assert "pinhole: nothing says where it was taken" in str(error.value)
    assert views(scan, photos) == []


def test_a_distorted_picture_is_straightened_for_e57(room: Room) -> None:
    photo = room.photo(PINHOLE, PLACE, vignette=0.0, noise=0.0)
    straight = straightened(photo, room.scan)
    assert straight.camera == STRAIGHT
    before, after = colorize(room.scan, [photo]), colorize(room.scan, [straight])
    # Away from the black corners the same points have the same colours, but for what resampling blurs.
    pixels = cv2.projectPoints(
        ((room.scan.xyz - PLACE[:3, 3]) @ PLACE[:3, :3]).astype(np.float64),
        np.zeros(3),
        np.zeros(3),
        np.array([[240.0, 0, 161], [0, 242.0, 118], [0, 0, 1]]),
        np.zeros(5),
    )[0][:, 0]
    inside = ((pixels > 4) & (pixels < [315, 235])).all(axis=1)
    both = before.colored & after.colored & inside
    assert both.sum() > 5000
    assert np.abs(before.color[both].astype(int) - after.color[both]).mean() < 3.0
    assert straightened(straight, room.scan) is straight
