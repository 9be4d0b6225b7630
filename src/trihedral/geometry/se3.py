"""Rigid motions as 4x4 matrices."""

import numpy as np

from trihedral.geometry.arrays import Float64, Floating

Matrix = Float64


def motion(rotation: Matrix | None = None, translation: Floating | None = None) -> Matrix:
    """4x4 from a 3x3 rotation and a translation (3,), either one left out."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    if translation is not None:
        matrix[:3, 3] = translation
    return matrix


def translation(by: Floating) -> Matrix:
    """4x4 that moves by a vector (3,)."""
    return motion(translation=by)


def inverse(b_from_a: Matrix) -> Matrix:
    """``a_from_b``."""
    rotation = b_from_a[:3, :3]
    return motion(rotation.T, -rotation.T @ b_from_a[:3, 3])


def inverses(motions: Matrix) -> Matrix:
    """Of many motions (..., 4, 4) at once; `inverse` rounds otherwise in the last digit."""
    result = np.zeros_like(motions)
    result[..., :3, :3] = np.swapaxes(motions[..., :3, :3], -1, -2)
    result[..., :3, 3] = -(result[..., :3, :3] @ motions[..., :3, 3, None])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def adjoint(transform: Matrix) -> Matrix:
    """(..., 6, 6) that takes ``(omega, v)`` on the right of a motion (..., 4, 4) to its left."""
    rotation = transform[..., :3, :3]
    result = np.zeros((*transform.shape[:-2], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = rotation
    result[..., 3:, :3] = skew(transform[..., :3, 3]) @ rotation
    return result


def carried(by: Matrix, covariance: Matrix) -> Matrix:
    """Covariances (..., 6, 6) after a linear map."""
    return by @ covariance @ np.swapaxes(by, -1, -2)


def transform(b_from_a: Matrix, points: Floating) -> Matrix:
    """Points (N, 3) of frame `a` in frame `b`, float64."""
    return np.asarray(points, dtype=np.float64) @ b_from_a[:3, :3].T + b_from_a[:3, 3]


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
    cross = skew(axis)
    # Equal forms; each keeps its digits where the other loses them.
    factor = 1 / (1 + cosine) if cosine >= 0 else (1 - cosine) / square
    return np.eye(3) + cross + cross @ cross * factor


def skew(vector: Matrix) -> Matrix:
    """(..., 3, 3) with ``skew(a) @ b == cross(a, b)``."""
    result = np.zeros((*vector.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -vector[..., 2], vector[..., 1]
    result[..., 1, 0], result[..., 1, 2] = vector[..., 2], -vector[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -vector[..., 1], vector[..., 0]
    return result


def rotation_angle(rotation: Matrix) -> float:
    """Angle (rad) of a 3x3 rotation or of the rotation of a 4x4, accurate for small angles too."""
    r = rotation[:3, :3]
    sine = np.linalg.norm([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    return float(np.arctan2(sine, (np.trace(r) - 1) / 2))


def rotation_angles(motions: Matrix) -> Float64:
    """Angles (N,) of many motions (N, 4, 4) at once; `rotation_angle` rounds otherwise in the last digit."""
    r = motions[:, :3, :3]
    axis = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=-1)
    cosine = (np.trace(r, axis1=1, axis2=2) - 1) / 2
    angles: Float64 = np.arctan2(np.linalg.norm(axis, axis=-1) / 2, cosine)
    return angles


def distance(a: Matrix, b: Matrix) -> tuple[float, float]:
    """How far two motions between the same frames differ: translation (m) and rotation (rad)."""
    difference = inverse(a) @ b
    return float(np.linalg.norm(difference[:3, 3])), rotation_angle(difference)
