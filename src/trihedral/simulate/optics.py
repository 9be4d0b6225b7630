"""Beams followed through panes and mirrors to the surface that sends them back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float32, Float64
from trihedral.simulate.material import MIRRORS, TRANSMITS, looks
from trihedral.simulate.tracer import Tracer, dot

STEP_M = 1e-3  # past a pane before looking on; nothing in a scene lies closer behind one
PANES = 6  # a beam that met more is given up


def fresnel(cosine: Float64, index: float = 1.5) -> Float64:
    """Share of unpolarised light that one surface of glass reflects (Fresnel's equations)."""
    refracted = np.sqrt(1.0 - (1.0 - cosine * cosine) / index**2)
    s = (cosine - index * refracted) / (cosine + index * refracted)
    p = (index * cosine - refracted) / (index * cosine + refracted)
    return np.asarray((s * s + p * p) / 2)


def pane_reflects(cosine: Float64) -> Float64:
    """Share that a pane with two surfaces reflects, back and forth inside it included."""
    one = fresnel(cosine)
    return np.asarray(2 * one / (1 + one))


@dataclass(frozen=True)
class Path:
    """Where (N,) beams end."""

    #: The surface that scatters them back, -1 for none.
    face: NDArray[np.int32]
    #: Optical path to it, metres, panes' delays included.
    distance: Float64
    #: (N, 3) the place on that surface.
    point: Float64
    #: Of the incidence on it.
    cosine: Float64
    #: Of the light that arrives there, one way, 0..1.
    share: Float64
    #: First pane or mirror met on the way, -1 for none.
    pane: NDArray[np.int32]
    #: Whether the beam was sent elsewhere by a mirror.
    mirrored: NDArray[np.bool_]


def follow(
    tracer: Tracer,
    origins: Float64,
    directions: Float64,
    first: tuple[NDArray[np.int32], Float64] | None = None,
    pane_delay: float = 0.0,
) -> Path:
    """Follow beams, (N, 3) with unit directions, to the surface that scatters them.

    `first` is what `Tracer.cast` said of these rays, if it is known; each pane adds `pane_delay` metres.
    """
    face, step = tracer.cast(origins, directions) if first is None else (first[0].copy(), first[1].copy())
    n, distance = len(face), step.copy()
    share, pane, mirrored = np.ones(n), np.full(n, -1, np.int32), np.zeros(n, bool)
    material = tracer.mesh.material
    live = np.flatnonzero(face >= 0)
    live = live[(TRANSMITS | MIRRORS)[material[face[live]]]]
    direction = directions.copy() if len(live) else directions
    start = origins.copy() if len(live) else origins
    for _ in range(PANES):
        if not len(live):
            break
        f = face[live]
        pane[live] = np.where(pane[live] < 0, f, pane[live])
        normal = tracer.planes.normal[f]
        along = dot(direction[live], normal)
        turned = MIRRORS[material[f]]
        share[live] *= np.where(turned, 0.85, 1.0 - pane_reflects(np.abs(along)))
        start[live] += step[live, None] * direction[live]
        direction[live] -= np.where(turned, 2.0 * along, 0.0)[:, None] * normal
        mirrored[live] |= turned
        start[live] += STEP_M * direction[live]
        face[live], step[live] = tracer.cast(start[live], direction[live])
        distance[live] += step[live] + STEP_M + np.where(turned, 0.0, pane_delay)
        live = live[face[live] >= 0]
        live = live[(TRANSMITS | MIRRORS)[material[face[live]]]]
    face[live], distance[live], step[live] = -1, np.inf, np.inf
    safe = np.where(np.isfinite(step), step, 0.0)
    point = start + safe[:, None] * direction
    cosine = np.abs(dot(direction, tracer.planes.normal[face]))
    return Path(face, distance, point, cosine, share, pane, mirrored)


def looks_at(
    tracer: Tracer, face: NDArray[np.int32], point: Float64, size: Float64
) -> tuple[Float32, Float32]:
    """Albedo (N, 3) and reflectance (N,) of points on faces, for samples of `size` (N,) metres."""
    planes, mesh = tracer.planes, tracer.mesh
    gradient, local = planes.gradient[face], point - planes.corner[face]
    uv = planes.uv[face] + np.stack([dot(gradient[:, 0], local), dot(gradient[:, 1], local)], axis=1)
    return looks(mesh.material[face], mesh.texture[face], uv.astype(np.float32), size.astype(np.float32))
