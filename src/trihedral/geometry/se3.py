"""Rigid motions as 4x4 matrices."""

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def motion(rotation: Matrix | None = None, translation: Matrix | None = None) -> Matrix:
    """4x4 from a 3x3 rotation and a translation (3,), either one left out."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    if translation is not None:
        matrix[:3, 3] = translation
    return matrix


def inverse(b_from_a: Matrix) -> Matrix:
    """``a_from_b``."""
    rotation = b_from_a[:3, :3]
    return motion(rotation.T, -rotation.T @ b_from_a[:3, 3])


def transform(b_from_a: Matrix, points: NDArray[np.floating]) -> Matrix:
    """Points (N, 3) of frame `a` in frame `b`, float64."""
    moved: Matrix = np.asarray(points, dtype=np.float64) @ b_from_a[:3, :3].T + b_from_a[:3, 3]
    return moved


def rotation_about_z(angle: float) -> Matrix:
    """3x3 rotation by an angle (rad)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def rotation_between(source: Matrix, target: Matrix) -> Matrix:
    """The shortest rotation that takes one unit vector onto another, 3x3.

    Rodrigues' formula; opposite vectors turn by 180 degrees about an axis perpendicular to both.
    """
    axis = np.cross(source, target)
    cosine = float(source @ target)
    square = float(axis @ axis)
    if cosine < 0 and square < 1e-24:
        smallest = np.eye(3)[np.argmin(np.abs(source))]
        perpendicular = np.cross(source, smallest)
        perpendicular /= np.linalg.norm(perpendicular)
        return 2 * np.outer(perpendicular, perpendicular) - np.eye(3)
    skew = cross_matrix(axis)
    # Equal forms; each keeps its digits where the other loses them.
    factor = 1 / (1 + cosine) if cosine >= 0 else (1 - cosine) / square
    rotation: Matrix = np.eye(3) + skew + skew @ skew * factor
    return rotation


def cross_matrix(vector: Matrix) -> Matrix:
    """``cross_matrix(a) @ b == cross(a, b)``."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_angle(rotation: Matrix) -> float:
    """Angle (rad) of a 3x3 rotation or of the rotation of a 4x4, accurate for small angles too."""
    r = rotation[:3, :3]
    sine = np.linalg.norm([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    return float(np.arctan2(sine, (np.trace(r) - 1) / 2))


def distance(a: Matrix, b: Matrix) -> tuple[float, float]:
    """How far two motions between the same frames differ: translation (m) and rotation (rad)."""
    difference = inverse(a) @ b
    return float(np.linalg.norm(difference[:3, 3])), rotation_angle(difference)
