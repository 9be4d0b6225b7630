"""Reading a rig: profiles turned into points, and pictures at the place of their camera."""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import InputError
from trihedral.fusion.kinematics import profile_points, station_from_body
from trihedral.fusion.rig import Profiles, same_grid
from trihedral.geometry.se3 import Matrix
from trihedral.io.options import ReadOptions
from trihedral.io.pictures import read_picture
from trihedral.io.rig.description import RigFile, read_rig
from trihedral.io.rig.profiles import open_profiles, read_profiles
from trihedral.io.scan_builder import unit_intensity
from trihedral.scan import CameraModel, Photo, Scan, ScanHeader

# No coordinate on Earth is larger (metres).
_FARTHEST = 1e9
# Profiles turned into points at a time: what so many need on the way stays in the processor's cache.
_TOGETHER = 64


def read_headers(path: Path, options: ReadOptions) -> list[ScanHeader]:
    """Read what a rig file says, and the angles of its profiles; not the ranges."""
    rig = read_rig(path)
    sources = [open_profiles(line) for line in rig.lines]
    has_intensity = all(source.intensity for source in sources)
    return [_header(path, rig, [source.shape for source in sources], has_intensity, options)]


def _header(
    path: Path,
    rig: RigFile,
    shapes: Sequence[tuple[int, int]],
    has_intensity: bool,
    options: ReadOptions,
) -> ScanHeader:
    notes = []
    if options.units not in (None, "m"):
        notes.append(f"profiles of a rig are in metres; {options.units} was asked for and is not used")
    centres = np.array([line.scanner.centre for line in rig.lines])
    # The body's axis is the station's z axis: on it, at their mean height, the scanners' beams begin on average.
    origin = np.array([0.0, 0.0, centres[:, 2].mean()])
    stated = options.origin_of(path, 0)
    if stated is not None:
        origin = np.array(stated, dtype=np.float64)
    offset = float(np.hypot(centres[:, 0], centres[:, 1]).max())
    if offset > 0:
        notes.append(f"beams begin up to {offset:.3f} m from the axis; the scanner is taken to be on it")
    return ScanHeader(
        source=path,
        scan_index=0,
        name=rig.name,
        format="rig",
        points=sum(profiles * beams for profiles, beams in shapes),
        grid=(max(beams for _, beams in shapes), sum(profiles for profiles, _ in shapes)),
        has_color=False,
        has_intensity=has_intensity,
        photos=len(rig.pictures),
        file_pose=rig.project_from_station,
        scanner_origin=origin,
        origin_stated=True,
        units="m",
        units_stated=True,
        notes=tuple(notes),
    )


def read_scan(path: Path, scan_index: int, options: ReadOptions) -> Scan:
    """Turn ranges and angles into points. Rows of the grid are beams, from the highest; columns are body angles."""
    if scan_index != 0:
        raise InputError(path, f"it holds one scan; there is no scan {scan_index}")
    rig = read_rig(path)
    profiles = read_profiles(rig)
    has_intensity = all(one.intensity is not None for one in profiles)
    header = _header(path, rig, [one.ranges.shape for one in profiles], has_intensity, options)
    count = sum(int(np.count_nonzero(one.ranges)) for one in profiles)
    if not count:
        raise InputError(path, "none of its beams had a return", place="range_m")
    xyz = np.empty((count, 3), np.float32)
    row, column = np.empty(count, np.int32), np.empty(count, np.int32)
    intensity = np.empty(count, np.float32) if header.has_intensity else None
    end = 0
    for one, columns in zip(profiles, _columns(profiles), strict=True):
        rows = np.empty(len(one.beam_angles), np.int32)
        rows[np.argsort(-one.beam_angles, kind="stable")] = np.arange(len(rows), dtype=np.int32)
        for first in range(0, len(one.body_angles), _TOGETHER):
            turned = slice(first, first + _TOGETHER)
            ranges = one.ranges[turned]
            returned = ranges > 0
            begin, end = end, end + int(np.count_nonzero(returned))
            points = profile_points(one.scanner, one.body_angles[turned], one.beam_angles, ranges)
            xyz[begin:end] = points[returned]
            row[begin:end] = np.broadcast_to(rows, ranges.shape)[returned]
            column[begin:end] = np.repeat(columns[turned], np.count_nonzero(returned, axis=1))
            if intensity is not None and one.intensity is not None:
                intensity[begin:end] = one.intensity[turned][returned]
    if not (np.abs(xyz) <= _FARTHEST).all():
        raise InputError(path, "its angles, places and ranges make points beyond any on Earth")
    return Scan(
        header=header,
        xyz=xyz,
        local_origin=np.zeros(3),
        intensity=None if intensity is None else unit_intensity(intensity, "rig"),
        row=row,
        column=column,
    )


def _columns(profiles: Sequence[Profiles]) -> list[NDArray[np.int32]]:
    """Give each profile its column: by the direction of its arm where scanners share a grid, else one by one."""
    counts = [len(one.body_angles) for one in profiles]
    starts = np.cumsum([0, *counts])
    first = profiles[0].beam_angles
    alike = all(
        len(one.beam_angles) == len(first) and np.abs(one.beam_angles - first).max() < 1e-9
        for one in profiles
    )
    step = float(np.median(np.abs(np.diff(first)))) if len(first) > 1 else math.inf
    whole_turn = max(float(np.ptp(one.body_angles)) for one in profiles) < 2.0 * math.pi
    if alike and whole_turn and same_grid([one.scanner for one in profiles], step):
        directions = np.concatenate([one.body_angles + one.scanner.arm for one in profiles])
        order = np.argsort(np.mod(directions, 2.0 * math.pi), kind="stable")
        column = np.empty(len(order), np.int32)
        column[order] = np.arange(len(order), dtype=np.int32)
    else:
        column = np.concatenate(
            [
                start + np.argsort(np.argsort(one.body_angles, kind="stable"), kind="stable")
                for one, start in zip(profiles, starts, strict=False)
            ]
        ).astype(np.int32)
    return [column[a:b] for a, b in pairwise(starts)]


def read_photos(path: Path, scan_index: int) -> list[Photo]:
    """Read the pictures, refused in another size than their camera's; each camera is where the body's angle put it."""
    return [
        loose_photo(
            picture.path,
            picture.camera.model,
            station_from_body(picture.body_angle) @ picture.camera.body_from_camera,
            picture.name,
        )
        for picture in read_rig(path).pictures
    ]


def loose_photo(
    path: Path, camera: CameraModel, station_from_camera: Matrix | None, name: str | None = None
) -> Photo:
    """Read a JPEG or PNG file as a picture of a camera; `InputError` if it is none, or of another size."""
    data, size, kind = read_picture(path)
    if size != (camera.width, camera.height):
        raise InputError(
            path,
            f"the picture has {size[0]} x {size[1]} pixels, its camera is calibrated for "
            f"{camera.width} x {camera.height}",
            place="width, height",
            advice="Use the picture as it was taken, or calibrate at its size",
        )
    return Photo(name or path.stem, "jpeg" if kind == "jpeg" else "png", data, camera, station_from_camera)


def read_cameras(path: Path, scan_index: int) -> list[tuple[str, CameraModel]]:
    """Tell name and camera of each picture of `read_photos`, without reading the pictures."""
    return [(picture.name, picture.camera.model) for picture in read_rig(path).pictures]
