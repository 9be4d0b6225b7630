"""Turns about the vertical under which the walls of two scans face the same ways."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from trihedral.geometry.arrays import Float32, Float64
from trihedral.scan.prepared import Prepared

BINS = 1440
# Bins a degree.
DEGREE = BINS / 360
# Of the kernel that smooths histograms (degrees). Far surface is displaced by half its distance in decimetres a degree.
SMOOTHING = 0.5
# Degrees between turns; a pose is refined from half of that.
APART = 4
# Of headings that say anything.
LEAST_CORRELATION = 0.1
# Of the best correlation.
LEAST_SHARE = 0.15


def wall_headings(prepared: Prepared, upright: Float64) -> Float64:
    """Histogram (BINS,) over the heading of the normals of upright surface, smoothed, of unit length."""
    normals = prepared.surfels.normals[prepared.surfels.planar]
    walls = normals[np.abs(normals @ upright[2].astype(np.float32)) < 0.3] @ upright[:2].T.astype(np.float32)
    headings = np.arctan2(walls[:, 1], walls[:, 0]) / (2 * np.pi) % 1
    histogram = np.bincount((headings * BINS).astype(np.intp) % BINS, minlength=BINS).astype(np.float64)
    smooth = gaussian_filter1d(histogram, SMOOTHING * DEGREE, mode="wrap")
    root = np.sqrt(smooth)
    centred: Float64 = root - root.mean()
    length = np.linalg.norm(centred)
    return centred / length if length > 0 else centred


def turns(a: Float64, b: Float64, count: int) -> Float32:
    """Turns (rad) of `a` onto `b`, the best circular correlation of their headings first, at most `count`.

    A turn need not be a peak: where walls face many ways, the true one may be the shoulder of another. Scans without
    walls are turned all the way round.
    """
    correlation = np.fft.irfft(np.fft.rfft(b) * np.conj(np.fft.rfft(a)), BINS)
    best = correlation.max()
    if best < LEAST_CORRELATION:
        return np.linspace(0, 2 * np.pi, count, endpoint=False, dtype=np.float32)
    chosen: list[int] = []
    for turn in np.argsort(-correlation, kind="stable"):
        if correlation[turn] < LEAST_SHARE * best or len(chosen) == count:
            break
        apart = abs((turn - np.array(chosen) + BINS // 2) % BINS - BINS // 2)
        if (apart >= APART * DEGREE).all():
            chosen.append(turn)
    return (2 * np.pi / BINS * np.array(chosen)).astype(np.float32)
