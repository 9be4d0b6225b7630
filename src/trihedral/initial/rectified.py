"""Poses from features on planar patches seen straight on, where scale and perspective are gone.

A keypoint has a point, the normal of its patch and a direction in the plane: one match gives a whole pose.
"""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral.fusion.surroundings import Surroundings
from trihedral.geometry.motion import motion
from trihedral.initial.facet_agreement import turned_onto_facets
from trihedral.initial.features import FeatureOptions, detect
from trihedral.initial.matching import MatchOptions, match
from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

# A texture is not taken where the surface is seen at less than this cosine to its normal.
GRAZING = 0.15
# Seen surface is of the patch within this distance (m) of it, beside the spacing of the points.
ON_PATCH = 0.05
# Metres a pixel of the textures of each level. A level gives keypoints with a radius of two to four pixels: of coarse
# ones there are always fewer, and they alone can be seen from two places far apart.
PIXELS = (0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
RADII = (2.0, 4.0)
LEAST_PIXELS = 24  # along the shorter side of a texture


@dataclass(frozen=True)
class RectifiedOptions:
    """How features on patches become poses."""

    features: FeatureOptions = field(default_factory=lambda: FeatureOptions(most=400))  # of each level
    most_pixels: int = 400_000  # of the textures of a level
    match: MatchOptions = field(default_factory=lambda: MatchOptions(ratio=0.95, size=1.4))
    most_matches: int = 600
    tolerance: float = 0.1  # metres within which two keypoints are one place ...
    tolerance_radii: float = 0.5  # ... beside this share of their radius
    turn: float = np.radians(8.0)  # by which a single match may be off
    poses: int = 40  # proposed at the most


def rectified_keypoints(
    prepared: Prepared, seen: Surroundings, options: RectifiedOptions
) -> dict[str, NDArray[np.generic]]:
    """Fields of `Prepared` on keypoints of its patches."""
    found: dict[str, list[NDArray[np.generic]]] = {name: [] for name in _FIELDS}
    grey = _halvings(seen)
    for pixel in PIXELS:
        textures = _textures(prepared, seen, grey, pixel, options.most_pixels)
        total = max(sum(texture.image.size for texture in textures), 1)
        for texture in textures:
            share = int(np.ceil(options.features.most * texture.image.size / total))
            keypoints = detect(texture.image, texture.mask, replace(options.features, most=8 * share))
            kept = np.flatnonzero(
                (keypoints.scale >= RADII[0]) & (keypoints.scale < RADII[1])
                | (keypoints.scale >= RADII[1]) & (pixel == PIXELS[-1])
            )[:share]
            x, y = keypoints.pixels[kept].T * pixel
            cos, sin = np.cos(keypoints.angle[kept]), np.sin(keypoints.angle[kept])
            found["rectified_points"].append(
                texture.corner + x[:, None] * texture.right + y[:, None] * texture.down
            )
            found["rectified_normals"].append(np.tile(texture.normal, (len(x), 1)))
            found["rectified_along"].append(cos[:, None] * texture.right + sin[:, None] * texture.down)
            found["rectified_sizes"].append(keypoints.scale[kept] * pixel)
            found["rectified_descriptors"].append(keypoints.descriptors[kept])
    return {
        name: np.concatenate([np.empty(shape, dtype=kind), *found[name]]).astype(kind)
        for name, (shape, kind) in _FIELDS.items()
    }


_FIELDS = {
    "rectified_points": ((0, 3), np.float32),
    "rectified_normals": ((0, 3), np.float32),
    "rectified_along": ((0, 3), np.float32),
    "rectified_sizes": ((0,), np.float32),
    "rectified_descriptors": ((0, 128), np.uint8),
}


@dataclass(frozen=True)
class _Texture:
    """A patch seen straight on: pixel (x, y) shows ``corner + pixel * (x * right + y * down)``."""

    corner: Float64
    right: Float64
    down: Float64
    normal: Float64
    image: NDArray[np.uint8]
    mask: NDArray[np.bool_]


def _halvings(seen: Surroundings) -> list[Surroundings]:
    """The picture of the surroundings and its means over 2, 4 and 8 cells."""
    pictures = [seen]
    while len(pictures) < 4 and pictures[-1].side % 2 == 0:
        last = pictures[-1]
        size = (last.side // 2, 3 * last.side)
        grey = np.asarray(cv2.resize(last.grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        pictures.append(Surroundings(grey, last.range, last.edge))
    return pictures


def _textures(
    prepared: Prepared, seen: Surroundings, grey: list[Surroundings], pixel: float, left: int
) -> list[_Texture]:
    """Textures of the largest patches, until the pixels are used up."""
    textures: list[_Texture] = []
    for index, normal in enumerate(prepared.patch_normals):
        outline = prepared.outline_corners[
            prepared.outline_starts[index] : prepared.outline_starts[index + 1]
        ]
        right = prepared.patch_along[index, 3:]
        down = np.cross(right, normal)
        # Farther from the foot of the scanner on the plane the surface is seen too thinly or at a grazing angle.
        height = max(-float(prepared.patch_distances[index]), 1e-3)
        foot = normal * prepared.patch_distances[index]
        farthest = np.sqrt(max(min(2 * pixel * height / seen.cell, (height / GRAZING) ** 2) - height**2, 0.0))
        in_plane = (outline - foot) @ np.column_stack([right, down])
        low, high = np.maximum(in_plane.min(axis=0), -farthest), np.minimum(in_plane.max(axis=0), farthest)
        width, rows = (int(count) for count in np.maximum((high - low) / pixel, 0))
        if min(width, rows) < LEAST_PIXELS:
            continue
        left -= width * rows
        if left < 0:
            break
        textures.append(_texture(foot, low, (width, rows), pixel, (right, down, normal), height, seen, grey))
    return textures


def _texture(
    foot: Float64,
    start: Float64,
    size: tuple[int, int],
    pixel: float,
    axes: tuple[Float64, Float64, Float64],
    height: float,
    seen: Surroundings,
    grey: list[Surroundings],
) -> _Texture:
    right, down, normal = axes
    width, rows = size
    x = (start[0] + pixel * (np.arange(width) + 0.5)).astype(np.float32)
    y = (start[1] + pixel * (np.arange(rows) + 0.5)).astype(np.float32)
    places = (
        foot.astype(np.float32)
        + x[None, :, None] * right.astype(np.float32)
        + y[:, None, None] * down.astype(np.float32)
    )
    square = x**2 + (y**2)[:, None] + np.float32(height**2)
    # Distance between points on the plane, along the line from the foot, where it is greatest.
    spacing = square * np.float32(seen.cell / height)
    column, row = seen.places(places)
    drawn = seen.range[np.rint(row).astype(np.intp), np.rint(column).astype(np.intp)]
    mask = (np.abs(drawn - np.sqrt(square)) < ON_PATCH + spacing) & (drawn > 0) & (spacing <= 2 * pixel)
    # Near surface is averaged over a pixel of the texture.
    level = np.clip(np.log2(pixel / spacing), 0, len(grey) - 1).astype(np.intp)
    image = np.empty((rows, width), dtype=np.uint8)
    for k in np.unique(level):
        at = grey[k].places(places) if k else (column, row)
        image[level == k] = grey[k].pictured(*at)[level == k]
    corner = foot + (start[0] + 0.5 * pixel) * right + (start[1] + 0.5 * pixel) * down
    return _Texture(corner, right, down, normal, image, mask)


def rectified_poses(a: Prepared, b: Prepared, options: RectifiedOptions) -> list[tuple[Float64, float]]:
    """Motions that single matches propose, those first that most matches follow."""
    matches = match(
        a.rectified_descriptors.astype(np.float32),
        b.rectified_descriptors.astype(np.float32),
        options.match,
        sizes=(a.rectified_sizes, b.rectified_sizes),
    )
    i, j = matches.a[: options.most_matches], matches.b[: options.most_matches]
    if not len(i):
        return []
    points_a, points_b = a.rectified_points[i].astype(np.float64), b.rectified_points[j].astype(np.float64)
    frames_a, frames_b = _frames(a, i), _frames(b, j)
    # The direction in the plane is known to some degrees only; walls and floors know better.
    rotations = turned_onto_facets(a, b, frames_b @ frames_a.transpose(0, 2, 1))
    sizes = np.maximum(a.rectified_sizes[i], b.rectified_sizes[j]).astype(np.float64)
    near = np.hypot(options.tolerance, options.tolerance_radii * sizes)
    apart = np.linalg.norm(points_a[:, None] - points_a, axis=2)
    support = _support(
        rotations,
        (points_a, points_b),
        (frames_a, frames_b),
        near + np.sin(options.turn) / 2 * apart,
        options.turn,
    )
    # Turned onto facets, a pose may leave the frame that proposed it; its point it keeps.
    np.fill_diagonal(support, 1.0)
    # Of equals the more distinct match comes first.
    seeds = np.argsort(-support.sum(axis=1), kind="stable")[: 4 * options.poses]
    found: list[tuple[Float64, float]] = []
    for seed in seeds:
        rotation = rotations[seed]
        weights = support[seed]
        for _ in range(2):
            shift = weights @ (points_b - points_a @ rotation.T) / weights.sum()
            offset = np.linalg.norm(points_a @ rotation.T + shift - points_b, axis=1)
            facing = np.einsum("ij,mj,mi->m", rotation, frames_a[:, :, 2], frames_b[:, :, 2])
            weights = np.maximum(1 - (offset / (2 * near)) ** 2, 0) * (facing > np.cos(options.turn))
            if not weights.any():
                weights = support[seed]
                break
        found.append((motion(rotation, shift), float(weights.sum())))
    found.sort(key=lambda item: -item[1])
    return found[: options.poses]


def _frames(prepared: Prepared, index: NDArray[np.intp]) -> Float64:
    """(M, 3, 3) columns: direction in the plane, across it, normal."""
    along = prepared.rectified_along[index].astype(np.float64)
    normal = prepared.rectified_normals[index].astype(np.float64)
    return np.stack([along, np.cross(normal, along), normal], axis=2)


def _support(
    rotations: Float64,
    points: tuple[Float64, Float64],
    frames: tuple[Float64, Float64],
    limit: Float64,
    turn: float,
) -> Float64:
    """(M, M) how well each match (columns) follows the pose that another (rows) proposes, 0..1."""
    (points_a, points_b), (frames_a, frames_b) = points, frames
    moved = np.einsum("mij,nj->mni", rotations, points_a)
    shift = points_b - np.einsum("mij,mj->mi", rotations, points_a)
    offset = np.linalg.norm(moved + shift[:, None] - points_b, axis=2)
    facing, along = (
        np.einsum("mnj,nj->mn", np.einsum("mij,nj->mni", rotations, frames_a[:, :, k]), frames_b[:, :, k])
        for k in (2, 0)
    )
    # Directions in the plane are less sure than the normals of patches.
    alike = (facing > np.cos(turn)) & (along > np.cos(3 * turn))
    support: Float64 = np.where(alike, np.maximum(1 - (offset / limit) ** 2, 0.0), 0.0)
    return support
