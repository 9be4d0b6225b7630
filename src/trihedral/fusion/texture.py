"""Texture mapping: colours of pictures onto points, and points onto pixels; Eq. (2) of Kim, Chen and Cho (2017).

Every picture is drawn against the surface that the scan saw, so that points behind the camera or behind something
nearer take no colour. Pictures that overlap are brought to one exposure and blended with weights that fall smoothly
to zero at their borders.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import InputError, OptionError
from trihedral.fusion import camera as lens
from trihedral.fusion.pixels import decoded
from trihedral.fusion.surface import ScanSurface, VisibleSurface
from trihedral.scan import Photo, Scan
from trihedral.scan.view import View

# Points on which exposures are compared.
_COMPARED = 60_000
# Values below and above are too dark, or near white, to tell an exposure by.
_DARK, _BRIGHT = 12.0, 243.0
# A pair of pictures needs so many points in common to be compared.
_LEAST_COMMON = 30
_JPEG_QUALITY = 95
_SHOWS_NOTHING = "it shows nothing of the scan"
# Fields that say where pictures were taken, of formats that people write by hand.
_POSE_FIELDS = {"rig": "picture, body_angle_deg; camera, body_from_camera or mounting"}


@dataclass(frozen=True)
class TextureOptions:
    """How pictures and points are brought together."""

    #: Share of half a picture over which its weight falls to zero at the border.
    border: float = 0.25
    #: Pixels; larger pictures are reduced to it before views are made of them.
    longest_side: int = 4096
    #: Whether exposure is compensated where pictures overlap.
    equalise: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.border <= 1.0:
            raise OptionError(f"border is {self.border}: a share between 0 and 1 is needed")
        if self.longest_side < 16:
            raise OptionError(f"longest_side is {self.longest_side}: at least 16 pixels are needed")


@dataclass(frozen=True)
class PhotoUse:
    """What became of one picture."""

    name: str
    #: Points that took colour from it.
    points: int = 0
    #: (3,) factors on red, green and blue that bring it to the others' exposure.
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    #: Why it was not used; empty where it was.
    reason: str = ""


@dataclass(frozen=True)
class PointColors:
    """Colours of a scan's points."""

    #: (N, 3) uint8 red, green, blue; black where no picture sees the point.
    color: NDArray[np.uint8]
    #: (N,) whether one does.
    colored: NDArray[np.bool_]
    #: What became of each picture, in the order given.
    photos: tuple[PhotoUse, ...]


def decode(photo: Photo, scan: Scan) -> NDArray[np.uint8]:
    """Decode a picture to (H, W, 3) red, green, blue.

    Raises
    ------
    InputError
        If it is damaged, or its size is not that of its camera.
    """
    try:
        image = decoded(photo.data, "RGB")
    except ValueError as error:
        raise InputError(
            scan.header.source,
            f"it is no {photo.encoding.upper()} that can be read ({error})",
            place=f"picture {photo.name}",
        ) from error
    height, width = image.shape[:2]
    if (width, height) != (photo.camera.width, photo.camera.height):
        raise InputError(
            scan.header.source,
            f"the picture has {width} x {height} pixels, its camera is described for "
            f"{photo.camera.width} x {photo.camera.height}",
            place=f"picture {photo.name}",
            advice="Use the picture as it was taken, or calibrate at its size",
        )
    return image


