"""A link as the network sees it."""

from dataclasses import dataclass

from trihedral.geometry.arrays import Float64


@dataclass(frozen=True)
class Edge:
    """A link between two stations, by their numbers.

    `transform` is ``b_from_a`` between scanner-centred frames, `covariance` 6x6 of ``(omega, v)`` on its left.
    """

    a: int
    b: int
    transform: Float64
    covariance: Float64
    strength: float  # how well the pair bears it out; decides between links that contradict each other
    locked: bool = False  # a person decided on it: never refused
    between_priors: bool = False  # stands for poses that are known; no scan measured it

    @property
    def ends(self) -> tuple[int, int]:
        """Its two stations."""
        return self.a, self.b
