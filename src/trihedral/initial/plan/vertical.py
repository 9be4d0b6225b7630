"""Which way is up in a scan, as its floors and walls have it."""

from dataclasses import dataclass

import numpy as np

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import rotation_between
from trihedral.scan.mounting import Z
from trihedral.scan.prepared import Prepared


@dataclass(frozen=True)
class VerticalOptions:
    """How the vertical is looked for."""

    #: Of the instrument (rad).
    largest_tilt: float = np.radians(25.0)
    #: A floor or wall may be off the level or the plumb line by so much (rad).
    tolerance: float = np.radians(2.0)
    #: Largest patches that suggest a vertical.
    candidates: int = 60
    #: The instrument is level if its own axis is borne out this well, against the best.
    level_share: float = 0.93

    def __post_init__(self) -> None:
        if not 0 < self.largest_tilt < np.pi / 2 or self.tolerance <= 0 or self.candidates < 1:
            raise OptionError(
                "largest_tilt must be between 0 and 90 degrees, tolerance and candidates positive"
            )
        if not 0 <= self.level_share <= 1:
            raise OptionError(f"level_share is a share between 0 and 1, not {self.level_share:g}")


def upright_rotations(
    prepared: Prepared, options: VerticalOptions | None = None, mounted: Float64 | None = None
) -> list[Float64]:
    """Rotations (3x3) that turn the scan upright, the most likely first.

    `mounted` (3x3) sets it upright but for a lean: by default as it is most likely mounted.

    Every large patch that may be level suggests its normal, every two that may be walls their cross product, and the
    instrument its own axis. A vertical is borne out by the area of patches that are level or upright under it. The
    instrument's axis is the only one if it is borne out nearly as well as the best, since most instruments are level.
    """
    options = options or VerticalOptions()
    mounted = prepared.mounting.rotation if mounted is None else mounted
    normals, areas = prepared.patches.normals @ mounted.T, prepared.patches.areas
    steepest = np.cos(options.largest_tilt)
    large = normals[: options.candidates]
    level = large[np.abs(large[:, 2]) > steepest]
    walls = large[np.abs(large[:, 2]) < np.sin(options.largest_tilt)][:12]
    first, second = np.triu_indices(len(walls), 1)
    cross = np.cross(walls[first], walls[second])
    length = np.linalg.norm(cross, axis=1)
    across = (length > 0.5) & (np.abs(cross[:, 2]) > steepest * length)
    suggested = np.concatenate([level, cross[across] / length[across, None]])
    candidates = np.concatenate([Z[None], suggested * np.sign(suggested[:, 2:])])

    scores = _support(candidates, normals, areas, options.tolerance)
    best = _refined(candidates[np.argmax(scores)], normals, areas, options.tolerance)
    best_score = _support(best[None], normals, areas, options.tolerance)[0]
    if scores[0] >= options.level_share * best_score:
        return [mounted]
    return [rotation_between(best, Z) @ mounted, mounted]


def _support(verticals: Float64, normals: Float64, areas: Float64, tolerance: float) -> Float64:
    """Area that is level or upright under each vertical, falling off with the angle; (V,)."""
    cosines = np.abs(verticals @ normals.T)
    off_level = np.arccos(np.clip(cosines, 0, 1))
    off = np.minimum(off_level, np.pi / 2 - off_level)
    # A root of the area: one broad sloping ground must not outvote the walls.
    support: Float64 = np.exp(-0.5 * (off / tolerance) ** 2) @ np.sqrt(areas)
    return support


def _refined(vertical: Float64, normals: Float64, areas: Float64, tolerance: float) -> Float64:
    """The vertical in best accord with the patches that bear it out: level ones along it, walls across it."""
    for _ in range(5):
        cosines = normals @ vertical
        off_level = np.arccos(np.clip(np.abs(cosines), 0, 1))
        off = np.minimum(off_level, np.pi / 2 - off_level)
        weights = np.sqrt(areas) * np.exp(-0.5 * (off / tolerance) ** 2)
        level = np.abs(cosines) > 0.7
        signs = np.where(level, -1.0, 1.0) * weights
        scatter = (normals * signs[:, None]).T @ normals
        _, vectors = np.linalg.eigh(scatter)
        vertical = vectors[:, 0] * np.sign(vectors[2, 0])
    return vertical
