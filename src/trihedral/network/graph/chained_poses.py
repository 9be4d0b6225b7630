"""Poses chained along links, without adjustment."""

from collections.abc import Iterable, Mapping

import numpy as np

from trihedral.geometry.arrays import Float64


def chained_poses(start: int, steps: Mapping[int, Iterable[tuple[int, Float64]]]) -> dict[int, Float64]:
    """Give ``start_from_station`` of each station that steps lead to, over the fewest of them.

    Parameters
    ----------
    steps
        From each station: the stations beside it and ``here_from_there``; of ways as short the first counts.
    """
    poses = {start: np.eye(4)}
    queue = [start]
    for here in queue:
        for there, here_from_there in steps.get(here, ()):
            if there not in poses:
                poses[there] = poses[here] @ here_from_there
                queue.append(there)
    return poses
