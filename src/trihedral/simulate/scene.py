"""What there is to scan: what stands, what moves between scans, light, and where a tripod can be put."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from trihedral.geometry.arrays import Float64
from trihedral.simulate.mesh import Mesh, Rng, placement


@dataclass(frozen=True)
class Lamp:
    """A bare bulb, which casts no shadows."""

    #: Project frame, metres.
    place: tuple[float, float, float]
    #: Near it; falls off with 1 + the square of the distance in metres.
    strength: float


@dataclass(frozen=True)
class Light:
    """Mild shading: light from all around, more from above, and one far lamp or sun."""

    #: Red, green, blue.
    around: tuple[float, float, float] = (0.55, 0.56, 0.58)
    #: Added to surfaces that face up, taken from those that face down.
    above: float = 0.15
    sun: tuple[float, float, float] = (0.45, 0.43, 0.38)
    #: Unit vector.
    towards_sun: tuple[float, float, float] = (0.48, 0.36, 0.8)
    lamps: tuple[Lamp, ...] = ()


INDOORS = Light((0.62, 0.60, 0.56), 0.05, (0.18, 0.18, 0.18), (0.2, 0.45, 0.87))


def daylight(heading: float, level: float, up: float) -> Light:
    """Light in the open; `level` and `up` are the parts of the unit vector to the sun, its heading in radians."""
    towards_sun = (level * math.cos(heading), level * math.sin(heading), up)
    return Light((0.50, 0.52, 0.56), 0.18, (0.55, 0.52, 0.45), towards_sun)


@dataclass(frozen=True)
class Mover:
    """A thing that stands elsewhere, or otherwise, at each scan."""

    #: In its own frame.
    mesh: Mesh
    #: Draws a 4x4 `project_from_part` for one scan, or None where it is out of sight.
    place: Callable[[Rng], Float64 | None]


def movers(
    rng: Rng, make: Callable[[Rng], Mesh], place: Callable[[Rng], Float64 | None], least: int, below: int
) -> tuple[Mover, ...]:
    """Make a random number of things that move."""
    return tuple(Mover(make(rng), place) for _ in range(int(rng.integers(least, below))))


def anywhere(places: Float64) -> Callable[[Rng], Float64]:
    """Draw one of (N, 3) places, turned any way."""

    def place(rng: Rng) -> Float64:
        x, y, z = places[int(rng.integers(len(places)))]
        return placement(x, y, z, rng.uniform(0, 2 * math.pi))

    return place


@dataclass(frozen=True)
class Scene:
    """A site."""

    name: str
    seed: int
    #: What stands still; centred near the origin, metres, z up.
    mesh: Mesh
    #: What does not.
    movers: tuple[Mover, ...]
    light: Light
    #: (N, 3) places on the ground or a floor where a tripod may be put; some may turn out to be blocked.
    stands: Float64
    #: Metres from one station to the next that people would choose here.
    reach: float
