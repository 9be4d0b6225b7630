"""The pose that lays three planes on three others: rotation by Eq. 5 and 6, translation by the corners of Eq. 7."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trihedral.errors import TrihedralError
from trihedral.final.planes.segmentation import Plane
from trihedral.geometry.se3 import Matrix, motion, rotation_between


class PlanesRefused(TrihedralError):  # noqa: N818 - an outcome as much as an error
    """Three planes that fix a pose were not found; the text says why, as a clause without a final stop."""


@dataclass(frozen=True)
class PlanePair:
    """A plane of either scan, taken for the same, and the sign that gives `a`'s normal the sense of `b`'s."""

    a: Plane
    b: Plane
    sign: float


def sequential_rotation(normals_a: Matrix, normals_b: Matrix) -> Matrix:
    """Eq. 6: the rotations that take each normal of `a` in turn onto its partner, (3, 3) rows each, multiplied.

    Each is Eq. 5 (`geometry.se3.rotation_between`). The product takes the last normal onto its partner exactly;
    what the angles between the normals differ by stays with the others.
    """
    rotation: Matrix = np.eye(3)
    for normal_a, normal_b in zip(normals_a, normals_b, strict=True):
        rotation = rotation_between(rotation @ normal_a, normal_b) @ rotation
    return rotation


def corner(normals: Matrix, distances: Matrix) -> Matrix:
    """Eq. 7: the point (3,) that lies on three planes ``normal . x = distance``, normals (3, 3) as rows.

    Raises
    ------
    PlanesRefused
        They have no single common point.
    """
    if abs(np.linalg.det(normals)) < 1e-9:
        raise PlanesRefused("the three planes have no corner: they are parallel to one line")
    return np.asarray(np.linalg.solve(normals, distances), dtype=np.float64)


def corner_of(planes: Sequence[Plane]) -> Matrix:
    """Give the point (3,) where three planes meet."""
    return corner(np.stack([p.normal for p in planes]), np.array([p.distance for p in planes]))


def paired_normals(pairs: Sequence[PlanePair]) -> tuple[Matrix, Matrix]:
    """Normals of either scan as rows, those of `a` in the sense of their partners."""
    return np.stack([p.sign * p.a.normal for p in pairs]), np.stack([p.b.normal for p in pairs])


def pose_of(three: Sequence[PlanePair], start: Matrix) -> Matrix:
    """Eq. 6 and 7 for three pairs of planes, normals turned by the initial alignment ``b_from_a`` first."""
    normals_a, normals_b = paired_normals(three)
    rotation = sequential_rotation(normals_a @ start[:3, :3].T, normals_b) @ start[:3, :3]
    corner_a, corner_b = corner_of([p.a for p in three]), corner_of([p.b for p in three])
    return motion(rotation, corner_b - rotation @ corner_a)
