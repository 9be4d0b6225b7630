"""The Cramer-Rao bound of a pair: the normal equations at the truth, with the noise that the simulator put in.

What a pair of scans can say at best of their relative pose, if surfaces are unknown but flat within half a metre: in
each cell of each surface of the scene both scans measure one plane, three numbers that neither knows, and only the
difference of what they say counts. The variance of a point is that of its range and direction along the surface's
normal. Points that are mixed, moved, mirrored or behind glass say nothing.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.truth import SimulatedSite
from trihedral.geometry.se3 import transform
from trihedral.io import read_headers, read_scan
from trihedral.simulate import ScannerOptions
from trihedral.simulate.material import MATERIALS
from trihedral.simulate.scenes import build
from trihedral.simulate.tracer import Tracer

Float64 = NDArray[np.float64]

CELL = 0.5  # metres
# A point farther from the scene's surface than this (m) is not of it: mixed, or of something that moves.
LEAST_OFF, MOST_SIGMAS = 0.005, 5.0


@dataclass(frozen=True)
class Cells:
    """What one scan says of each cell of each surface: sums over its points, weighed by their information.

    Attributes
    ----------
    keys
        (K,) sorted, of surface and place (`packed`).
    weight, normal, first, second
        (K,), (K, 3), (K, 3), (K, 3, 3): sums of w, w n, w q and w q q^T; q is the place from the cell's centre (m), n
        the normal, all in the project frame.
    """

    keys: NDArray[np.int64]
    weight: Float64
    normal: Float64
    first: Float64
    second: Float64


BITS = 13  # of a cell's index along an axis: 4 km


def packed(surface: NDArray[np.int64], cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number for each surface (N,) and cell (N, 3)."""
    keys = surface
    for k in range(3):
        keys = (keys << BITS) | (cell[:, k] + (1 << (BITS - 1)))
    return keys


def centres(keys: NDArray[np.int64]) -> Float64:
    """(N, 3) middles of the packed cells, metres."""
    axes = [(keys >> (BITS * (2 - k))) & ((1 << BITS) - 1) for k in range(3)]
    middle: Float64 = (np.stack(axes, axis=1) - (1 << (BITS - 1)) + 0.5) * CELL
    return middle


def noise_variance(scanner: ScannerOptions, ranges: Float64, cosines: Float64, intensity: Float64) -> Float64:
    """(N,) variance (m^2) of points along the normal of their surface, as the simulator draws their noise."""
    # The simulator's intensity is reflectance times cosine, less a part of the fall-off with range.
    signal = intensity * (1.0 + ranges / 150.0) * (10.0 / np.maximum(ranges, 1.0)) ** 2
    of_signal = scanner.signal_noise_m**2 * np.minimum(0.5 / np.maximum(signal, 1e-9), 400.0)
    across = ranges * np.radians(scanner.angular_noise_arcsec / 3600.0)
    variance: Float64 = (scanner.range_noise_m**2 + of_signal) * cosines**2 + across**2 * (1.0 - cosines**2)
    return variance


def cells(site: SimulatedSite, tracer: Tracer, name: str) -> Cells:
    """Sum up one scan of a site."""
    scan = read_scan(read_headers(site.file(name))[0])
    scanner = ScannerOptions(**site.truth["scanner"])
    return scan_cells(scanner, tracer, site.poses[name], scan.xyz, scan.intensity)


def scan_cells(
    scanner: ScannerOptions, tracer: Tracer, pose: Float64, points: ArrayLike, intensity: ArrayLike
) -> Cells:
    """Sum up a scan: (N, 3) points in station coordinates, their (N,) intensity, and project_from_station."""
    xyz = np.asarray(points, dtype=np.float64)
    ranges = np.linalg.norm(xyz, axis=1)
    directions = xyz @ pose[:3, :3].T / ranges[:, None]
    face, length = tracer.cast(np.broadcast_to(pose[:3, 3], directions.shape), directions)
    glass = np.array([m.transmits or m.mirror for m in MATERIALS])
    good = np.flatnonzero((face >= 0) & ~glass[tracer.mesh.material[face]])
    face, length, ranges, directions = face[good], length[good], ranges[good], directions[good]
    normal = tracer.planes.normal[face]
    along = np.einsum("ij,ij->i", normal, directions)
    normal *= -np.sign(along)[:, None]
    variance = noise_variance(scanner, length, np.abs(along), np.asarray(intensity, float)[good])
    off = np.abs((ranges - length) * along)
    near = off < np.maximum(LEAST_OFF, MOST_SIGMAS * np.sqrt(variance))
    place = (pose[:3, 3] + directions * length[:, None])[near]
    weight, normal = 1.0 / variance[near], normal[near]
    cell = np.floor(place / CELL).astype(np.int64)
    surface = tracer.mesh.surface[face[near]].astype(np.int64)
    keys, index = np.unique(packed(surface, cell), return_inverse=True)
    q = place - (cell + 0.5) * CELL

    def summed(values: Float64) -> Float64:
        """Sums (K, ...) over the points of each cell."""
        flat = (weight[:, None] * values.reshape(len(values), -1)).T
        sums = [np.bincount(index, column, len(keys)) for column in flat]
        return np.stack(sums, axis=1).reshape(len(keys), *values.shape[1:])

    return Cells(
        keys,
        np.bincount(index, weight, len(keys)),
        summed(normal),
        summed(q),
        summed(q[:, :, None] * q[:, None, :]),
    )


