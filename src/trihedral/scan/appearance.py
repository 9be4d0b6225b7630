"""Which of a scan's colours and intensities tell one surface from another."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64
from trihedral.scan.scan import Scan

# So many points, drawn from the whole scan, tell what values mean.
_SAMPLE = 100_000
# Values of a sample between these percentiles count: a few odd ones decide nothing.
_MOST = (1.0, 99.0)
# Steps of 255 that colours spread over at the least; those of one colour through JPEG spread over two.
_LEAST_STEPS = 3
# Share of the largest value that intensities spread over at the least; no scanner measures them that well.
_LEAST_CONTRAST = 2e-3
# Share of 0..1 below which intensities are spread out: logarithms of less are cut off (`scan.photometry`).
_NARROW = 1 / 32
# Values follow from others where, in the order of those, this share lies between its neighbours but for rounding: one
# step of 255. Fewer points than this do not tell.
_FOLLOWS, _LEAST_POINTS = 0.995, 4000
_RANGE = "the range"


def telling(scan: Scan) -> Scan:
    """Give the scan without colour or intensity that tells nothing of its surfaces; a note says why.

    That is: one value everywhere; false colour that follows from height or range alone, intensity that does from
    height; colour that follows from the intensity, which stays. Intensities that use little of their range are spread.
    """
    some = _some(len(scan))
    points = scan.xyz[some].astype(np.float64) + (scan.local_origin - scan.header.scanner_origin)
    places = _places(points, scan.header.file_pose)
    intensity = None if scan.intensity is None else scan.intensity[some].astype(np.float64)[:, None]
    notes = []
    # Without a correction intensity follows from the range nearly alone, and still tells something.
    without_range = {name: by for name, by in places.items() if name != _RANGE}
    if intensity is not None and (
        reason := _says_nothing(intensity, without_range, _LEAST_CONTRAST, relative=True)
    ):
        notes.append(f"intensity {reason}: not used")
        intensity = None
    color = scan.color
    if color is not None:
        known = slice(None) if scan.colored is None else scan.colored[some]
        others = dict(places) if intensity is None else {**places, "the intensity": intensity[:, 0]}
        others = {name: by[known] for name, by in others.items()}
        sample = color[some][known].astype(np.float64)
        if reason := _says_nothing(sample, others, _LEAST_STEPS - 0.5, relative=False):
            notes.append(f"colour {reason}: not used")
            color = None
    spread, said = (None, None) if intensity is None else _spread_out(scan, intensity[:, 0])
    if color is scan.color and spread is scan.intensity:
        return scan
    notes += [said] if said else []
    header = dataclasses.replace(
        scan.header,
        has_color=color is not None,
        has_intensity=spread is not None,
        notes=(*scan.header.notes, *notes),
    )
    colored = None if color is None else scan.colored
    return dataclasses.replace(scan, header=header, color=color, colored=colored, intensity=spread)


def _some(count: int) -> NDArray[np.int64] | slice:
    """Draw points; every so many of them would be of a few rows of a grid only."""
    if count <= _SAMPLE:
        return slice(None)
    return np.sort(np.random.default_rng(count).integers(0, count, _SAMPLE))


def _places(points: Float64, file_pose: NDArray[np.float64] | None) -> dict[str, Float64]:
    """Heights, along any axis, and ranges of (N, 3) points about the scanner."""
    places = {_RANGE: np.linalg.norm(points, axis=1)}
    names = ("the place along x", "the place along y", "the height")
    places |= {name: points[:, axis] for axis, name in enumerate(names)}
    if file_pose is not None:
        places["the project's height"] = points @ file_pose[2, :3]
    return places


def _says_nothing(values: Float64, others: dict[str, Float64], least: float, *, relative: bool) -> str:
    """Say why (N, C) values tell nothing of surfaces; an empty text where they do."""
    if not len(values):
        return "is that of no point"
    low, high = np.percentile(values, _MOST, axis=0)
    span, full = float((high - low).max()), float(np.abs(high).max())
    if span <= (least * full if relative else least):
        return "is the same everywhere"
    step = 1.5 * (span / 255.0 if relative else 1.0)
    for name, by in others.items():
        if _follows(values, by, step):
            return f"shows {name} and nothing else"
    return ""


def _follows(values: Float64, by: Float64, step: float) -> bool:
    """Whether (N, C) values follow from (N,) other ones alone, in any way, but for steps of rounding."""
    if len(values) < _LEAST_POINTS:
        return False
    order = np.argsort(by, kind="stable")
    values, by = values[order], by[order]
    # Between neighbours, which lie far apart where points are few.
    share = (by[1:-1] - by[:-2]) / np.maximum(by[2:] - by[:-2], 1e-12)
    between = values[:-2] + share[:, None] * (values[2:] - values[:-2])
    apart = np.abs(values[1:-1] - between).max(axis=1)
    return bool(np.mean(apart <= step) >= _FOLLOWS)


def _spread_out(scan: Scan, sample: Float64) -> tuple[NDArray[np.float32] | None, str | None]:
    """Spread intensities over 0..1 where they use little of it."""
    low, high = (float(value) for value in np.percentile(sample, _MOST))
    if scan.intensity is None or high - low >= _NARROW:
        return scan.intensity, None
    # Small values are of a wide scale, and zero stays zero; those far from zero have another zero.
    low = low if low > high - low else 0.0
    spread = np.clip((scan.intensity - np.float32(low)) / np.float32(high - low), 0.0, 1.0)
    return spread.astype(np.float32), f"intensity from {low:.3g} to {high:.3g} of its range: spread out"
