"""Keypoints of a picture with descriptors and 3D points: SURF of our own, SIFT of OpenCV."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from trihedral import _core
from trihedral.errors import OptionError
from trihedral.geometry.arrays import Bool, Float32, Float64
from trihedral.initial.visual.lifting import lift
from trihedral.scan.view import View

# Descriptors hold whole numbers and have about this length (SIFT's is what OpenCV makes it).
DESCRIPTOR_LENGTH = 512.0


@dataclass(frozen=True)
class FeatureOptions:
    """Which features are found, and how many."""

    #: SURF is the paper's.
    kind: Literal["surf", "sift"] = "sift"
    #: Keypoints of one picture, the strongest.
    most: int = 1500
    #: Least determinant of the Hessian, for grey values in 0..1.
    surf_threshold: float = 0.0001
    #: Of scales.
    surf_octaves: int = 4
    #: No orientation: faster, for cameras that are held level.
    surf_upright: bool = False
    #: Descriptors of 128 values instead of 64.
    surf_extended: bool = False
    #: OpenCV's contrastThreshold.
    sift_contrast: float = 0.02

    def __post_init__(self) -> None:
        if self.kind not in ("surf", "sift"):
            raise OptionError(f"features are 'surf' or 'sift', not {self.kind!r}")
        if self.most < 1:
            raise OptionError(f"most is {self.most}: at least one keypoint is needed")
        if self.surf_threshold <= 0 or self.sift_contrast <= 0:
            raise OptionError("thresholds of features must be positive")
        if not 1 <= self.surf_octaves <= 6:
            raise OptionError(f"surf_octaves is {self.surf_octaves}: 1 to 6 are possible")


@dataclass(frozen=True)
class Features:
    """Keypoints of one picture, the strongest first."""

    #: Name of the picture.
    view: str
    #: Width and height of the picture, pixels.
    size: tuple[int, int]
    #: (N, 2) float64 x, y; pixel centres at integers.
    pixels: Float64
    #: (N,) radius of the blob, pixels.
    scale: Float64
    #: (N,) radians, from x towards y; 0 for upright features.
    angle: Float64
    #: (N,) int8: dark blobs on bright ground (1) and bright ones on dark (-1) are never the same place; 0: not told.
    sign: NDArray[np.int8]
    #: (N, D) float32 whole numbers; each row about `DESCRIPTOR_LENGTH` long.
    descriptors: Float32
    #: (N, 3) metres, in the coordinates of `View.points`; every keypoint has one.
    points: Float64
    #: (N,) metres on the surface that one pixel shows.
    footprint: Float64

    def __len__(self) -> int:
        return len(self.pixels)


@dataclass(frozen=True)
class Keypoints:
    """Keypoints before they are lifted; attributes as in `Features`."""

    pixels: Float64
    scale: Float64
    angle: Float64
    sign: NDArray[np.int8]
    descriptors: Float32


def find_features(view: View, options: FeatureOptions | None = None) -> Features:
    """Keypoints of a view where its 3D point is known and on one surface."""
    options = options or FeatureOptions()
    mask = np.isfinite(view.points).all(axis=2) & ~view.edge
    found = detect(view.image, mask, options)
    points, footprint = lift(view, found.pixels)
    kept = np.flatnonzero(np.isfinite(footprint))
    height, width = mask.shape
    return Features(
        view.name,
        (width, height),
        found.pixels[kept],
        found.scale[kept],
        found.angle[kept],
        found.sign[kept],
        found.descriptors[kept],
        points[kept],
        footprint[kept],
    )


def detect(image: NDArray[np.uint8], mask: Bool | None, options: FeatureOptions) -> Keypoints:
    """Keypoints of a picture, the strongest first.

    Parameters
    ----------
    image
        (H, W) or (H, W, 3) uint8.
    mask
        (H, W); keypoints lie only where it is true. None for anywhere.

    Raises
    ------
    ValueError
        If image and mask differ in size, or the image is no picture.
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(f"a picture is (H, W) or (H, W, 3) uint8, not {image.shape} {image.dtype}")
    if mask is not None and mask.shape != image.shape[:2]:
        raise ValueError(f"the mask {mask.shape} and the picture {image.shape[:2]} differ in size")
    grey: NDArray[np.uint8] = np.ascontiguousarray(
        image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8
    )
    return _surf(grey, mask, options) if options.kind == "surf" else _sift(grey, mask, options)


def _sift(grey: NDArray[np.uint8], mask: Bool | None, options: FeatureOptions) -> Keypoints:
    sift = cv2.SIFT.create(nfeatures=options.most, contrastThreshold=options.sift_contrast)
    seen = None if mask is None else mask.astype(np.uint8)
    keypoints, descriptors = sift.detectAndCompute(grey, seen)
    if descriptors is None:
        nothing = np.empty(0)
        return Keypoints(
            nothing.reshape(0, 2),
            nothing,
            nothing,
            nothing.astype(np.int8),
            np.empty((0, 128), dtype=np.float32),
        )
    order = sorted(
        range(len(keypoints)),
        key=lambda k: (-keypoints[k].response, keypoints[k].pt, keypoints[k].size, keypoints[k].angle),
    )[: options.most]
    return Keypoints(
        np.array([keypoints[k].pt for k in order], dtype=np.float64),
        np.array([keypoints[k].size / 2 for k in order]),
        np.radians([keypoints[k].angle for k in order]),
        np.zeros(len(order), dtype=np.int8),
        np.asarray(descriptors[order], dtype=np.float32),
    )


def _surf(grey: NDArray[np.uint8], mask: Bool | None, options: FeatureOptions) -> Keypoints:
    found = _core.surf(
        grey,
        None if mask is None else np.ascontiguousarray(mask),
        octaves=options.surf_octaves,
        threshold=options.surf_threshold,
        upright=options.surf_upright,
        extended=options.surf_extended,
        most=options.most,
    )
    return Keypoints(
        found.pixels.astype(np.float64),
        found.scale.astype(np.float64),
        found.angle.astype(np.float64),
        found.sign,
        found.descriptors,
    )
