"""Turns about the vertical under which the walls of two scans face the same ways."""

import numpy as np
from numpy.typing import NDArray

from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

BINS = 360  # one degree each
APART = 4  # degrees between turns; a pose is refined from half of that
LEAST_CORRELATION = 0.1  # of headings that say anything
LEAST_SHARE = 0.5  # of the best correlation


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
    """Turns (rad) of `a` onto `b`, the best circular correlation of their headings first, at most `count`.

    A turn need not be a peak: where walls face many ways, the true one may be the shoulder of another. Scans without
    walls are turned all the way round.
    """
    correlation = np.fft.irfft(np.fft.rfft(b) * np.conj(np.fft.rfft(a)), BINS)
    best = correlation.max()
    if best < LEAST_CORRELATION:
        even: NDArray[np.float32] = np.linspace(0, 2 * np.pi, count, endpoint=False, dtype=np.float32)
        return even
    chosen: list[float] = []
    for turn in np.argsort(-correlation, kind="stable"):
        if correlation[turn] < LEAST_SHARE * best or len(chosen) == count:
            break
        if all(abs((turn - other + 180) % 360 - 180) >= APART for other in chosen):
            before, here, after = correlation[[(turn - 1) % BINS, turn, (turn + 1) % BINS]]
            peak = here >= max(before, after) and 2 * here > before + after
            offset = 0.5 * (before - after) / (before - 2 * here + after) if peak else 0.0
            chosen.append(float(turn + offset))
    headings: NDArray[np.float32] = np.radians(np.array(chosen)).astype(np.float32)
    return headings
