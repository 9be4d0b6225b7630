"""A camera in a scene: rays through a lens that distorts, lit and shaded surfaces, exposure, noise."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.fusion import camera as lens
from trihedral.geometry.arrays import Float32, Float64
from trihedral.scan import CameraModel
from trihedral.simulate.lighting import falling_light
from trihedral.simulate.mesh import rotated
from trihedral.simulate.noise import value_noise
from trihedral.simulate.optics import follow, looks_at
from trihedral.simulate.option_checks import check, not_negative
from trihedral.simulate.scanner import CHUNK
from trihedral.simulate.scene import Light
from trihedral.simulate.tracer import Tracer

# Rays a pixel over silhouettes, where one would leave a staircase.
_CORNERS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


@dataclass(frozen=True)
class Exposure:
    """How a picture is taken; the camera exposes by itself, so that pictures of one station differ."""

    #: Share of a picture's difference from mid-tone that the camera takes out, 0..1.
    automatic: float = 0.6
    #: One sigma of what it gets wrong, relative.
    spread: float = 0.05
    #: One sigma of the white balance, relative, each colour.
    white_spread: float = 0.015
    #: Share of the light that is missing in the corners, 0..1.
    vignette: float = 0.2
    #: One sigma at mid-tone, of full scale.
    noise: float = 0.008

    def __post_init__(self) -> None:
        check(
            "Exposure",
            [
                (0.0 <= self.automatic <= 1.0, "automatic must lie in 0..1"),
                (0.0 <= self.vignette <= 1.0, "vignette must lie in 0..1"),
                *not_negative(self, "spread", "white_spread", "noise"),
            ],
        )


def photograph(
    tracer: Tracer,
    light: Light,
    camera: CameraModel,
    project_from_camera: Float64,
    exposure: Exposure,
    seed: tuple[int, ...],
    *,
    shadows: bool,
) -> NDArray[np.uint8]:
    """Take a picture, (H, W, 3) red, green, blue, with any complete camera at a 4x4 pose.

    `seed` fixes noise and exposure; `shadows` are as for `falling_light`.
    """
    height, width = camera.height, camera.width
    rotation, origin = project_from_camera[:3, :3], project_from_camera[:3, 3]
    pixel = 1.0 / lens.pixels_per_radian(camera)
    lit = _Lit(tracer, light, origin, pixel, shadows)
    color, surface = lit.look(rotated(rotation, lens.pixel_rays(camera)))
    ids = surface.reshape(height, width)
    border = np.zeros((height, width), bool)
    border[:, :-1] |= ids[:, :-1] != ids[:, 1:]
    border[:, 1:] |= ids[:, :-1] != ids[:, 1:]
    border[:-1] |= ids[:-1] != ids[1:]
    border[1:] |= ids[:-1] != ids[1:]
    at = np.flatnonzero(border)
    if len(at):
        place = np.stack([at % width, at // width], axis=1).astype(np.float64)
        mean = np.zeros((len(at), 3), np.float32)
        for corner in _CORNERS:
            mean += lit.look(rotated(rotation, lens.rays(camera, place + corner)))[0]
        color[at] = mean / len(_CORNERS)
    return _exposed(color.reshape(height, width, 3), camera, exposure, seed)


def _exposed(
    color: Float32, camera: CameraModel, exposure: Exposure, seed: tuple[int, ...]
) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    middle = float(np.median(color))
    gain = (0.22 / max(middle, 0.02)) ** exposure.automatic * 1.5 ** (1.0 - exposure.automatic)
    gain *= 1.0 + exposure.spread * rng.standard_normal()
    white = 1.0 + exposure.white_spread * rng.standard_normal(3)
    height, width = camera.height, camera.width
    y, x = np.mgrid[:height, :width].astype(np.float32)
    radius2 = ((x - (width - 1) / 2) ** 2 + (y - (height - 1) / 2) ** 2) / (
        ((width - 1) / 2) ** 2 + ((height - 1) / 2) ** 2
    )
    shade = (1.0 - exposure.vignette * radius2)[..., None]
    tone = np.sqrt(np.clip(color * shade * (gain * white).astype(np.float32), 0.0, 1.0))
    noise = rng.standard_normal(tone.shape, np.float32) * np.float32(exposure.noise)
    return np.asarray(np.rint(np.clip(255.0 * (tone + noise), 0, 255)), np.uint8)


@dataclass(frozen=True)
class _Lit:
    """A scene under its light, from one place."""

    tracer: Tracer
    light: Light
    origin: Float64
    #: Radians that a pixel covers.
    pixel: float
    shadows: bool

    def look(self, directions: Float64) -> tuple[Float32, NDArray[np.int32]]:
        """Light (N, 3) that comes from (N, 3) unit directions, and the surface it comes from, -1 for the sky."""
        starts = range(0, len(directions), CHUNK)
        parts = [self._look(directions[start : start + CHUNK]) for start in starts]
        color, surface = (np.concatenate(of_parts) for of_parts in zip(*parts, strict=True))
        return color, surface

    def _look(self, directions: Float64) -> tuple[Float32, NDArray[np.int32]]:
        tracer = self.tracer
        path = follow(tracer, np.broadcast_to(self.origin, directions.shape), directions)
        color = self._sky(directions)
        met = np.flatnonzero(path.face >= 0)
        face, point = path.face[met], path.point[met]
        albedo, _ = looks_at(tracer, face, point, path.distance[met] * self.pixel)
        normal = tracer.facing(face, directions[met])
        falling = falling_light(tracer, self.light, point, normal, shadows=self.shadows)
        share = path.share[met]
        for c in range(3):
            # What a pane does not let through, it mirrors of the sky.
            color[met, c] = albedo[:, c] * falling[c] * share + color[met, c] * (1.0 - share)
        return color, tracer.surface(path.face)

    @staticmethod
    def _sky(directions: Float64) -> Float32:
        up = np.clip(directions[:, 2], 0.0, 1.0).astype(np.float32)
        flat = 1.0 / np.maximum(up + np.float32(0.15), 0.05)
        u = (directions[:, 0] * flat).astype(np.float32)
        v = (directions[:, 1] * flat).astype(np.float32)
        seed = np.full(len(up), 77, np.uint32)
        cloud = np.clip(0.5 + 0.4 * value_noise(u, v, 1.7, seed) + 0.2 * value_noise(u, v, 0.6, seed), 0, 1)
        blue = np.stack([0.42 - 0.22 * up, 0.55 - 0.2 * up, 0.78 - 0.1 * up], axis=1)
        return np.asarray(blue + (0.75 - blue) * (0.6 * cloud)[:, None], np.float32)


def typical_camera(width: int, height: int) -> CameraModel:
    """Give a camera of about 68 degrees across, with the distortion of a common wide lens."""
    focal = width / 2.0 / math.tan(math.radians(34.0))
    return CameraModel(
        "pinhole",
        width,
        height,
        focal=(focal, focal * 1.001),
        centre=(width * 0.503, height * 0.494),
        distortion=(-0.115, 0.042, 0.0006, -0.0009, -0.004),
    )
