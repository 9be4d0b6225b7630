"""Coordinates that the files are in already: the frame of the poses that they hold."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trihedral.geometry.arrays import Float64
from trihedral.geometry.se3 import distance, inverse, motion

# A station agrees with the frame of the files if it is no farther from its pose there: metres and radians.
AGREES, AGREES_TURN = 0.5, float(np.radians(1.0))


@dataclass(frozen=True)
class FileFrame:
    """Where the poses in the files put the result.

    `project_from_frame` takes it there; of `stated` stations with a pose in their file, `agreeing` ones lie within
    `miss` (m, root mean square) of it.
    """

    project_from_frame: Float64
    stated: int
    agreeing: int
    miss: float


def file_frame(found: Mapping[int, Float64], file_poses: Mapping[int, Float64]) -> FileFrame | None:
    """Fit the result to the poses that the files hold.

    Parameters
    ----------
    found, file_poses
        ``frame_from_station`` as found, and as the files have it, of some stations.

    Returns
    -------
    FileFrame or None
        None if the files say nothing: no poses, or one and the same for all of several stations.
    """
    stations = sorted(found.keys() & file_poses.keys())
    if not stations or (
        len(stations) > 1 and all(np.array_equal(file_poses[s], file_poses[stations[0]]) for s in stations)
    ):
        return None
    if len(stations) == 1 and len(found) > 1:
        return None
    if len(stations) == 1 and np.array_equal(file_poses[stations[0]], np.eye(4)):
        return None
    moves = {s: file_poses[s] @ inverse(found[s]) for s in stations}
    # The move that most stations agree with; then the mean of theirs.
    agreeing: list[int] = []
    for candidate in stations[:50]:
        close = [s for s in stations if _agrees(moves[candidate] @ found[s], file_poses[s])]
        if len(close) > len(agreeing):
            agreeing = close
    u, _, vt = np.linalg.svd(np.sum([moves[s][:3, :3] for s in agreeing], axis=0))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    shift = np.mean([file_poses[s][:3, 3] - turn @ found[s][:3, 3] for s in agreeing], axis=0)
    frame = motion(turn, shift)
    off = [np.sum((file_poses[s] - frame @ found[s])[:3, 3] ** 2) for s in agreeing]
    return FileFrame(frame, len(stations), len(agreeing), float(np.sqrt(np.mean(off))))


def _agrees(found: Float64, in_file: Float64) -> bool:
    metres, radians = distance(found, in_file)
    return metres <= AGREES and radians <= AGREES_TURN
