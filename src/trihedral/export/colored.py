"""Coloured scans: pictures mapped onto points, written in formats that keep colours.

In: scan files with pictures of their own, or loose pictures with a camera file. Out: E57, PLY or LAZ. One raw scan
is in memory at a time, and the inputs are only read.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from trihedral.atomic import check_absent, output_error
from trihedral.errors import InputError, OptionError
from trihedral.export.e57 import e57_scan
from trihedral.export.names import file_name
from trihedral.fusion.texture import PhotoUse, TextureOptions, colorize
from trihedral.io import ReadOptions, find_inputs, las, ply, read_headers, read_photos, read_scan
from trihedral.io.camera import read_camera
from trihedral.io.e57 import write_e57
from trihedral.io.pictures import picture_files
from trihedral.io.rig import loose_photo
from trihedral.io.writers import Content, PlacedScan
from trihedral.job.hashes import digest
from trihedral.job.inputs import SourceFile
from trihedral.output_folder import OutputFolder
from trihedral.progress import Progress, Silent
from trihedral.scan import Photo, Scan, ScanHeader
from trihedral.version import fingerprint

ColoredFormat = Literal["e57", "ply", "laz"]


@dataclass(frozen=True)
class Colored:
    """What became of one scan and its pictures."""

    name: str
    file: Path
    points: int
    #: Points that a picture sees.
    colored: int
    photos: tuple[PhotoUse, ...]


def loose_photos(pictures: Sequence[Path | str], camera: Path | str) -> list[Photo]:
    """Read loose pictures of one camera.

    Parameters
    ----------
    pictures
        JPEG and PNG files, and folders of them; none: those that the camera file lists.
    camera
        A camera file, which says where each picture was taken, or where all of them were.

    Raises
    ------
    InputError
        If a picture or the camera file cannot be used, or nothing says where a picture was taken.
    """
    camera = Path(camera)
    described = read_camera(camera)
    listed = {path.resolve(): pose for path, pose in described.pictures}
    files = picture_files(pictures) or [path for path, _ in described.pictures]
    if not files:
        raise InputError(camera, "it is missing, and no pictures were given", place="picture")
    photos = []
    for path in dict.fromkeys(files):
        pose = listed.get(path.resolve(), described.body_from_camera)
        if pose is None:
            raise InputError(
                camera,
                f"it does not say where {path.name} was taken",
                place="picture, body_from_camera",
                advice="List it as [[picture]], or solve its pose with `trihedral calibrate --pairs`",
            )
        photos.append(loose_photo(path, described.model, pose))
    return photos


def colorize_files(
    paths: Sequence[Path | str],
    out: Path | str,
    kind: ColoredFormat = "e57",
    *,
    pictures: Sequence[Path | str] = (),
    camera: Path | str | None = None,
    read: ReadOptions | None = None,
    options: TextureOptions | None = None,
    progress: Progress | None = None,
) -> list[Colored]:
    """Colour scans by their pictures and write them.

    Points that no picture sees keep the colour they had; where they had none they are black, which is read as none.

    Parameters
    ----------
    out
        A folder, in which what was coloured before is replaced, and kept if it is of the same scan and pictures; or
        a new file that ends in .e57, .ply or .laz, for one scan (.e57: for any number).
    kind
        Format of the files in a folder.
    pictures, camera
        Loose pictures of the one scan, and their camera file.

    Raises
    ------
    InputError
        If a file cannot be used, or no picture sees anything of a scan.
    OutputError
        If a file cannot be written, or one that is not ours is in its place.
    OptionError
        If the options contradict each other.
    """
    out, read, progress = Path(out), read or ReadOptions(), progress or Silent()
    if kind not in get_args(ColoredFormat):
        raise OptionError(f"colorize writes {', '.join(get_args(ColoredFormat))}, not {kind!r}")
    if pictures and camera is None:
        raise OptionError("Loose pictures need the file of their camera: --camera camera.toml.")
    headers = [header for path in find_inputs(paths) for header in read_headers(path, read)]
    loose = loose_photos(pictures, camera) if camera is not None else []
    _check_pictures(headers, loose)
    single = _form(out) in get_args(ColoredFormat)
    if single and _form(out) != "e57" and len(headers) > 1:
        raise OptionError(f"{out.name} holds one scan; {len(headers)} were given: name a folder.")
    progress.phase("colorize", len(headers), "scans", float(len(headers)), "")
    done: list[Colored] = []

    def write(target: Path, path: Path, members: Sequence[ScanHeader]) -> None:
        scans = _colored(members, target, loose, read, options, progress, done)
        if _form(target) == "e57":
            write_e57(path, (e57_scan(s.header.name, s, s.header.file_pose, p) for s, p in scans))
        else:
            _write_points(path, _form(target), next(scans)[0])

    if single:
        check_absent(out)
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise output_error(out, error) from error
        write(out, out, headers)
        return done
    taken: set[str] = set()
    plan = {file_name(header.name, kind, taken): header for header in headers}
    with OutputFolder(out) as files:
        files.check(plan)
        for name, header in plan.items():
            made_of = _made_of(header, kind, loose, read, options)
            if files.holds(name, made_of):
                progress.note(f"{out / name} is there already, of the same scan and pictures")
                progress.advance(header.name, 1.0)
                continue
            with files.replacing(name, made_of) as path:
                write(out / name, path, [header])
    return done


def _made_of(
    header: ScanHeader, kind: str, loose: Sequence[Photo], read: ReadOptions, options: TextureOptions | None
) -> str:
    source = SourceFile.of(header.source).sha256()
    pictures = [
        hashlib.sha256(photo.data + repr((photo.camera, photo.station_from_camera)).encode()).hexdigest()
        for photo in loose
    ]
    program = fingerprint("geometry", "scan", "io", "fusion", "export")
    return digest(program, source, str(header.scan_index), kind, str(read), str(options), *pictures)


def _check_pictures(headers: Sequence[ScanHeader], loose: Sequence[Photo]) -> None:
    if loose and len(headers) > 1:
        raise OptionError(f"Loose pictures belong to one scan; {len(headers)} scans were given.")
    for header in headers:
        if not header.photos and not loose:
            strays = (note for note in header.notes if "name no scan" in note)
            raise InputError(
                header.source,
                next(strays, "it holds no pictures"),
                place=f"scan {header.name}",
                advice="Give some with --photos and --camera",
            )


def _form(file: Path) -> str:
    return file.suffix.lower().removeprefix(".")


def _colored(
    headers: Sequence[ScanHeader],
    target: Path,
    loose: Sequence[Photo],
    read: ReadOptions,
    options: TextureOptions | None,
    progress: Progress,
    done: list[Colored],
) -> Iterator[tuple[Scan, list[Photo]]]:
    """Colour one scan after the other and add to `done` what became of each."""
    for header in headers:
        scan = read_scan(header, read)
        photos = [*read_photos(header), *loose]
        found = colorize(scan, photos, options)
        color, known = found.color, found.colored
        if scan.color is not None:
            color = np.where(known[:, None], color, scan.color)
            known = known | (True if scan.colored is None else scan.colored)
        done.append(Colored(header.name, target, len(scan), int(found.colored.sum()), found.photos))
        progress.advance(header.name, 1.0)
        header_of = replace(scan.header, has_color=True)
        yield replace(scan, header=header_of, color=color, colored=None if known.all() else known), photos


def _write_points(target: Path, kind: str, scan: Scan) -> None:
    pose = np.eye(4) if scan.header.file_pose is None else scan.header.file_pose
    scanner = pose[:3, :3] @ scan.header.scanner_origin + pose[:3, 3]
    content = Content(len(scan), color=True, intensity=scan.intensity is not None, scanners=(scanner,))
    (las.write if kind == "laz" else ply.write)(target, [PlacedScan(scan.header.name, scan, pose)], content)
