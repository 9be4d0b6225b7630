"""What surfaces look like to the laser and to a camera: procedural textures evaluated where beams hit.

Colours are albedos, 0..1, before a camera's tone curve; reflectances are those at a laser's near infrared
wavelength: asphalt reflects a tenth to a fifth, concrete and brick a third to a half, leaves about a half,
white paint three quarters and more.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float32, Uint32
from trihedral.simulate.mesh import OBJECT_BITS
from trihedral.simulate.noise import cell_noise, hash32, unit, value_noise

Look = tuple[
    Float32, Float32, Float32 | None
]  # mix of the two colours 0..1, tone about 1, own colours (N, 3)
Pattern = Callable[[Float32, Float32, Uint32, Float32], Look]

_ONE = np.float32(1.0)


@dataclass(frozen=True)
class Material:
    """One material; a pattern mixes its two colours."""

    name: str
    color: tuple[float, float, float]
    reflectance: float
    pattern: Pattern
    #: None: the first colour.
    color2: tuple[float, float, float] | None = None
    #: None: the first reflectance.
    reflectance2: float | None = None
    #: How much the colour differs from surface to surface, 0..1.
    variety: float = 0.0
    #: Share of the returned light that is mirror-like, 0..1.
    gloss: float = 0.0
    #: A pane of glass.
    transmits: bool = False
    #: Sends the beam on; hardly any of it comes straight back.
    mirror: bool = False


def _fade(wavelength: float, pixel: Float32) -> Float32:
    """Say what is left of a detail of this size when one sample covers `pixel` metres."""
    return np.asarray(np.minimum(_ONE, np.float32(wavelength / 2.5) / pixel))


def _patches(
    u: Float32, v: Float32, seed: Uint32, pixel: Float32, waves: tuple[tuple[float, float], ...]
) -> Float32:
    """Sum smooth noises: (wavelength, amplitude) each."""
    total = np.zeros_like(u)
    for k, (wavelength, amplitude) in enumerate(waves):
        part = value_noise(u, v, wavelength, seed + np.uint32(77 * k + 1))
        part *= np.float32(amplitude) * _fade(wavelength, pixel)
        total += part
    return total


def _cells(
    u: Float32, v: Float32, width: float, height: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], Float32, Float32]:
    """Cell numbers and the distances to the cell's left and lower sides, metres."""
    i, j = np.floor(u * np.float32(1 / width)), np.floor(v * np.float32(1 / height))
    return i.astype(np.int32), j.astype(np.int32), u - i * np.float32(width), v - j * np.float32(height)


def _line(distance: Float32, period: float, width: float, pixel: Float32) -> Float32:
    """1 on a joint of this width at the sides of a period, softened by the sample's size."""
    nearest = np.minimum(distance, np.float32(period) - distance)
    soft = np.maximum(pixel, np.float32(0.004))
    inside = np.clip((np.float32(width / 2) - nearest) / soft + np.float32(0.5), 0, 1)
    return np.asarray(inside * _fade(max(width, 0.01) * 2.5, pixel), np.float32)


