"""How much light falls on surfaces, and how it differs from one hour to the next."""

import math
from dataclasses import replace

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.simulate.mesh import Rng
from trihedral.simulate.scene import Lamp, Light
from trihedral.simulate.tracer import Tracer, dot

_SHADOW_START_M = 2e-3  # off the surface, so that it does not shade itself
# Lamps of another hour stand within this of the station, and this far above it (m).
_LAMPS_WITHIN_M = 8.0
_LAMPS_ABOVE_M = (0.3, 2.0)


def falling_light(
    tracer: Tracer, light: Light, point: Float64, normal: Float64, *, shadows: bool
) -> list[Float64]:
    """Red, green and blue light, (N,) each, that falls on (N, 3) points whose (N, 3) unit normals face the viewer.

    `shadows` are the sun's; a lamp indoors stands for many and casts none.
    """
    towards = np.broadcast_to(np.array(light.towards_sun), normal.shape)
    sun = np.maximum(0.0, dot(normal, towards))
    if shadows:
        bright = np.flatnonzero(sun > 0)
        begin = point[bright] + _SHADOW_START_M * normal[bright]
        hidden, _ = tracer.cast(begin, towards[bright])
        sun[bright[hidden >= 0]] = 0.0
    lamps = np.zeros(len(point))
    for lamp in light.lamps:
        away = np.array(lamp.place) - point
        square = dot(away, away)
        lamps += lamp.strength * np.maximum(0.0, dot(away, normal)) / np.sqrt(square) / (1.0 + square)
    return [
        around + light.above * normal[:, 2] + strength * sun + lamps
        for around, strength in zip(light.around, light.sun, strict=True)
    ]


def at_another_hour(light: Light, place: Float64, rng: Rng) -> Light:
    """Draw a light for the scan from a place: another sun, more or less light all around, lamps near by."""
    heading, elevation = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(15.0, 75.0))
    level = math.cos(elevation)
    lamps = tuple(
        Lamp(
            (
                float(place[0] + rng.uniform(-_LAMPS_WITHIN_M, _LAMPS_WITHIN_M)),
                float(place[1] + rng.uniform(-_LAMPS_WITHIN_M, _LAMPS_WITHIN_M)),
                float(place[2] + rng.uniform(*_LAMPS_ABOVE_M)),
            ),
            float(rng.uniform(0.5, 4.0)),
        )
        for _ in range(int(rng.integers(0, 4)))
    )

    def tinted(color: tuple[float, float, float], least: float, most: float) -> tuple[float, float, float]:
        strength, warmth = rng.uniform(least, most), rng.uniform(-0.15, 0.15)
        red, green, blue = (float(strength * value) for value in color)
        return red * (1 + warmth), green, blue * (1 - warmth)

    return replace(
        light,
        around=tinted(light.around, 0.6, 1.2),
        sun=tinted(light.sun, 0.3, 1.8),
        towards_sun=(level * math.cos(heading), level * math.sin(heading), math.sin(elevation)),
        lamps=lamps,
    )
