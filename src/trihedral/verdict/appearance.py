"""Whether surfaces that agree in shape look the same: storeys and rooms that were built alike seldom do."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float32, Float64
from trihedral.scan.photometry import SurfaceTexture
from trihedral.scan.prepared import Prepared

# Places of the textures in `Prepared.textures`.
COLOR, INTENSITY = 0, 1
# Surfels of a scan that are compared, at the most.
SAMPLES = 20_000
# Of them that meet; where fewer do, every surfel is compared.
PLENTY = 1_000
# That meet, below which nothing is said.
LEAST_SURFELS = 300
# Of neighbours in one scan: surfaces below it have no texture to compare. At 0.13 (an office seen through a doorway)
# the similarity still told right poses.
LEAST_SIMILARITY_WITHIN = 0.1
# Share of the surfels whose nearest in the same scan is near enough to look the same.
NEIGHBOURLY = 0.9
# Least cosine between the normals of one surface.
FACING = 0.9
# Standard deviations at which a lamp or a reflection is cut off.
CUT = 3.0


@dataclass(frozen=True)
class AppearanceOptions:
    """How alike surfaces that agree in shape must look."""

    #: Appearance similarity below which they are different ones.
    refused_similarity: float = 0.45
    #: Copies share some of their appearance; but the more surface two scans share, the more alike it looks if it is
    #: one. Share of surface that holds a pose, up to which that similarity is enough.
    partly_held: float = 0.2
    #: Similarity asked besides for all of the surface beyond, in proportion.
    similarity_a_share: float = 0.5

    def __post_init__(self) -> None:
        if not (0 <= self.partly_held <= 1 and self.similarity_a_share >= 0):
            raise OptionError("partly_held must lie between 0 and 1, and similarity_a_share not be negative")

    def least(self, holding: float) -> float:
        """Similarity below which surfaces are different ones, where this share of them holds the pose."""
        return self.refused_similarity + self.similarity_a_share * max(0.0, holding - self.partly_held)


@dataclass(frozen=True)
class Similarity:
    """How alike surfaces look that agree in shape: about 1 for the same, 0 for others."""

    value: float
    of: Literal["color", "intensity"]


def appearance_similarity(
    a: Prepared, b: Prepared, pose: Float64, samples: int = SAMPLES
) -> Similarity | None:
    """Tell how far the appearance of `a` goes with that of `b` where their surfaces meet under ``b_from_a``.

    It is of colour if both scans have it and may have a ceiling above them, since outdoors shadows move; else of
    intensity. From each planar patch or tile their even shading is taken away (`scan.photometry`): exposure and lamps,
    distance and incidence do not count. What is left is correlated between each surfel and the nearest of the other
    scan, and, for what to expect of one surface sampled twice, between each surfel and its neighbour in the same scan:
    their quotient is the similarity.

    Parameters
    ----------
    samples
        Surfels of `a` that are compared, unless few of them meet the other scan.

    Returns
    -------
    Similarity or None
        None where nothing can be said: neither colour nor intensity in both, no texture, few surfels.
    """
    kind = compared_kind(a, b)
    if kind is None:
        return None
    of_a, of_b = a.textures[kind], b.textures[kind]
    every = max(1, len(of_a.index) // samples)
    met_a, met_b = meeting(a, b, pose, of_a.index[::every], of_b)
    if every > 1 and len(met_a) < PLENTY:
        met_a, met_b = meeting(a, b, pose, of_a.index, of_b)
    if len(met_a) < LEAST_SURFELS:
        return None
    across = _correlation(of_a.values[met_a], of_b.values[met_b])
    within = [_within(of_a, met_a), _within(of_b, np.unique(met_b))]
    if not min(within) > LEAST_SIMILARITY_WITHIN or not np.isfinite(across):
        return None
    return Similarity(
        float(across / np.sqrt(within[0] * within[1])), "color" if kind == COLOR else "intensity"
    )


def compared_kind(a: Prepared, b: Prepared) -> int | None:
    """Which of `Prepared.textures` is compared: colour if both may have a ceiling above them, else intensity.

    None where too few surfels of either scan have it.
    """
    kind = COLOR if enclosed(a, b) and _known(a, b, COLOR) else INTENSITY
    return kind if _known(a, b, kind) else None


def enclosed(a: Prepared, b: Prepared) -> bool:
    """Tell whether both scans may have a ceiling above them, as rooms and storeys do, which may have copies."""
    return a.may_be_enclosed and b.may_be_enclosed


def _known(a: Prepared, b: Prepared, kind: int) -> bool:
    """Whether enough surfels of both scans have a texture of colour (0) or intensity (1)."""
    return min(len(one.textures[kind].index) for one in (a, b)) >= LEAST_SURFELS


def meeting(
    a: Prepared, b: Prepared, pose: Float64, index: NDArray[np.intp], of_b: SurfaceTexture
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Those of (K,) surfels of `a` that meet ones of `b` with a texture which face alike, and which each meets."""
    moved = a.surfels.points[index] @ pose[:3, :3].T + pose[:3, 3]
    found, nearest = of_b.tree.query(
        moved, distance_upper_bound=2 * max(a.surfels.spacing, b.surfels.spacing)
    )
    met = np.isfinite(found)
    index, other = index[met], of_b.index[nearest[met]]
    alike = (
        np.einsum("ij,ij->i", a.surfels.normals[index] @ pose[:3, :3].T, b.surfels.normals[other]) > FACING
    )
    return index[alike], other[alike]


def _within(texture: SurfaceTexture, index: NDArray[np.intp]) -> float:
    """Correlation of surfels with the nearest others of the same scan."""
    apart, nearest = texture.neighbours(index)
    near = apart <= np.quantile(apart, NEIGHBOURLY)
    return _correlation(texture.values[index[near]], texture.values[nearest[near]])


def _correlation(x: Float32, y: Float32) -> float:
    # 1.4826 median deviations are one standard deviation of normally distributed values.
    x, y = (np.clip(v / (1.4826 * np.median(np.abs(v)) + 1e-9), -CUT, CUT) for v in (x, y))
    return float(np.corrcoef(x, y)[0, 1])
