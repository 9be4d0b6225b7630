"""What there is to scan: what stands, what moves between scans, light, and where a tripod can be put."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.simulate.mesh import Mesh

Float = NDArray[np.float64]
Rng = np.random.Generator


@dataclass(frozen=True)
class Lamp:
    """A bare bulb, which casts no shadows."""

    place: tuple[float, float, float]  # project frame, metres
    strength: float  # near it; falls off with 1 + the square of the distance in metres


@dataclass(frozen=True)
class Light:
    """Mild shading: light from all around, more from above, and one far lamp or sun."""

    around: tuple[float, float, float] = (0.55, 0.56, 0.58)  # red, green, blue
    above: float = 0.15  # added to surfaces that face up, taken from those that face down
    sun: tuple[float, float, float] = (0.45, 0.43, 0.38)
    towards_sun: tuple[float, float, float] = (0.48, 0.36, 0.8)  # unit vector
    lamps: tuple[Lamp, ...] = ()


@dataclass(frozen=True)
class Mover:
    """A thing that stands elsewhere, or otherwise, at each scan.

    Attributes
    ----------
    mesh
        In its own frame.
    place
        Draws a 4x4 `project_from_part` for one scan, or None where it is out of sight.
    """

    mesh: Mesh
    place: Callable[[Rng], Float | None]


@dataclass(frozen=True)
class Scene:
    """A site.

    Attributes
    ----------
    name, seed
        How it was made.
    mesh
        What stands still; centred near the origin, metres, z up.
    movers
        What does not.
    light
        For the colours.
    stands
        (N, 3) places on the ground or a floor where a tripod may be put; some may turn out to be blocked.
    reach
        Metres from one station to the next that people would choose here.
    """

    name: str
    seed: int
    mesh: Mesh
    movers: tuple[Mover, ...]
    light: Light
    stands: Float
    reach: float
