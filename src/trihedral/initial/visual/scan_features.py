"""What a prepared scan keeps of its pictures: features that know their 3D points, and the pictures to show them on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral.errors import InputError
from trihedral.fusion.rendering import rendered_views
from trihedral.fusion.texture import blind, views_and_texture
from trihedral.geometry.arrays import Float64, Int64
from trihedral.initial.visual.features import FeatureOptions, Features, find_features
from trihedral.overlap.sampling import even_spacing, evenly
from trihedral.scan import Photo, Scan
from trihedral.scan.appearance import telling
from trihedral.scan.preparation import PrepareOptions, prepare
from trihedral.scan.prepared import Prepared
from trihedral.scan.stored_arrays import Arrays
from trihedral.scan.view import View

# Pixels along the longer side of a kept picture, and its JPEG quality: enough for a figure of the report.
_LONGEST = 720
_QUALITY = 82


@dataclass(frozen=True)
class Picture:
    """A picture as figures show it."""

    #: That of its `View` and `Features`.
    name: str
    #: Width and height of the `View`, pixels: what pixels of features count in; the JPEG may be smaller.
    size: tuple[int, int]
    #: Its bytes.
    jpeg: bytes


@dataclass(frozen=True)
class PictureFeatures:
    """Features of a scan's pictures, and its points sampled evenly."""

    #: (N, 3) evenly sampled, station coordinates, metres: a share of them is a share of area.
    points: Float64
    #: Metres that they lie apart.
    spacing: float
    #: Of each picture; points in station coordinates.
    features: tuple[Features, ...]
    #: In the order of `features`.
    pictures: tuple[Picture, ...]
    #: Whether the pictures were rendered from colour or intensity of the scan, which had none.
    rendered: bool

    def arrays(self) -> Arrays:
        """All of it, by names of its own."""
        arrays: dict[str, NDArray[Any]] = {}
        arrays["points"], arrays["spacing"] = self.points, np.asarray(self.spacing)
        arrays["rendered"] = np.asarray(self.rendered)
        arrays["views"] = np.array([f.view for f in self.features], dtype=np.str_)
        arrays["view_sizes"] = np.array([f.size for f in self.features], dtype=np.int64).reshape(-1, 2)
        arrays["feature_starts"] = _starts([len(f) for f in self.features])
        for name in _FEATURE_ARRAYS:
            parts = [getattr(f, name) for f in self.features]
            arrays[f"feature.{name}"] = np.concatenate(parts) if parts else np.zeros(0)
        arrays["jpeg_starts"] = _starts([len(p.jpeg) for p in self.pictures])
        arrays["jpegs"] = np.frombuffer(b"".join(p.jpeg for p in self.pictures), dtype=np.uint8)
        return arrays

    @classmethod
    def from_arrays(cls, stored: Arrays) -> Self:
        """Undo `arrays`."""
        names, sizes = stored["views"].tolist(), stored["view_sizes"].tolist()
        found = {name: stored[f"feature.{name}"] for name in _FEATURE_ARRAYS}
        spans, pages = _spans(stored["feature_starts"]), _spans(stored["jpeg_starts"])
        jpegs = stored["jpegs"].tobytes()
        rendered = bool(stored["rendered"])
        points, spacing = stored["points"], float(stored["spacing"])
        features = tuple(
            Features(name, (width, height), **{key: value[span] for key, value in found.items()})
            for name, (width, height), span in zip(names, sizes, spans, strict=True)
        )
        pictures = tuple(
            Picture(name, (width, height), jpegs[page])
            for name, (width, height), page in zip(names, sizes, pages, strict=True)
        )
        return cls(points, spacing, features, pictures, rendered)


_FEATURE_ARRAYS = ("pixels", "scale", "angle", "sign", "descriptors", "points", "footprint")


def prepare_pictured(
    scan: Scan,
    photos: Sequence[Photo],
    prepare_options: PrepareOptions | None = None,
    feature_options: FeatureOptions | None = None,
) -> Prepared:
    """Prepare a scan, colour it by its pictures (Eq. 2), and find features that know their 3D points.

    A scan without pictures, or with such as nothing says how they were taken, gets views rendered from its own colour
    or intensity; one with neither has no features.

    Raises
    ------
    InputError
        The scan has no point far enough from the scanner, a picture is damaged, or the scan says where its pictures
        were taken and none of them shows anything of it.
    """
    seen, texture = views_and_texture(scan, photos) if photos else ([], None)
    if not seen and (error := blind(scan, photos)) is not None:
        raise error
    rendered = not seen
    scan = telling(scan)
    if texture is not None and scan.color is None:
        scan = replace(scan, color=texture.color, colored=texture.colored)
    if rendered and (scan.color is not None or scan.intensity is not None):
        seen = _rendered(scan)
    features = [find_features(view, feature_options) for view in seen]
    # Points are all that the method takes of surfels.
    prepared = prepare(scan, replace(prepare_options or PrepareOptions(), sound_normals=False))
    spacing = max(prepared.surfels.spacing, even_spacing(prepared.surfels.points))
    features_of = PictureFeatures(
        evenly(prepared.surfels.points, spacing) + prepared.scanner_origin,
        spacing,
        tuple(replace(found, points=found.points + scan.local_origin) for found in features),
        tuple(Picture(view.name, (view.edge.shape[1], view.edge.shape[0]), _jpeg(view)) for view in seen),
        rendered,
    )
    return replace(prepared, features=features_of)


def picture_features(prepared: Prepared) -> PictureFeatures:
    """Give what `prepare_pictured` kept with a scan.

    Raises
    ------
    TypeError
        It was prepared without its pictures.
    """
    if not isinstance(prepared.features, PictureFeatures):
        raise TypeError("the scan was prepared without its pictures")
    return prepared.features


def _rendered(scan: Scan) -> list[View]:
    try:
        return rendered_views(scan)
    except InputError:
        return []


def _jpeg(view: View) -> bytes:
    image = view.image if view.image.ndim == 2 else cv2.cvtColor(view.image, cv2.COLOR_RGB2BGR)
    height, width = image.shape[:2]
    shrink = min(1.0, _LONGEST / max(height, width))
    if shrink < 1.0:
        size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes())


def _starts(lengths: Sequence[int]) -> Int64:
    return np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)]).astype(np.int64)


def _spans(starts: Int64) -> list[slice]:
    return [slice(int(a), int(b)) for a, b in pairwise(starts)]