def straightened(photo: Photo, scan: Scan) -> Photo:
    """Take the lens distortion out of a picture, for formats that cannot state one.

    The camera keeps size, focal lengths and principal point; pixels that the lens did not show are black.

    Raises
    ------
    InputError
        If the picture is damaged, or its size is not that of its camera.
    """
    if not any(photo.camera.distortion):
        return photo
    image = decode(photo, scan)
    straight = dataclasses.replace(photo.camera, distortion=())
    places = lens.project(photo.camera, lens.pixel_rays(straight)).astype(np.float32)
    places[np.isnan(places)] = -2.0
    shape = (photo.camera.height, photo.camera.width)
    columns, rows = places[:, 0].reshape(shape), places[:, 1].reshape(shape)
    drawn = cv2.remap(image, columns, rows, cv2.INTER_CUBIC, borderValue=(0, 0, 0))
    suffix, options = (
        (".png", []) if photo.encoding == "png" else (".jpg", [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    )
    _, data = cv2.imencode(suffix, cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR), options)
    return dataclasses.replace(photo, data=data.tobytes(), camera=straight)


def _why_not(photo: Photo) -> str:
    if photo.camera.kind == "visual-reference":
        return "it is a visual reference: nothing says how its pixels relate to directions"
    if photo.station_from_camera is None:
        return "nothing says where it was taken"
    if not lens.complete(photo.camera):
        return "its camera is not described completely"
    return ""


def colorize(scan: Scan, photos: Sequence[Photo], options: TextureOptions | None = None) -> PointColors:
    """Give every point the colour of the pictures that see it, wherever their `station_from_camera` is known.

    Raises
    ------
    InputError
        If no picture sees any point, or one is damaged or of another size than its camera's.
    """
    options = options or TextureOptions()
    surface = ScanSurface(scan)
    samples = []
    for photo in photos:
        drawn = _drawn(surface, photo, scan, options)
        samples.append(None if drawn is None else drawn.sample)
    uses = [_use(photo, sample) for photo, sample in zip(photos, samples, strict=True)]
    if not any(use.points for use in uses):
        raise _nothing_seen(scan, uses)
    return _blended(surface, samples, uses, len(scan), options)


def _use(photo: Photo, sample: _core.Sample | None) -> PhotoUse:
    points = 0 if sample is None else len(sample)
    return PhotoUse(photo.name, points, reason=_why_not(photo) or ("" if points else _SHOWS_NOTHING))


def _blended(
    surface: ScanSurface,
    samples: Sequence[_core.Sample | None],
    uses: Sequence[PhotoUse],
    points: int,
    options: TextureOptions,
) -> PointColors:
    taken = [sample for sample in samples if sample is not None and len(sample)]
    gains = _gains(taken, points) if options.equalise and len(taken) > 1 else np.ones((len(taken), 3))
    blend = surface.blend(taken, gains)
    of_use = iter(gains.tolist())
    done = [dataclasses.replace(use, gain=tuple(next(of_use))) if use.points else use for use in uses]
    return PointColors(blend.colors, blend.colored, tuple(done))


def _drawn(
    surface: ScanSurface, photo: Photo, scan: Scan, options: TextureOptions, longest_side: int | None = None
) -> VisibleSurface | None:
    """Draw the surface into a picture, reduced to `longest_side`; None if nothing says how it was taken."""
    if _why_not(photo) or photo.station_from_camera is None:
        return None
    image, camera = decode(photo, scan), photo.camera
    longest = max(camera.width, camera.height)
    if longest_side is not None and longest > longest_side:
        size = tuple(max(1, round(n * longest_side / longest)) for n in (camera.width, camera.height))
        camera = lens.resized(camera, *size)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return surface.draw(camera, photo.station_from_camera, image, options.border)


def blind(scan: Scan, photos: Sequence[Photo]) -> InputError | None:
    """Give what is wrong with pictures of which `views` made none.

    None where nothing says of any how it was taken: such pictures are for people, and no mistake.
    """
    uses = [PhotoUse(photo.name, reason=_why_not(photo) or _SHOWS_NOTHING) for photo in photos]
    return _nothing_seen(scan, uses) if any(use.reason == _SHOWS_NOTHING for use in uses) else None


def _nothing_seen(scan: Scan, uses: Sequence[PhotoUse]) -> InputError:
    reasons = "; ".join(f"{use.name}: {use.reason}" for use in uses[:5])
    return InputError(
        scan.header.source,
        f"no picture sees any point of the scan ({reasons})" if uses else "there are no pictures",
        place=_POSE_FIELDS.get(scan.header.format, f"scan {scan.header.name}"),
        advice="Check the cameras' mounting and the pictures' angles" if uses else "Give some with --photos",
    )


def _gains(samples: Sequence[_core.Sample], points: int) -> NDArray[np.float64]:
    """Find factors (P, 3) that make pictures agree where they overlap, with a geometric mean of one.

    Least squares on logarithms of ratios, a median for each pair of pictures, so that what moved does not count.
    """
    count = len(samples)
    stride = max(1, sum(len(sample) for sample in samples) // (_COMPARED * count))
    values = np.full((count, -(-points // stride), 3), np.nan, np.float32)
    for k, sample in enumerate(samples):
        at, colors = sample.every(stride)
        values[k, at] = colors
    values[(values < _DARK) | (values > _BRIGHT)] = np.nan
    logs = np.log(values, out=values)
    gains = np.zeros((count, 3))
    for channel in range(3):
        normal, right = np.zeros((count, count)), np.zeros(count)
        for i in range(count):
            for j in range(i + 1, count):
                ratio = logs[j, :, channel] - logs[i, :, channel]
                ratio = ratio[np.isfinite(ratio)]
                if len(ratio) < _LEAST_COMMON:
                    continue
                known, weight = float(np.median(ratio)), float(np.sqrt(len(ratio)))
                normal[[i, j], [i, j]] += weight
                normal[i, j] -= weight
                normal[j, i] -= weight
                right[i] += weight * known
                right[j] -= weight * known
        # A weak pull to one keeps pictures apart from the rest as they are.
        normal[np.diag_indices(count)] += 1e-3
        gains[:, channel] = np.linalg.solve(normal, right)
        gains[:, channel] -= gains[:, channel].mean()
    return np.asarray(np.exp(gains))


def views(scan: Scan, photos: Sequence[Photo], options: TextureOptions | None = None) -> list[View]:
    """Give the views of `views_and_texture`."""
    return views_and_texture(scan, photos, options)[0]


def views_and_texture(
    scan: Scan, photos: Sequence[Photo], options: TextureOptions | None = None
) -> tuple[list[View], PointColors | None]:
    """Give the 3D point that every pixel of a scan's pictures shows, and what `colorize` gives.

    Each picture is drawn once, at the size of its view. Points are interpolated between neighbouring beams that met
    one surface, and never across a jump; NaN where no surface is known, also within half a spacing of the rim of
    something nearer. Pictures without a pose, with an incomplete camera or with nothing of the scan have no view.

    Returns
    -------
    The views in the order given, and the colours of the points, None where there are no views.

    Raises
    ------
    InputError
        If a picture is damaged or of another size than its camera's.
    """
    options = options or TextureOptions()
    surface = ScanSurface(scan)
    made: list[View | None] = []
    samples: list[_core.Sample | None] = []
    for photo in photos:
        drawn = _drawn(surface, photo, scan, options, options.longest_side)
        made.append(_view(photo, drawn))
        samples.append(None if drawn is None else drawn.sample)
    uses = [_use(photo, sample) for photo, sample in zip(photos, samples, strict=True)]
    named = _named(made)
    return named, _blended(surface, samples, uses, len(scan), options) if named else None


def _view(photo: Photo, drawn: VisibleSurface | None) -> View | None:
    if drawn is None or not np.isfinite(drawn.distance).any():
        return None
    return View(photo.name, drawn.image, drawn.points, edges(drawn))


def _named(made: Iterable[View | None]) -> list[View]:
    """Those that show something, with names that differ."""
    taken: dict[str, int] = {}
    named = []
    for view in made:
        if view is not None:
            count = taken[view.name] = taken.get(view.name, 0) + 1
            named.append(view if count == 1 else dataclasses.replace(view, name=f"{view.name} ({count})"))
    return named


def edges(visible: VisibleSurface) -> NDArray[np.bool_]:
    """(H, W) pixels within one spacing of the scan of a place where the surface's depth jumps or ends."""
    surface = visible.surface
    depth = visible.distance
    inverse = (1.0 / depth).astype(np.float32)
    edge = ~np.isfinite(depth)
    step = max(surface.step, 1.0 / lens.pixels_per_radian(visible.camera))
    limit = np.maximum(5.0 * surface.range_noise, 2.0 * step * np.where(edge, 0.0, depth))
    # The inverse depth of a plane is linear over the picture: its second difference tells a jump from a slope.
    for axis in (0, 1):
        bend = np.zeros_like(inverse)
        middle = np.moveaxis(bend, axis, 0)
        source = np.moveaxis(inverse, axis, 0)
        middle[1:-1] = source[2:] + source[:-2] - 2.0 * source[1:-1]
        with np.errstate(invalid="ignore"):
            edge |= np.abs(bend) * np.where(np.isfinite(depth), depth, 0.0) ** 2 > limit
    spacing = surface.step * lens.pixels_per_radian(visible.camera)
    radius = int(min(max(round(0.5 * spacing), 1), 32))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.dilate(edge.astype(np.uint8), kernel) > 0)
