"""Links as observations of an adjustment, all at once."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import skew
from trihedral.network.adjustment.unknowns import Unknowns
from trihedral.network.graph.edge import Edge

# Sigmas of a link's offset from the others (six at once) at which it begins to lose weight: one right link in 1,000.
_ROBUST = float(np.sqrt(chdtri(6, 1 - 0.999)))


class LinkObservations:
    """M links between stations whose unknowns have numbers.

    Attributes
    ----------
    pairs
        Unknowns at the ends of each.
    weights
        (M,) at most 1, less for links far from the others.
    """

    def __init__(self, edges: Sequence[Edge], number: Mapping[int, int]) -> None:
        self.edges = edges
        self.pairs = [(number[edge.a], number[edge.b]) for edge in edges]
        self._a, self._b = np.array(self.pairs, dtype=np.int64).reshape(-1, 2).T
        self._measured = np.array([edge.transform for edge in edges]).reshape(-1, 4, 4)
        self._covariance = np.array([edge.covariance for edge in edges]).reshape(-1, 6, 6)
        self._information = np.linalg.inv(self._covariance)
        self.weights = np.ones(len(edges))

    @property
    def weighted_information(self) -> Float64:
        """(M, 6, 6)."""
        return self._information * self.weights[:, None, None]

    @property
    def weighted_covariance(self) -> Float64:
        """(M, 6, 6), the inverse."""
        return self._covariance / self.weights[:, None, None]

    def residuals(self, unknowns: Unknowns) -> Float64:
        """Of each link, (omega, v) on the left that takes the adjusted motion to the measured one."""
        expected = np.linalg.inv(unknowns.poses[self._b]) @ unknowns.poses[self._a]
        left = self._measured @ np.linalg.inv(expected)
        turn = Rotation.from_matrix(left[:, :3, :3]).as_rotvec() if len(left) else np.zeros((0, 3))
        return np.concatenate([turn, left[:, :3, 3]], axis=1)

    def jacobians(self, unknowns: Unknowns) -> tuple[Float64, Float64]:
        """How the adjusted motion of each link follows its two stations, (M, 6, 6) each."""
        poses = unknowns.poses
        back = np.swapaxes(poses[self._b][:, :3, :3], -1, -2)
        apart = poses[self._a][:, :3, 3] - poses[self._b][:, :3, 3]
        of_a = np.zeros((len(back), 6, 6))
        of_a[:, :3, :3] = of_a[:, 3:, 3:] = back
        of_b = -of_a
        of_a[:, 3:, :3] = back @ skew(apart)
        return of_a, of_b

    def reweigh(self, unknowns: Unknowns) -> None:
        """Huber's weights of whole links (1964)."""
        residuals = self.residuals(unknowns)
        squares = np.einsum("mi,mij,mj->m", residuals, self._information, residuals)
        self.weights = np.minimum(1.0, _ROBUST / np.sqrt(np.maximum(squares, 1e-12)))

    def squares(self, unknowns: Unknowns) -> float:
        """Weighted, of all residuals."""
        residuals = self.residuals(unknowns)
        return float(np.einsum("m,mi,mij,mj->", self.weights, residuals, self._information, residuals))

    def adjusted_covariance(self, unknowns: Unknowns, blocks: Mapping[tuple[int, int], Float64]) -> Float64:
        """Of each link's adjusted motion, (M, 6, 6), from blocks of the inverse normal matrix."""
        of_a, of_b = self.jacobians(unknowns)
        cross = np.array([blocks[a, b] if a <= b else blocks[b, a].T for a, b in self.pairs])
        cross = cross.reshape(-1, 6, 6)
        own_a = np.array([blocks[a, a] for a, _ in self.pairs]).reshape(-1, 6, 6)
        own_b = np.array([blocks[b, b] for _, b in self.pairs]).reshape(-1, 6, 6)
        mixed = of_a @ cross @ np.swapaxes(of_b, -1, -2)
        own = of_a @ own_a @ np.swapaxes(of_a, -1, -2) + of_b @ own_b @ np.swapaxes(of_b, -1, -2)
        total: Float64 = own + mixed + np.swapaxes(mixed, -1, -2)
        return total

    def weighted_residuals(self, unknowns: Unknowns, adjusted: Float64) -> tuple[Float64, Float64]:
        """(M, 6), and the covariance (M, 6, 6) to expect of them where adjusted motions are known so well."""
        weight = self.weighted_information
        weighted = np.einsum("mij,mj->mi", weight, self.residuals(unknowns))
        return weighted, weight - weight @ adjusted @ weight
