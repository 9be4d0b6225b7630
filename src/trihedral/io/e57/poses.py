"""Poses as E57 stores them, and as 4x4 matrices."""

import numpy as np
from numpy.typing import NDArray

from trihedral import _core

# A rotation that is further from orthonormal than this was not meant as one.
_RIGID = 1e-6


def motion_of(pose: _core.E57Pose | None) -> tuple[NDArray[np.float64] | None, list[str]]:
    """Build the 4x4 matrix of a stored pose, and say what is doubtful; None where it is no rigid motion."""
    if pose is None:
        return None, []
    quaternion = np.array(pose.quaternion)
    translation = np.array(pose.translation)
    norm = float(np.linalg.norm(quaternion))
    if not (np.isfinite(norm) and np.isfinite(translation).all()) or norm < _RIGID:
        return None, ["it is no rigid motion: left out"]
    doubts = [f"its quaternion has the norm {norm:.6g}: scaled to 1"] if abs(norm - 1.0) > _RIGID else []
    w, x, y, z = quaternion / norm
    motion = np.eye(4)
    motion[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    motion[:3, 3] = translation
    return motion, doubts


def check_motion(pose: NDArray[np.float64], what: str) -> None:
    """Raise `ValueError` unless a matrix is a rigid motion."""
    pose = np.asarray(pose, dtype=np.float64)
    rotation = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
    rigid = (
        np.isfinite(pose).all()
        and np.abs(rotation @ rotation.T - np.eye(3)).max() < _RIGID
        and np.linalg.det(rotation) > 0.0
        and np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0])
    )
    if not rigid:
        raise ValueError(f"{what} is no rigid motion")