def _plain(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    tone = _patches(u, v, seed, pixel, ((1.7, 0.035), (0.35, 0.02), (0.05, 0.02)))
    scuffs = value_noise(u, v, 0.22, seed + np.uint32(9))
    tone -= np.float32(0.25) * np.maximum(0, scuffs - np.float32(0.72)) * _fade(0.2, pixel) * 2
    return np.zeros_like(u), tone + _ONE, None


def _concrete(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    mix = np.float32(0.45) + _patches(u, v, seed, pixel, ((1.3, 0.35), (0.33, 0.22), (0.09, 0.12)))
    tone = _ONE + _patches(u, v, seed + np.uint32(5), pixel, ((0.03, 0.10),))
    i, j, a, b = _cells(u, v, 2.4, 1.2)
    tone *= _ONE - np.float32(0.25) * np.maximum(_line(a, 2.4, 0.012, pixel), _line(b, 1.2, 0.012, pixel))
    tone *= np.float32(0.94) + np.float32(0.12) * cell_noise(i, j, seed)
    _, _, c, d = _cells(u + np.float32(0.6), v + np.float32(0.3), 1.2, 0.6)
    hole = (c - np.float32(0.6)) ** 2 + (d - np.float32(0.3)) ** 2 < np.float32(0.02**2)
    tone *= _ONE - np.float32(0.5) * hole * _fade(0.06, pixel)
    return np.clip(mix, 0, 1), tone, None


def _rough_ground(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    mix = np.float32(0.5) + _patches(u, v, seed, pixel, ((3.1, 0.3), (0.8, 0.3), (0.2, 0.25)))
    tone = _ONE + _patches(u, v, seed + np.uint32(3), pixel, ((0.06, 0.2), (0.025, 0.2)))
    return np.clip(mix, 0, 1), tone, None


def _asphalt(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    mix = np.float32(0.4) + _patches(u, v, seed, pixel, ((2.3, 0.25), (0.5, 0.15)))
    tone = _ONE + _patches(u, v, seed + np.uint32(3), pixel, ((0.05, 0.12), (0.02, 0.2)))
    patch = value_noise(u, v, 2.9, seed + np.uint32(31)) > np.float32(0.55)
    tone *= _ONE - np.float32(0.28) * patch
    return np.clip(mix, 0, 1), tone, None


def _brick(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    width, height = 0.25, 0.083
    course = np.floor(v * np.float32(1 / height)).astype(np.int32)
    i, j, a, b = _cells(u + (course & 1).astype(np.float32) * np.float32(width / 2), v, width, height)
    joint = np.maximum(_line(a, width, 0.012, pixel), _line(b, height, 0.012, pixel))
    own = (cell_noise(i, j, seed) - np.float32(0.5)) * _fade(height * 2, pixel)
    tone = _ONE + np.float32(0.5) * own
    tone += _patches(u, v, seed, pixel, ((1.9, 0.12), (0.4, 0.06), (0.03, 0.07)))
    return joint, tone, None


def _blocks(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    i, j, a, b = _cells(u, v, 0.62, 0.31)
    joint = np.maximum(_line(a, 0.62, 0.008, pixel), _line(b, 0.31, 0.008, pixel))
    own = cell_noise(i, j, seed) - np.float32(0.5)
    tone = _ONE + np.float32(0.22) * own
    tone += _patches(u, v, seed, pixel, ((1.1, 0.12), (0.21, 0.08), (0.04, 0.06)))
    return joint, tone, None


def _wood(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    i, _, a, _ = _cells(v, u, 0.145, 5.0)
    plank = hash32(i.view(np.uint32), seed)
    grain = value_noise(u * np.float32(0.08), v, 0.018, plank) * _fade(0.02, pixel)
    rings = value_noise(u * np.float32(0.3), v, 0.07, plank + np.uint32(3)) * _fade(0.07, pixel)
    knots = value_noise(u, v, 0.11, plank + np.uint32(5)) > np.float32(0.83)
    tone = np.float32(0.88) + np.float32(0.24) * unit(plank) + np.float32(0.09) * grain
    tone *= _ONE - np.float32(0.4) * knots * _fade(0.08, pixel)
    tone *= _ONE - np.float32(0.55) * _line(a, 0.145, 0.006, pixel)
    return np.clip(np.float32(0.4) + np.float32(0.5) * rings, 0, 1), tone, None


def _ply(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    i, j, a, b = _cells(u, v, 2.5, 1.25)
    sheet = hash32(i.view(np.uint32) + j.view(np.uint32) * np.uint32(7919), seed)
    mix = np.float32(0.4) + _patches(u * np.float32(0.25), v, sheet, pixel, ((0.35, 0.35), (0.06, 0.2)))
    tone = np.float32(0.85) + np.float32(0.3) * unit(sheet)
    splash = value_noise(u, v, 0.4, sheet + np.uint32(2)) > np.float32(0.5)
    tone *= _ONE + np.float32(0.35) * splash
    tone *= _ONE - np.float32(0.5) * np.maximum(_line(a, 2.5, 0.008, pixel), _line(b, 1.25, 0.008, pixel))
    return np.clip(mix, 0, 1), tone, None


def _tiles(size: float, joint_width: float, spread: float) -> Pattern:
    def look(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
        i, j, a, b = _cells(u, v, size, size)
        joint = np.maximum(_line(a, size, joint_width, pixel), _line(b, size, joint_width, pixel))
        tone = _ONE + np.float32(spread) * (cell_noise(i, j, seed) - np.float32(0.5))
        tone += _patches(u, v, seed, pixel, ((1.6, 0.05), (0.25, 0.04), (0.03, 0.05)))
        return joint, tone, None

    return look


def _carpet(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    i, j, _, _ = _cells(u, v, 0.5, 0.5)
    own = cell_noise(i, j, seed)
    mix = np.clip(own * np.float32(0.5) + _patches(u, v, seed, pixel, ((2.2, 0.25), (0.6, 0.15))), 0, 1)
    stripe = value_noise(np.where(own > np.float32(0.5), u, v), own, 0.02, seed + np.uint32(4))
    tone = _ONE + np.float32(0.2) * stripe * _fade(0.02, pixel)
    return mix, np.asarray(tone, np.float32), None


def _sign(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    """Paint a board with a block picture and lines of glyph-like marks."""
    base = unit(seed)
    rgb = np.stack([unit(hash32(seed, np.uint32(k))) for k in (11, 12, 13)], axis=1)
    rgb = np.float32(0.25) + np.float32(0.7) * rgb
    i, j, _, _ = _cells(u, v, 0.19, 0.19)
    picture = np.stack([cell_noise(i, j, hash32(seed, np.uint32(k))) for k in (21, 22, 23)], axis=1)
    shapes = value_noise(u, v, 0.23, seed + np.uint32(8)) > np.float32(0.1)
    drawn = cell_noise(i >> 1, j >> 1, seed + np.uint32(6)) > np.float32(0.45)
    rgb = np.where((drawn & shapes)[:, None], picture, rgb)
    gi, gj, _, _ = _cells(u, v, 0.021, 0.021)
    row = gj % 3
    ink = (cell_noise(gi, gj, seed + np.uint32(41)) > np.float32(0.5)) & (row != 0) & ~drawn
    rgb = rgb * (_ONE - (np.float32(0.85) * ink * _fade(0.04, pixel))[:, None])
    return base * 0, np.asarray(rgb.mean(axis=1) * np.float32(0.8) + np.float32(0.4), np.float32), rgb


def _books(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    """Upright spines of many widths and colours."""
    shift = value_noise(u, v * 0, 0.13, seed) * np.float32(0.02)
    i, j, a, b = _cells(u + shift, v, 0.037, 0.36)
    own = [cell_noise(i, j, hash32(seed, np.uint32(k))) for k in (1, 2, 3, 4)]
    rgb = np.float32(0.12) + np.float32(0.75) * np.stack(own[:3], axis=1)
    top = np.float32(0.2) + np.float32(0.12) * own[3]
    dark = (b > top) | (own[3] < np.float32(0.08))
    label = np.abs(b - top * np.float32(0.7)) < np.float32(0.02)
    tone = np.where(dark, np.float32(0.25), np.where(label, np.float32(1.35), _ONE)).astype(np.float32)
    tone *= _ONE - np.float32(0.5) * _line(a, 0.037, 0.004, pixel)
    return own[0] * 0, tone, rgb


def _leaf(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    own = unit(hash32(seed, np.uint32(3)))
    return own, np.float32(0.7) + np.float32(0.6) * unit(hash32(seed, np.uint32(4))), None


def _bark(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    ridges = value_noise(u, v * np.float32(0.2), 0.03, seed) * _fade(0.03, pixel)
    mix = np.float32(0.5) + np.float32(0.4) * ridges + _patches(u, v, seed, pixel, ((0.5, 0.3),))
    return np.clip(mix, 0, 1), _ONE + np.float32(0.15) * ridges, None


def _ribbed(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    """Painted corrugated or panelled metal with rust and scratches."""
    _, _, a, _ = _cells(u, v, 0.28, 10.0)
    tone = _ONE - np.float32(0.18) * _line(a, 0.28, 0.06, pixel)
    tone += _patches(u, v, seed, pixel, ((1.5, 0.08), (0.2, 0.05)))
    rust = _patches(u, v * np.float32(0.4), seed + np.uint32(7), pixel, ((0.5, 0.8), (0.12, 0.5)))
    return np.clip((rust - np.float32(0.55)) * 3, 0, 1), tone, None


def _metal(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    mix = np.clip(_patches(u, v, seed, pixel, ((0.6, 0.5), (0.1, 0.4))), 0, 1)
    return mix, _ONE + _patches(u, v, seed, pixel, ((0.3, 0.06),)), None


def _panel(u: Float32, v: Float32, seed: Uint32, pixel: Float32) -> Look:
    i, j, a, b = _cells(u, v, 0.6, 0.6)
    joint = np.maximum(_line(a, 0.6, 0.015, pixel), _line(b, 0.6, 0.015, pixel))
    dots = value_noise(u, v, 0.02, seed) > np.float32(0.45)
    tone = np.float32(0.98) + np.float32(0.05) * cell_noise(i, j, seed)
    tone -= np.float32(0.12) * dots * _fade(0.02, pixel)
    stain = value_noise(u, v, 0.5, seed + np.uint32(2)) > np.float32(0.78)
    return joint, tone * (_ONE - np.float32(0.12) * stain), None


MATERIALS: tuple[Material, ...] = (
    Material("paint", (0.82, 0.81, 0.77), 0.78, _plain, variety=0.10),
    Material("paint-dark", (0.35, 0.42, 0.48), 0.45, _plain, variety=0.5),
    Material("plaster", (0.75, 0.66, 0.52), 0.62, _concrete, (0.66, 0.58, 0.47), 0.55, variety=0.45),
    Material("concrete", (0.58, 0.57, 0.54), 0.42, _concrete, (0.40, 0.39, 0.37), 0.30, variety=0.12),
    Material("brick", (0.55, 0.27, 0.19), 0.42, _brick, (0.62, 0.60, 0.55), 0.46, variety=0.3),
    Material("blocks", (0.60, 0.60, 0.58), 0.45, _blocks, (0.48, 0.47, 0.45), 0.38, variety=0.1),
    Material(
        "stone", (0.63, 0.58, 0.49), 0.48, _tiles(0.55, 0.012, 0.3), (0.36, 0.34, 0.30), 0.33, variety=0.2
    ),
    Material("wood", (0.62, 0.44, 0.26), 0.55, _wood, (0.42, 0.27, 0.14), 0.47, variety=0.35),
    Material("ply", (0.66, 0.47, 0.25), 0.55, _ply, (0.47, 0.31, 0.15), 0.47, variety=0.25),
    Material(
        "tiles",
        (0.70, 0.69, 0.66),
        0.50,
        _tiles(0.45, 0.006, 0.10),
        (0.42, 0.41, 0.39),
        0.35,
        variety=0.2,
        gloss=0.1,
    ),
    Material(
        "paving", (0.52, 0.51, 0.49), 0.36, _tiles(0.4, 0.012, 0.25), (0.30, 0.29, 0.27), 0.25, variety=0.1
    ),
    Material("carpet", (0.28, 0.30, 0.36), 0.30, _carpet, (0.40, 0.41, 0.44), 0.38, variety=0.5),
    Material("ceiling", (0.88, 0.88, 0.86), 0.80, _panel, (0.60, 0.60, 0.58), 0.55, variety=0.04),
    Material("asphalt", (0.20, 0.20, 0.21), 0.16, _asphalt, (0.30, 0.29, 0.28), 0.22),
    Material("earth", (0.45, 0.34, 0.23), 0.34, _rough_ground, (0.30, 0.22, 0.15), 0.24, variety=0.15),
    Material("gravel", (0.55, 0.53, 0.50), 0.38, _rough_ground, (0.38, 0.36, 0.33), 0.27, variety=0.1),
    Material("grass", (0.26, 0.36, 0.13), 0.48, _rough_ground, (0.38, 0.40, 0.20), 0.42),
    Material("leaf", (0.20, 0.36, 0.10), 0.50, _leaf, (0.42, 0.47, 0.16), 0.45, variety=0.15),
    Material("bark", (0.30, 0.24, 0.18), 0.36, _bark, (0.45, 0.39, 0.31), 0.42, variety=0.2),
    Material("steel", (0.55, 0.56, 0.58), 0.50, _metal, (0.42, 0.33, 0.26), 0.35, variety=0.15, gloss=0.3),
    Material(
        "painted-metal", (0.62, 0.30, 0.16), 0.45, _ribbed, (0.32, 0.17, 0.09), 0.28, variety=0.9, gloss=0.15
    ),
    Material(
        "car-paint", (0.45, 0.45, 0.48), 0.35, _metal, (0.50, 0.50, 0.52), 0.38, variety=0.95, gloss=0.6
    ),
    Material("rubber", (0.07, 0.07, 0.07), 0.05, _plain, variety=0.1),
    Material("plastic", (0.20, 0.20, 0.22), 0.22, _plain, variety=0.5, gloss=0.2),
    Material("white-plastic", (0.85, 0.86, 0.87), 0.75, _plain, variety=0.08, gloss=0.15),
    Material("cloth", (0.35, 0.30, 0.42), 0.45, _carpet, (0.30, 0.27, 0.36), 0.40, variety=0.9),
    Material("skin", (0.72, 0.52, 0.42), 0.50, _plain, variety=0.3),
    Material("cardboard", (0.62, 0.48, 0.32), 0.55, _plain, variety=0.2),
    Material("sign", (0.6, 0.6, 0.6), 0.55, _sign),
    Material("books", (0.6, 0.6, 0.6), 0.45, _books),
    Material("screen", (0.05, 0.05, 0.06), 0.06, _plain, gloss=0.5),
    Material("lamp", (1.0, 1.0, 0.97), 0.70, _plain),
    Material("glass", (0.10, 0.12, 0.13), 0.10, _plain, gloss=0.9, transmits=True),
    Material("mirror", (0.10, 0.12, 0.13), 0.05, _plain, gloss=0.95, mirror=True),
)

INDEX: dict[str, int] = {m.name: k for k, m in enumerate(MATERIALS)}
TRANSMITS = np.array([m.transmits for m in MATERIALS])
MIRRORS = np.array([m.mirror for m in MATERIALS])
GLOSS = np.array([m.gloss for m in MATERIALS])
REFLECTANCE = np.array([m.reflectance for m in MATERIALS])


def looks(
    material: NDArray[np.int16], texture: Uint32, uv: Float32, pixel: Float32
) -> tuple[Float32, Float32]:
    """Albedo (N, 3) and reflectance (N,), float32 in 0..1, of surface points.

    They have material indices (N,), texture seeds (N,) and texture coordinates (N, 2) in metres; detail finer than
    `pixel` (N,), the size of the sample on the surface in metres, fades.
    """
    albedo = np.empty((len(material), 3), np.float32)
    reflectance = np.empty(len(material), np.float32)
    order = np.argsort(material, kind="stable")
    starts = np.flatnonzero(np.diff(material[order], prepend=-1))
    for start, stop in zip(starts, np.append(starts[1:], len(order)), strict=False):
        at = order[start:stop]
        kind = MATERIALS[material[at[0]]]
        seed = texture[at]
        u, v = np.ascontiguousarray(uv[at, 0]), np.ascontiguousarray(uv[at, 1])
        mix, tone, own = kind.pattern(u, v, seed, np.maximum(pixel[at], np.float32(1e-4)))
        second = kind.color if kind.color2 is None else kind.color2
        # The colour varies from object to object, the pattern from surface to surface.
        whole = hash32(seed >> np.uint32(32 - OBJECT_BITS), np.uint32(material[at[0]]))
        if own is None:
            for c in range(3):
                first = np.float32(kind.color[c])
                if kind.variety:
                    shift = unit(hash32(whole, np.uint32(101 + c))) - np.float32(0.5)
                    own_c = np.clip(first + np.float32(kind.variety * 0.6) * shift, 0.03, 0.97)
                    base = own_c + mix * (np.float32(second[c] / max(kind.color[c], 0.02)) * own_c - own_c)
                else:
                    base = first + mix * np.float32(second[c] - kind.color[c])
                albedo[at, c] = base * tone
        else:
            albedo[at] = own * tone[:, None] if kind.pattern is _books else own
        other = kind.reflectance if kind.reflectance2 is None else kind.reflectance2
        rho = np.float32(kind.reflectance) + mix * np.float32(other - kind.reflectance)
        if kind.variety:
            shift = unit(hash32(whole, np.uint32(201))) - np.float32(0.5)
            rho *= _ONE + np.float32(kind.variety * 0.5) * shift
        reflectance[at] = rho * (_ONE + np.float32(0.8) * (tone - _ONE))
    np.clip(albedo, 0.01, 1.0, out=albedo)
    np.clip(reflectance, 0.02, 0.98, out=reflectance)
    return albedo, reflectance
