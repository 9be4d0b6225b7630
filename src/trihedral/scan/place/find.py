"""The search: about, by density; then by the pattern of directions, in windows that grow."""

from dataclasses import dataclass

import numpy as np

from trihedral.geometry.arrays import Bool, Float64
from trihedral.scan.place.density import places_by_density
from trihedral.scan.place.lattice import Lattice, first_lattice, refined
from trihedral.scan.place.neighbourhoods import Neighbourhoods, neighbourhoods

_PIECES, _NEIGHBOURS, _LEAST_PIECES = 3000, 48, 100
# Points of a piece that its steps and a first fit are taken from.
_NEAREST = 12
_SAMPLE = 40_000
# Phases of the pattern are one within windows of this size, radians: each stage begins at a place known better.
_WINDOWS = (np.radians(2.0), np.radians(10.0), np.radians(30.0))
# Windows that tell whether a point is on the pattern.
_CHECKED = np.radians(5.0)
# Below this a pattern is not believed; above that, no other is looked for.
_COHERENT, _PLAIN = 0.35, 0.8
# Thinning in space evens out the densest: if all pieces lead nowhere, these shares of the thinnest are tried.
_SHARES = (1.0, 0.5, 0.25)
# A fit of densities that leaves more than this is tried about other axes too.
_MISFIT = 0.06
# Formal sigmas leave out what an instrument's axes err by; metres.
_SIGMA_SCALE, _LEAST_SIGMA = 2.0, 1e-4
# Metres: a place that is known worse than this is none.
_MOST_SIGMA = 0.01
# Share of points off the pattern that may have been seen from elsewhere, and the fewest of them.
STRANGE, _LEAST_STRANGE = 0.1, 3000
# Metres between two places of a scanner.
_APART = 0.05


@dataclass(frozen=True)
class FoundPlace:
    """Where a scanner stood, as the points have it.

    Attributes
    ----------
    place
        (3,) metres.
    sigma
        (3,) standard deviations, metres.
    lattice
        The pattern that told it.
    """

    place: Float64
    sigma: Float64
    lattice: Lattice


def find_place(points: Float64, rng: np.random.Generator) -> FoundPlace | None:
    """Find where points (N, 3) were seen from; None where no pattern of directions tells it."""
    pieces = neighbourhoods(points, rng, _PIECES, _NEIGHBOURS)
    best: Lattice | None = None
    for share in _SHARES:
        used = pieces.of(pieces.density <= np.quantile(pieces.density, share)) if len(pieces) else pieces
        if len(used) < _LEAST_PIECES:
            break
        up, x, y = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        fits = places_by_density(used, [up], rng)
        if share == 1.0 and fits[0].misfit > _MISFIT:
            fits = sorted([*fits, *places_by_density(used, [x, y], rng)], key=lambda fit: fit.misfit)
        for fit in fits[:4]:
            found = _pattern(fit.place, fit.axis, points, pieces, rng)
            if found is not None and (best is None or found.coherence.min() > best.coherence.min()):
                best = found
            if best is not None and best.coherence.min() > _PLAIN:
                return _believed(best)
        if best is not None:
            break
    return None if best is None else _believed(best)


def pattern_at(points: Float64, place: Float64, rng: np.random.Generator) -> FoundPlace | None:
    """Find the place near a given one; None where there is no pattern of directions."""
    pieces = neighbourhoods(points, rng, _PIECES, _NEIGHBOURS)
    if len(pieces) < _LEAST_PIECES:
        return None
    found = _pattern(place, np.array([0.0, 0.0, 1.0]), points, pieces, rng)
    return None if found is None else _believed(found)


def off_pattern(points: Float64, found: FoundPlace) -> Bool:
    """Tell which of points (N, 3) the pattern of a place leaves out: seen from elsewhere, or from there with noise."""
    return found.lattice.off(points, _CHECKED)


def second_place(points: Float64, first: FoundPlace, rng: np.random.Generator) -> FoundPlace | None:
    """Find another place that those of the points (N, 3) were seen from that the first one's pattern leaves out."""
    strange = points[off_pattern(points, first)]
    if len(strange) < max(_LEAST_STRANGE, STRANGE * len(points)):
        return None
    found = find_place(strange, rng)
    if found is None or found.lattice.coherence.min() < 0.5:
        return None
    apart = np.linalg.norm(found.place - first.place)
    return found if apart > _APART + 5.0 * np.linalg.norm([found.sigma, first.sigma]) else None


def _pattern(
    place: Float64, axis: Float64, points: Float64, pieces: Neighbourhoods, rng: np.random.Generator
) -> Lattice | None:
    lattice = first_lattice(pieces.members[:, : _NEAREST + 4], place, axis, rng)
    for count in (_NEAREST, _NEIGHBOURS):
        if lattice is None or not lattice.sound:
            return None
        members = pieces.members[:2000, :count]
        lattice = refined(
            lattice, members.reshape(-1, 3), np.repeat(np.arange(len(members)), members.shape[1])
        )
    sample = points[rng.choice(len(points), min(len(points), _SAMPLE), replace=False)]
    for size in _WINDOWS:
        if lattice is None or not lattice.sound:
            return None
        lattice = refined(lattice, sample, lattice.windows(sample, size))
    return lattice


def _believed(lattice: Lattice) -> FoundPlace | None:
    sigma = np.hypot(_SIGMA_SCALE * np.sqrt(np.maximum(np.diag(lattice.covariance), 0.0)), _LEAST_SIGMA)
    if lattice.coherence.min() < _COHERENT or not (sigma < _MOST_SIGMA).all():
        return None
    return FoundPlace(lattice.place, sigma, lattice)
