"""How far the rest of the network bears each link out."""

from dataclasses import dataclass

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.network.adjustment.link_observations import LinkObservations
from trihedral.network.adjustment.sparse_cholesky import NormalMatrix
from trihedral.network.adjustment.unknowns import Unknowns

# Share of a link's own information that others must add before it counts as checked by them.
_LEAST_REDUNDANCY = 1e-4
_BATCH = 256  # links whose removal is solved for at once


@dataclass(frozen=True)
class Checked:
    """How far the rest of the network bears a link out."""

    residual: Float64  # (6,) of (omega, v): measured less adjusted
    #: 0: nothing else holds the stations together, an error of the link goes unseen; 6: it decides nothing.
    redundancy: float
    #: Its largest residual (three of rotation, three of translation) over the sigma to expect of it; None where nothing
    #: checks it.
    standardised: float | None = None
    #: Metres by which the poses would change most without it, and of which station; None where a part would come off.
    moves: float | None = None
    moves_station: int | None = None


def checked(
    links: LinkObservations, unknowns: Unknowns, normal: NormalMatrix, adjusted: Float64, scale: float
) -> list[Checked]:
    """Check all links.

    Parameters
    ----------
    adjusted
        Covariance (M, 6, 6) of the links' adjusted motions.
    scale
        By which all covariances are too small.
    """
    if not links.edges:
        return []
    residuals = links.residuals(unknowns)
    own = links.weighted_covariance
    redundancies = 6.0 - np.trace(np.linalg.inv(own) @ adjusted, axis1=1, axis2=2)
    # Of the residuals' covariance, what the others leave open is no more than rounding.
    left = own - adjusted
    root = np.linalg.cholesky(own)
    whitened = np.linalg.solve(root, np.swapaxes(np.linalg.solve(root, left), -1, -2))
    values = np.linalg.eigvalsh((whitened + np.swapaxes(whitened, -1, -2)) / 2)
    held = values[:, 0] > _LEAST_REDUNDANCY
    result = []
    for begin in range(0, len(held), _BATCH):
        batch = range(begin, min(begin + _BATCH, len(held)))
        distances = _moves_without(links, unknowns, normal, [k if held[k] else None for k in batch], left)
        for k in batch:
            if not held[k]:
                result.append(Checked(residuals[k], max(0.0, float(redundancies[k]))))
                continue
            sigmas = np.sqrt(scale * np.diag(left[k]))
            far = int(distances[:, k - begin].argmax())
            standardised = float(np.abs(residuals[k] / sigmas).max())
            moves = float(distances[far, k - begin])
            station = unknowns.stations[far]
            result.append(Checked(residuals[k], float(redundancies[k]), standardised, moves, station))
    return result


def _moves_without(
    links: LinkObservations, unknowns: Unknowns, normal: NormalMatrix, batch: list[int | None], left: Float64
) -> Float64:
    """Metres (N, B) by which each scanner moves without each link of a batch; no link stands for no change."""
    of_a, of_b = links.jacobians(unknowns)
    residuals, first = links.residuals(unknowns), unknowns.first
    right = np.zeros((first[-1], len(batch)))
    for column, k in enumerate(batch):
        if k is not None:
            shared = np.linalg.solve(left[k], residuals[k])
            a, b = links.pairs[k]
            right[first[a] : first[a] + 6, column] = of_a[k].T @ shared
            right[first[b] : first[b] + 6, column] = of_b[k].T @ shared
    moved = normal.solve(right)[: 6 * len(unknowns.stations)]
    distances: Float64 = np.linalg.norm(moved.reshape(len(unknowns.stations), 6, -1)[:, 3:], axis=1)
    return distances
