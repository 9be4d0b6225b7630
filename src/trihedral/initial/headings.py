"""Turns about the vertical under which the walls of two scans face the same ways."""

import numpy as np
from numpy.typing import NDArray

from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

BINS = 360  # one degree each


def wall_headings(prepared: Prepared, upright: Float64) -> Float64:
    """Histogram (360,) over the heading of the normals of upright surface, smoothed, of unit length."""
    normals = prepared.normals[prepared.planar].astype(np.float64) @ upright.T
    walls = normals[np.abs(normals[:, 2]) < 0.3]
    headings = np.degrees(np.arctan2(walls[:, 1], walls[:, 0])) % 360
    histogram = np.bincount(headings.astype(np.intp) % BINS, minlength=BINS).astype(np.float64)
    kernel = np.exp(-0.5 * (np.arange(-4, 5) / 1.5) ** 2)
    smooth = np.convolve(np.concatenate([histogram[-4:], histogram, histogram[:4]]), kernel, mode="valid")
    root = np.sqrt(smooth)
    centred: Float64 = root - root.mean()
    length = np.linalg.norm(centred)
    return centred / length if length > 0 else centred


def turns(a: Float64, b: Float64, count: int) -> NDArray[np.float32]:
    """Turns (rad) of `a` onto `b`, best first, from the circular correlation of their headings.

    Where fewer than `count` turns stand out, those farthest from all others are added, so that scans without walls are
    turned all the way round.
    """
    correlation = np.fft.irfft(np.fft.rfft(b) * np.conj(np.fft.rfft(a)), BINS)
    peaks = np.flatnonzero(
        (correlation >= np.roll(correlation, 1)) & (correlation > np.roll(correlation, -1))
    )
    peaks = peaks[np.argsort(-correlation[peaks], kind="stable")]
    chosen: list[float] = []
    for peak in peaks[correlation[peaks] > 0.1]:
        before, here, after = correlation[[(peak - 1) % BINS, peak, (peak + 1) % BINS]]
        curvature = before - 2 * here + after
        offset = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
        if all(abs((peak - other + 180) % 360 - 180) > 4 for other in chosen):
            chosen.append(float(peak + offset))
        if len(chosen) == count:
            break
    grid = np.arange(BINS, dtype=np.float64)
    while len(chosen) < count:
        apart = [np.min(np.abs((grid - other + 180) % 360 - 180)) for other in chosen]
        nearest = (
            np.min(np.abs((grid[:, None] - np.array(chosen) + 180) % 360 - 180), axis=1) if apart else grid
        )
        chosen.append(float(grid[np.argmax(nearest)]))
    headings: NDArray[np.float32] = np.radians(np.array(chosen)).astype(np.float32)
    return headings
