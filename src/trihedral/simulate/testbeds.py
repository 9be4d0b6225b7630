"""The paper's three testbeds: a construction site, a building, a room, with its distances, overlaps and tilts.

Kim, Chen and Cho (2017), Tables 2 to 5.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Testbed:
    """What the paper says of a testbed."""

    scene: str
    #: Number of its first scan in the paper.
    first: int
    #: (K, 2) stations in plan, metres, by least squares from the distances; these contradict each other by
    #: up to 1.2 m, as they are rounded and some break the triangle inequality.
    plan: tuple[tuple[float, float], ...]
    #: Of the pairs that the paper states.
    overlap: dict[tuple[int, int], float]
    #: Rotations (deg about x, y, z) of the lower scan into the higher one that the paper's tables give as
    #: "original".
    turns: dict[tuple[int, int], tuple[float, float, float]]

    @property
    def stations(self) -> int:
        """How many."""
        return len(self.plan)


def _by_gap(*rows: tuple[float, ...]) -> dict[tuple[int, int], float]:
    """Overlaps of neighbours, of every second scan, and so on."""
    return {(a, a + gap): share for gap, row in enumerate(rows, 1) for a, share in enumerate(row, 1)}


TESTBEDS: dict[str, Testbed] = {
    "testbed1": Testbed(
        "site",
        1,
        ((-20.48, -0.47), (-11.30, -0.52), (-5.50, 0.34), (2.83, 1.03), (12.87, 0.94), (21.58, -1.33)),
        _by_gap(
            (0.93, 0.91, 0.90, 0.88, 0.89),
            (0.82, 0.85, 0.82, 0.80),
            (0.68, 0.70, 0.67),
            (0.57, 0.55),
            (0.45,),
        ),
        {(1, 4): (-15.334, 3.922, 168.125), (4, 6): (9.141, -13.922, 91.421)},
    ),
    "testbed2": Testbed(
        "facade",
        7,
        ((-31.2, 0.4), (-5.3, -1.9), (31.6, 1.0)),
        {(7, 8): 0.70, (8, 9): 0.56},
        {(7, 8): (11.239, -1.928, -78.836), (8, 9): (-8.382, -3.321, 50.329)},
    ),
    "testbed3": Testbed(
        "office",
        10,
        ((-1.5, 0.0), (1.5, 0.0)),
        {(10, 11): 0.96},
        {(10, 11): (-17.404, -3.155, 29.899)},
    ),
}
