"""Where a beam of a rotating line scanner ends: Eq. (1) of Kim, Chen and Cho (2017)."""

import numpy as np
from numpy.typing import NDArray

from trihedral.fusion.rig import LineScanner
from trihedral.geometry.se3 import Matrix, motion, rotation_about_z


def station_from_body(body_angle: float) -> Matrix:
    """4x4: what is fixed to the body, in the frame of the station, when the body has turned by an angle (rad)."""
    return motion(rotation_about_z(body_angle))


def profile_points(
    scanner: LineScanner,
    body_angles: NDArray[np.float64],
    beam_angles: NDArray[np.float64],
    ranges: NDArray[np.floating],
) -> Matrix:
    """Points of all beams of all profiles of one line scanner.

    Eq. (1) gives them in the frame of the scanner's mounting at body angle zero, the mounting takes them to the body,
    and the body turns. With the mounting at identity that is Eq. (1) itself.

    Parameters
    ----------
    scanner
        d, h and mounting.
    body_angles
        (P,) of each profile (rad).
    beam_angles
        (B,) of each beam (rad).
    ranges
        (P, B) metres.

    Returns
    -------
    (P, B, 3) metres, station frame.
    """
    level = np.cos(beam_angles)[None, :] * ranges + scanner.d
    up = np.sin(beam_angles)[None, :] * ranges + scanner.h
    # In the mounting's frame the fan is the plane y = 0.
    mounted = scanner.body_from_mounting
    x, y, z = (mounted[k, 0] * level + mounted[k, 2] * up + mounted[k, 3] for k in range(3))
    c, s = np.cos(body_angles)[:, None], np.sin(body_angles)[:, None]
    return np.stack([c * x - s * y, s * x + c * y, z], axis=-1)


def beam_origins(scanner: LineScanner, body_angles: NDArray[np.float64]) -> Matrix:
    """(P, 3) the place of the line scanner's centre at each body angle (rad), station frame, metres."""
    return profile_points(scanner, body_angles, np.zeros(1), np.zeros((len(body_angles), 1)))[:, 0]
