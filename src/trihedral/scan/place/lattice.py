"""Where a scanner stood, to the millimetre, from the pattern of its directions.

A scanner sends its beams at equal steps of elevation and azimuth about an axis. From the place that it stood at, the
directions of its points lie on such a lattice; from any other, the lattice is bent by what is near and far.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float64
from trihedral.scan.place.density import axes_about, tilted

# Rows near the poles have their points so close in azimuth that it tells nothing.
_HIGHEST = np.radians(65.0)
# Pairs of neighbours that steps are found from.
_PAIRS = 30_000
# Steps that are tried: shares of the spacing of neighbours, and from one to the next.
_FINEST, _COARSEST, _NEXT = 0.25, 8.0, 0.012
# Of a step: a direction farther off the lattice is not on it.
_OFF = 0.15
# Residuals beyond so many standard deviations are left out.
_OUTLIER = 3.5
_ROUNDS = 8


@dataclass(frozen=True)
class Lattice:
    """A place, an axis and steps of angle.

    Attributes
    ----------
    place
        (3,) metres.
    axis
        (3,) unit.
    steps
        (2,) radians of azimuth and elevation.
    coherence
        (2,) of each: 1 where directions lie on the lattice, 0 where it means nothing.
    covariance
        (3, 3) of the place, square metres.
    """

    place: Float64
    axis: Float64
    steps: Float64
    coherence: Float64
    covariance: Float64

    @property
    def sound(self) -> bool:
        """Whether it means anything at all."""
        return bool(np.isfinite(self.place).all() and self.coherence.min() > 0.3)

    def windows(self, points: Float64, size: float) -> NDArray[np.int64]:
        """(N,) number of the cell of about that size (radians) that each point is seen in."""
        azimuth, elevation, _ = angles(points, self.place, self.axis)
        row = np.floor((elevation + np.pi / 2) / size)
        around = np.maximum(1.0, np.floor(2 * np.pi * np.cos((row + 0.5) * size - np.pi / 2) / size))
        column = np.floor((azimuth + np.pi) / (2 * np.pi) * around)
        return np.asarray(np.unique(row * 1e6 + column, return_inverse=True)[1].ravel(), dtype=np.int64)

    def off(self, points: Float64, size: float) -> NDArray[np.bool_]:
        """Tell which points (N, 3) have directions that are not on it, phases being one within windows of a size."""
        azimuth, elevation, _ = angles(points, self.place, self.axis)
        window = self.windows(points, size)
        low = np.abs(elevation) < _HIGHEST
        found = np.zeros(len(points), dtype=bool)
        for angle, step in zip((azimuth, elevation), self.steps, strict=True):
            left = _off_phase(angle / step, window, low)
            found |= np.abs(left) > _OFF
        return np.asarray(found & low)


def angles(points: Float64, place: Float64, axis: Float64) -> tuple[Float64, Float64, Float64]:
    """Azimuth and elevation of points (..., 3) about an axis, radians, and range, metres."""
    ray = (points - place) @ axes_about(axis).T
    level = np.hypot(ray[..., 0], ray[..., 1])
    azimuth = np.arctan2(ray[..., 1], ray[..., 0])
    return azimuth, np.arctan2(ray[..., 2], level), np.hypot(level, ray[..., 2])


def _off_phase(turns: Float64, window: NDArray[np.int64], used: NDArray[np.bool_]) -> Float64:
    """What each number of turns (N,) is off the common phase of its window, -0.5 to 0.5."""
    unit = np.exp(2j * np.pi * turns) * used
    mean = np.bincount(window, unit.real) + 1j * np.bincount(window, unit.imag)
    return _wrapped(turns - np.angle(mean)[window] / (2 * np.pi), 1.0)


def _wrapped(values: Float64, period: float) -> Float64:
    return np.asarray(values - period * np.rint(values / period))


def first_lattice(
    members: Float64, place: Float64, axis: Float64, rng: np.random.Generator
) -> Lattice | None:
    """The steps between neighbours (M, K, 3), seen from a place that is known about; None where too few are low."""
    azimuth, elevation, _ = angles(members, place, axis)
    low = np.abs(elevation[:, 0]) < _HIGHEST
    if low.sum() < 50:
        return None
    turn = _wrapped(azimuth[low, 1:] - azimuth[low, :1], 2 * np.pi)
    rise = elevation[low, 1:] - elevation[low, :1]
    spacing = float(np.hypot(turn * np.cos(elevation[low, :1]), rise)[:, :4].mean())
    chosen = rng.choice(turn.size, min(_PAIRS, turn.size), replace=False)
    found = [_step(differences.ravel()[chosen], spacing) for differences in (turn, rise)]
    steps, coherence = (np.array(values) for values in zip(*found, strict=True))
    return Lattice(place, axis, steps, coherence, np.full((3, 3), np.inf))


def _step(differences: Float64, spacing: float) -> tuple[float, float]:
    """The step that differences of angles (K,) are multiples of, near the spacing of points, and their coherence."""
    trial = spacing * np.exp(np.arange(np.log(_FINEST), np.log(_COARSEST), _NEXT))
    size = np.abs(differences)
    found = np.zeros(len(trial))
    for k, step in enumerate(trial):
        # Differences of less than half a step are on any coarse lattice.
        used = size > 0.5 * step
        if used.mean() > 0.1:
            found[k] = np.cos(2 * np.pi * size[used] / step).mean()
    # A lattice lies on all of its finer ones too: the coarsest is it.
    peak = (found >= np.roll(found, 1)) & (found >= np.roll(found, -1)) & (found > 0.75 * found.max())
    best = int(np.flatnonzero(peak)[-1]) if peak.any() else int(found.argmax())
    return float(trial[best]), float(found[best])


@dataclass(frozen=True)
class _Equations:
    """Residuals of an angle across the beam, radians, what unknowns add to them, and standard deviations."""

    residual: Float64
    jacobian: Float64
    sigma: Float64
    coherence: float


def refined(start: Lattice, points: Float64, window: NDArray[np.int64]) -> Lattice:
    """Fit place, axis and steps to the directions of points (N, 3), each window of them with phases of its own."""
    now = start
    for _ in range(_ROUNDS):
        parts = [_equations(now, points, window, k) for k in (0, 1)]
        weight = [np.where(np.abs(p.residual) < _OUTLIER * p.sigma, 1.0 / p.sigma, 0.0) for p in parts]
        matrix = np.concatenate([p.jacobian * w[:, None] for p, w in zip(parts, weight, strict=True)])
        right = np.concatenate([p.residual * w for p, w in zip(parts, weight, strict=True)])
        # Columns of one size: what the points do not tell has a small singular value.
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-30)
        matrix /= size
        inverse = np.linalg.pinv(matrix.T @ matrix, rcond=1e-10, hermitian=True)
        change = inverse @ (matrix.T @ right) / size
        now = Lattice(
            now.place + change[:3],
            tilted(now.axis, change[3:5]),
            now.steps + change[5:],
            np.array([part.coherence for part in parts]),
            (inverse / np.outer(size, size))[:3, :3],
        )
        if not now.sound or np.linalg.norm(change[:3]) < 1e-5:
            break
    return now


def _equations(now: Lattice, points: Float64, window: NDArray[np.int64], k: int) -> _Equations:
    """Of azimuth (0) or elevation (1), each window's phase taken off; points near the poles are left out."""
    azimuth, elevation, distance = angles(points, now.place, now.axis)
    low = np.abs(elevation) < _HIGHEST
    azimuth, elevation, distance, window = azimuth[low], elevation[low], distance[low], window[low]
    sa, ca, se, ce = np.sin(azimuth), np.cos(azimuth), np.sin(elevation), np.cos(elevation)
    if k == 0:
        turns, scale = azimuth / now.steps[0], ce
        way = np.stack([-sa, ca, np.zeros_like(sa)], axis=1)
    else:
        turns, scale = elevation / now.steps[1], np.ones_like(ce)
        way = np.stack([-se * ca, -se * sa, ce], axis=1)
    off = _off_phase(turns, window, np.ones(len(turns), dtype=bool))
    residual = off * now.steps[k] * scale
    jacobian = np.zeros((len(turns), 7))
    jacobian[:, :3] = (way @ axes_about(now.axis)) / distance[:, None]
    # Directions turn the other way when the axis tilts.
    jacobian[:, 3:5] = se[:, None] * way[:, :2] - way[:, 2:] * np.stack([ce * ca, ce * sa], axis=1)
    jacobian[:, 5 + k] = (turns - off) * scale
    sigma = _sigma_by_range(residual, distance)
    values = _less_phases(np.column_stack([residual, jacobian]), window, scale, sigma)
    return _Equations(values[:, 0], values[:, 1:], sigma, float(np.cos(2 * np.pi * off).mean()))


def _less_phases(values: Float64, window: NDArray[np.int64], scale: Float64, sigma: Float64) -> Float64:
    """Take off the columns (N, C) what a phase of each window, times the scale, explains."""
    weight = scale / sigma**2
    total = np.maximum(np.bincount(window, weight * scale), 1e-300)
    phase = np.stack([np.bincount(window, weight * column) / total for column in values.T], axis=1)
    return np.asarray(values - phase[window] * scale[:, None])


def _sigma_by_range(residual: Float64, distance: Float64, parts: int = 10) -> Float64:
    """Standard deviation of each residual (N,), from those at about the same range."""
    edges = np.quantile(distance, np.linspace(0, 1, parts + 1)[1:-1])
    part = np.searchsorted(edges, distance)
    sizes = [np.median(np.abs(residual[part == k])) if (part == k).any() else 1.0 for k in range(parts)]
    return np.asarray(np.maximum(1.4826 * np.array(sizes), 1e-7)[part])
