"""Links with several poses: where those of different links meet in one, loops have decided."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.se3 import distance, inverse
from trihedral.network.decision.loop_closure import ClosureOptions

Float64 = NDArray[np.float64]

# Links that a choice needs, and links for each one that speaks for another.
_LEAST, _DECISIVE = 2, 2


@dataclass(frozen=True)
class Choice:
    """One of the poses of a link: ``b_from_a`` between scanners."""

    link: int
    pose: int  # 0: the link's own, then its alternatives
    a: int
    b: int
    transform: Float64


def choose(
    choices: Sequence[Choice], poses: Mapping[int, tuple[int, Float64]], closure: ClosureOptions
) -> list[Choice]:
    """Poses on which links between two parts agree, at most one a link.

    Every pose of every link joins two parts in one way. A way is chosen if at least two links have it among their
    poses, and no other way has more than half as many.

    Parameters
    ----------
    poses
        Part and pose in it of each station; a station on its own is a part.
    """
    between: dict[tuple[int, int], list[tuple[Choice, Float64]]] = {}
    for choice in choices:
        (part_a, pose_a), (part_b, pose_b) = poses[choice.a], poses[choice.b]
        join = pose_b @ choice.transform @ inverse(pose_a)
        if part_a < part_b:
            between.setdefault((part_a, part_b), []).append((choice, join))
        elif part_b < part_a:
            between.setdefault((part_b, part_a), []).append((choice, inverse(join)))
    chosen: list[Choice] = []
    for parts in sorted(between):
        # Stations of the first part that its links lead from: there joins are compared.
        places = [
            poses[s][1]
            for choice, _ in between[parts]
            for s in (choice.a, choice.b)
            if poses[s][0] == parts[0]
        ]
        supports = [
            [other for other, way in between[parts] if _alike(join, way, places, closure)]
            for _, join in between[parts]
        ]
        counts = [len({choice.link for choice in support}) for support in supports]
        best = max(range(len(counts)), key=lambda k: (counts[k], -between[parts][k][0].pose, -k))
        supporting = {id(choice) for choice in supports[best]}
        others = [
            count
            for count, (choice, _) in zip(counts, between[parts], strict=True)
            if id(choice) not in supporting
        ]
        if counts[best] >= _LEAST and _DECISIVE * max(others, default=0) <= counts[best]:
            by_link: dict[int, Choice] = {}
            for choice in supports[best]:
                by_link.setdefault(choice.link, choice)
            chosen += by_link.values()
    return chosen


def _alike(join: Float64, other: Float64, places: Sequence[Float64], closure: ClosureOptions) -> bool:
    """Whether two ways to join the parts put all places alike, as a loop over them would close."""
    offs = [distance(join @ place, other @ place) for place in places]
    return all(metres <= closure.translation and radians <= closure.rotation for metres, radians in offs)
