"""Where a scanner stood, about, from how densely its points lie.

Beams leave at even angles, so the points per area of a surface fall with the square of the range and with the cosine
of incidence; where rows are circles about an axis, they rise towards its poles.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from trihedral.geometry.arrays import Float64
from trihedral.scan.place.neighbourhoods import Neighbourhoods

# Surfaces seen more slantwise than this tell more of their roughness than of the scanner.
_LEAST_COSINE = 0.05
# Residuals of logarithms beyond this belong to edges and to what was seen through something.
_SCALE = 0.1
# Places to begin at of each kind, and those of all that are gone on from.
_STARTS, _TRIED = 60, 8


@dataclass(frozen=True)
class DensityFit:
    """A place and an axis, and how well they explain the densities."""

    #: (3,) metres.
    place: Float64
    #: (3,) unit vector that rows go about.
    axis: Float64
    #: Median of the residuals' sizes, in logarithms of densities.
    misfit: float


def axes_about(axis: Float64) -> Float64:
    """Rows: two directions across the axis (3,) and the axis, right-handed."""
    first = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis])


def tilted(axis: Float64, tilt: Float64) -> Float64:
    """Tilt an axis (3,) by two small numbers along the directions across it."""
    turned = axis + tilt @ axes_about(axis)[:2]
    return np.asarray(turned / np.linalg.norm(turned))


def _residuals(unknowns: Float64, pieces: Neighbourhoods, log_density: Float64, axis: Float64) -> Float64:
    """Of a place and, if there are five unknowns, two tilts of the axis."""
    ray = pieces.centres - unknowns[:3]
    distance = np.maximum(np.linalg.norm(ray, axis=1), 1e-3)
    cosine = np.abs(np.einsum("mi,mi->m", ray, pieces.normals)) / distance
    expected = np.log(np.maximum(cosine, _LEAST_COSINE)) - 2.0 * np.log(distance)
    if len(unknowns) == 5:
        axis = tilted(axis, unknowns[3:])
    expected -= 0.5 * np.log(np.maximum(1.0 - (ray @ axis / distance) ** 2, 1e-3))
    residual = log_density - expected
    return np.asarray(residual - np.median(residual))


def places_by_density(
    pieces: Neighbourhoods, axes: list[Float64], rng: np.random.Generator
) -> list[DensityFit]:
    """Explain the densities by a place and an axis near one of the given ones; the best first."""
    log_density = np.log(pieces.density)
    places = _starts(pieces, rng)

    def misfit(unknowns: Float64, axis: Float64) -> float:
        return float(np.median(np.abs(_residuals(unknowns, pieces, log_density, axis))))

    def fitted(start: Float64, axis: Float64) -> Float64:
        given = (pieces, log_density, axis)
        found = least_squares(_residuals, start, loss="cauchy", f_scale=_SCALE, max_nfev=40, args=given)
        return np.asarray(found.x)

    found: list[DensityFit] = []
    for axis in axes:
        order = np.argsort([misfit(place, axis) for place in places])
        for start in places[order[:_TRIED]]:
            level = fitted(start, axis)
            if any(np.linalg.norm(level - one.place) < 0.02 for one in found):
                continue
            free = fitted(np.append(level, [0.0, 0.0]), axis)
            found.append(DensityFit(free[:3], tilted(axis, free[3:]), misfit(free, axis)))
    return sorted(found, key=lambda one: one.misfit)


def _starts(pieces: Neighbourhoods, rng: np.random.Generator) -> Float64:
    """Where points are dense, between any two surfaces, and on either side of a ground that is all there is."""
    weight = pieces.density / pieces.density.sum()
    drawn = pieces.centres[rng.choice(len(pieces), (_STARTS, 6), p=weight)].mean(axis=1)
    between = pieces.centres[rng.integers(len(pieces), size=(_STARTS, 2))].mean(axis=1)
    near = rng.choice(len(pieces), _STARTS, p=weight)
    height = np.exp(rng.uniform(np.log(0.3), np.log(6.0), _STARTS)) * rng.choice([-1.0, 1.0], _STARTS)
    above = pieces.centres[near] + height[:, None] * pieces.normals[near]
    return np.concatenate([[weight @ pieces.centres], drawn, between, above])
