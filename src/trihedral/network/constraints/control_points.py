"""Control points: whether they fit at all, and what is left of each when they do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from trihedral.errors import InputError
from trihedral.geometry.arrays import Float64
from trihedral.geometry.kabsch import UndeterminedMotion, kabsch
from trihedral.geometry.se3 import transform
from trihedral.network.adjustment.adjustment import Adjusted
from trihedral.network.adjustment.observations import PointObservation
from trihedral.network.constraints.constraints import ControlPoint

# A fit is bad beyond this many times what sigmas lead one to expect and this many metres.
_MISFIT_SIGMAS, _MISFIT = 5.0, 0.05
# Another reading of the file is the right one if it misses by less than this share of what the file as given does.
_BETTER = 0.1
# Radians that scanners may lean by; a fit that lays them down has its axes wrong.
_MOST_TILT = np.radians(45)
_UNITS = (
    (1e-3, "millimetres"),
    (1e-2, "centimetres"),
    (0.3048, "feet"),
    (1e3, "metres, read as millimetres"),
    (1 / 0.3048, "metres, read as feet"),
)


@dataclass(frozen=True)
class Miss:
    """Where a scan shows a control point, against its coordinates.

    `residual` is shown less known (m), `sigma` what to expect of it.
    """

    station: int
    point: int
    check: bool
    residual: Float64  # (3,)
    sigma: Float64  # (3,)

    @property
    def standardised(self) -> float:
        """Largest component over its sigma."""
        return float(np.abs(self.residual / self.sigma).max())


@dataclass(frozen=True)
class _Reading:
    """One way to read the control file, and how the points fit then."""

    text: str
    miss: float  # root mean square, metres of the file
    tilt: float  # radians, of the scans' common vertical

    @property
    def upright(self) -> bool:
        return bool(self.tilt < _MOST_TILT)


def examine(
    source: str,
    points: Sequence[ControlPoint],
    observations: Sequence[PointObservation],
    poses: Mapping[int, Float64],
) -> None:
    """Refuse control whose axes are swapped or whose units are wrong, with the evidence.

    Parameters
    ----------
    source
        The file, for the message.
    observations
        Of stations of one component, which `poses` (``frame_from_scanner``) hold; `point` numbers the points.

    Raises
    ------
    InputError
        Read otherwise, the points fit the scans; as given they do not.
    """
    if len({o.point for o in observations}) < 3:
        return
    shown = np.array([transform(poses[o.station], o.place[None])[0] for o in observations])
    known = np.array([points[o.point].place for o in observations])
    expected = np.sqrt(
        np.mean([np.sum(np.square(points[o.point].sigma)) + np.sum(o.sigma**2) for o in observations])
    )
    ups = np.array([poses[o.station][:3, 2] for o in observations])
    up = ups.mean(axis=0) / np.linalg.norm(ups.mean(axis=0))
    try:
        given = _read(shown, known, up, np.eye(3), 1.0, "as given")
    except UndeterminedMotion:
        return
    limit = max(_MISFIT, _MISFIT_SIGMAS * float(expected))
    if given.miss <= limit and given.upright:
        return
    readings = _readings(shown, known, up)
    least = min((reading.miss for reading in readings), default=np.inf)
    # Of readings that fit alike, the plainest.
    best = next((reading for reading in readings if reading.miss <= 1.01 * least + 1e-6), None)
    if best is None or best.miss > max(limit, _BETTER * given.miss if given.upright else limit):
        return
    lying = (
        "" if given.upright else f" and stand the scanners {np.degrees(given.tilt):.0f} degrees off upright"
    )
    count = len({o.point for o in observations})
    raise InputError(
        source,
        f"as given, the {count} points miss the scans by {_length(given.miss)}{lying}; "
        f"with {best.text} they fit to {_length(best.miss)}",
        place="control",
        advice="Correct the file, or its units in the constraints file",
    )


def _readings(shown: Float64, known: Float64, up: Float64) -> list[_Reading]:
    """Every other way to read the coordinates that leaves the scanners upright, what changes least first."""
    found = []
    scales = ((1.0, ""), *((scale, f"units of {name}") for scale, name in _UNITS))
    for scale, units in scales:
        for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
            # Turns of the whole about the vertical are no news: of those that differ by one, only the plainest counts.
            flips = sum(sign < 0 for sign in signs)
            if flips > 1:
                continue
            axes = np.zeros((3, 3))
            axes[range(3), order] = signs
            if scale == 1.0 and np.array_equal(axes, np.eye(3)):
                continue
            text = " and ".join(part for part in (_axes_text(order, signs), units) if part)
            reading = _read(shown, scale * known @ axes.T, up, axes, scale, text)
            if reading.upright:
                changes = 3 * flips + sum(k != axis for k, axis in enumerate(order)) + (scale != 1.0)
                found.append((changes, reading))
    return [reading for _, reading in sorted(found, key=lambda pair: pair[0])]


def _read(shown: Float64, known: Float64, up: Float64, axes: Float64, scale: float, text: str) -> _Reading:
    fit = kabsch(shown, known)
    miss = float(np.sqrt(np.mean(np.sum((transform(fit, shown) - known) ** 2, axis=1))))
    tilt = float(np.arccos(np.clip((fit[:3, :3] @ up)[2], -1.0, 1.0)))
    return _Reading(text, miss, tilt)


def _axes_text(order: Sequence[int], signs: Sequence[float]) -> str:
    names = [f"{'-' if sign < 0 else ''}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True)]
    if names == ["x", "y", "z"]:
        return ""
    for a, b in ((0, 1), (0, 2), (1, 2)):
        swapped = ["x", "y", "z"]
        swapped[a], swapped[b] = swapped[b], swapped[a]
        if names == swapped:
            return f"{'xyz'[a]} and {'xyz'[b]} exchanged"
    return f"{', '.join(names)} taken for x, y, z"


def _length(metres: float) -> str:
    return (
        f"{metres * 1e3:.1f} mm" if metres < 0.1 else f"{metres:.2f} m" if metres < 1e3 else f"{metres:.0f} m"
    )


def misses(
    points: Sequence[ControlPoint], observations: Sequence[PointObservation], adjusted: Adjusted
) -> list[Miss]:
    """What is left of each observation after the adjustment, with the sigma that was to be expected of it.

    The sigma of a check holds those of the pose, of the measurement and of the coordinates. That of a point which took
    part is smaller by the share with which it shaped the pose itself.
    """
    result = []
    for observation in observations:
        point, pose = points[observation.point], adjusted.poses[observation.station]
        jacobian = observation.jacobian(pose)
        of_pose = jacobian @ adjusted.covariances[observation.station] @ jacobian.T
        of_place = pose[:3, :3] @ np.diag(observation.sigma**2) @ pose[:3, :3].T + np.diag(
            np.square(point.sigma)
        )
        spread = of_place + of_pose if point.check else of_place - of_pose
        # Where nothing checks a point its residual and its variance are both zero; rounding must not make it stand out.
        variance = np.maximum(np.diag(spread), 1e-4 * np.diag(of_place))
        residual = observation.seen(pose) - np.array(point.place)
        result.append(Miss(observation.station, observation.point, point.check, residual, np.sqrt(variance)))
    return result
