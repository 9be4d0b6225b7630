"""The planar patches of a scan."""

from dataclasses import dataclass

from trihedral.geometry.arrays import Float64


@dataclass(frozen=True)
class Patches:
    """Planes that neighbouring surfels share, the largest first.

    Attributes
    ----------
    normals
        (P, 3) unit normals towards the scanner.
    areas
        (P,) square metres.
    """

    normals: Float64
    areas: Float64

    def __len__(self) -> int:
        return len(self.areas)
