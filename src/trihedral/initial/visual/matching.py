"""Keypoints of two pictures that look alike, each the other's nearest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float32, Float64


@dataclass(frozen=True)
class MatchOptions:
    """When two keypoints are taken for the same place."""

    #: A match must be nearer than this share of the distance to the second nearest, seen from both pictures
    #: (Lowe 2004).
    ratio: float = 0.8

    def __post_init__(self) -> None:
        if not 0 < self.ratio <= 1:
            raise OptionError(f"ratio is {self.ratio}: a value above 0 and up to 1 is needed")


@dataclass(frozen=True)
class Matches:
    """Indices into two sets of keypoints, the most distinct match first."""

    #: (M,) indices; none occurs twice.
    a: NDArray[np.intp]
    b: NDArray[np.intp]
    #: (M,) distance to the match over that to the second nearest, the greater of both ways; 0..1.
    ratio: Float64

    def __len__(self) -> int:
        return len(self.a)


def match(
    descriptors_a: Float32,
    descriptors_b: Float32,
    options: MatchOptions | None = None,
    *,
    signs: tuple[NDArray[np.int8], NDArray[np.int8]] | None = None,
) -> Matches:
    """Mutually nearest descriptors that are nearer than the runner-up, by brute force.

    Parameters
    ----------
    descriptors_a, descriptors_b
        (N, D) and (M, D) float32 holding whole numbers, lengths below 2000 (`features.Features.descriptors`): their
        products are exact in any order of summation, so the result is the same on any machine.
    signs
        (N,) and (M,) kinds of the keypoints (`features.Features.sign`): those of different kinds do not match.

    Raises
    ------
    ValueError
        If the descriptors differ in length.
    """
    options = options or MatchOptions()
    if descriptors_a.shape[1:] != descriptors_b.shape[1:]:
        raise ValueError(
            f"descriptors of {descriptors_a.shape[1:]} and of {descriptors_b.shape[1:]} values cannot be compared"
        )
    if min(len(descriptors_a), len(descriptors_b)) < 2:
        nothing = np.empty(0, dtype=np.intp)
        return Matches(nothing, nothing, np.empty(0))
    squared = -2 * (descriptors_a @ descriptors_b.T)
    squared += np.einsum("ij,ij->i", descriptors_a, descriptors_a)[:, None]
    squared += np.einsum("ij,ij->i", descriptors_b, descriptors_b)
    nearest_b, ratio_a = _nearest(squared)
    nearest_a, ratio_b = _nearest(squared.T)
    a = np.arange(len(descriptors_a))
    ratio = np.maximum(ratio_a, ratio_b[nearest_b])
    good = (nearest_a[nearest_b] == a) & (ratio < options.ratio)
    if signs is not None:
        # Only now: a keypoint of the other kind still counts as the runner-up that a match must beat.
        good &= signs[0] == signs[1][nearest_b]
    kept = np.flatnonzero(good)
    kept = kept[np.argsort(ratio[kept], kind="stable")]
    return Matches(kept, nearest_b[kept], ratio[kept])


def _nearest(squared: Float32) -> tuple[NDArray[np.intp], Float64]:
    """Index of each row's least value, and the ratio of distances to the second least."""
    nearest = squared.argmin(axis=1)
    two = np.partition(squared, 1, axis=1)[:, :2].astype(np.float64)
    ratio = np.ones(len(squared))
    np.divide(two[:, 0], two[:, 1], out=ratio, where=two[:, 1] > 0)
    return nearest, np.sqrt(np.maximum(ratio, 0.0))