def information(a: Cells, b: Cells, b_from_project: Float64) -> Float64:
    """(6, 6) Fisher information of ``(omega, v)`` on the left of ``b_from_a``, about the scanner of `b`."""
    keys, i, j = np.intersect1d(a.keys, b.keys, assume_unique=True, return_indices=True)
    normal = a.normal[i] + b.normal[j]
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    # Two axes in the plane: any will do.
    helper = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1)[:, None]
    axes = np.stack([first, np.cross(normal, first)], axis=1)
    of_planes = parallel(_of_plane(a, i, axes), _of_plane(b, j, axes))
    rotation = b_from_project[:3, :3]
    centre = transform(b_from_project, centres(keys))
    normal, axes = normal @ rotation.T, axes @ rotation.T
    jacobian = np.zeros((len(i), 3, 6))
    jacobian[:, 0, :3] = np.cross(centre, normal)
    jacobian[:, 0, 3:] = normal
    jacobian[:, 1:, :3] = np.cross(axes, normal[:, None, :])
    fisher: Float64 = np.einsum("kim,kij,kjn->mn", jacobian, of_planes, jacobian)
    return fisher


def _of_plane(cells: Cells, index: NDArray[np.intp], axes: Float64) -> Float64:
    """(K, 3, 3) information on height and the two slopes of the plane in each cell."""
    out = np.empty((len(index), 3, 3))
    out[:, 0, 0] = cells.weight[index]
    out[:, 0, 1:] = out[:, 1:, 0] = np.einsum("kai,ki->ka", axes, cells.first[index])
    out[:, 1:, 1:] = np.einsum("kai,kij,kbj->kab", axes, cells.second[index], axes)
    return out


def parallel(a: Float64, b: Float64) -> Float64:
    """Information (K, n, n) on a difference from that on either side: sums of inverses, inverted; singular or not."""
    both: Float64 = a @ np.linalg.pinv(a + b, rcond=1e-9, hermitian=True) @ b
    return both


def bounds(site: SimulatedSite, work: Path) -> dict[str, Float64]:
    """Fisher information of every pair of a site by "a b" (sorted names); kept in the work folder."""
    kept = work / "bounds" / f"{site.folder.name}.json"
    if not kept.exists():
        tracer = Tracer(build(site.scene, site.seed).mesh)
        sums = {name: cells(site, tracer, name) for name in site.poses}
        found = {
            f"{a} {b}": information(sums[a], sums[b], np.linalg.inv(site.poses[b])).tolist()
            for a, b, _ in site.pairs(0.0, 1.0)
        }
        kept.parent.mkdir(parents=True, exist_ok=True)
        unfinished = kept.with_suffix(".part")
        unfinished.write_text(json.dumps(found))
        unfinished.rename(kept)
    return {pair: np.array(matrix) for pair, matrix in json.loads(kept.read_text()).items()}


@dataclass(frozen=True)
class Least:
    """The root mean square error that no unbiased method goes below."""

    mm: float  # of the station's position
    deg: float


def least(fisher: Float64, b_from_a: Float64) -> Least:
    """The bound as a distance and an angle; a direction that nothing observes gets 1 km or 1 rad."""
    covariance = np.linalg.inv(fisher + np.diag([1.0] * 3 + [1e-6] * 3))
    x, y, z = b_from_a[:3, 3]
    # A turn about the scanner of `b` moves the station `a` too.
    lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    jacobian = np.hstack([lever, np.eye(3)])
    position = jacobian @ covariance @ jacobian.T
    return Least(
        1e3 * float(np.sqrt(np.trace(position))),
        float(np.degrees(np.sqrt(np.trace(covariance[:3, :3])))),
    )
