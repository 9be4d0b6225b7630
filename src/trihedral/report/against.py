"""A result against true poses: the paper's measures of every link, and where they are read from."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import InputError
from trihedral.geometry.deviation import deviation_angles, displacement_rmse
from trihedral.geometry.se3 import Matrix, inverse, transform
from trihedral.overlap.nearest import has_neighbour, overlap
from trihedral.report.section import Samples

Poses = Mapping[str, Matrix]

# Metres: points of a scan within this of the other's, under the true pose, are what its RMSE is over.
MET = 0.5


def read_poses(path: Path | str) -> dict[str, Matrix]:
    """Read true poses (project_from_station, 4x4, by name) from a truth.json or a registration.json.

    Raises
    ------
    InputError
        It cannot be read, or holds no poses.
    """
    path = Path(path)
    try:
        stations = json.loads(path.read_bytes())["stations"]
        poses = {
            str(station["name"]): np.array(pose, dtype=np.float64)
            for station in stations
            if (pose := station.get("project_from_station", station.get("pose"))) is not None
        }
    except OSError as error:
        raise InputError(path, f"it cannot be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(
            path,
            "it holds no poses",
            advice="A truth.json of `trihedral simulate` or a registration.json does",
        ) from None
    for name, pose in poses.items():
        rigid = pose.shape == (4, 4) and np.isfinite(pose).all()
        if not rigid or not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6):
            raise InputError(path, f"the pose of {name} is not a rigid motion", place="stations")
    if not poses:
        raise InputError(path, "it holds no poses", place="stations")
    return poses


def measures(
    found: Matrix | None,
    initial: Matrix | None,
    true: Matrix,
    points_a: NDArray[np.floating[Any]],
    points_b: NDArray[np.floating[Any]],
) -> dict[str, Any]:
    """Deviation angles (deg about the axes of `b`) and RMSE (m): original, initial, final; None where there is none.

    RMSE is the root mean square distance between where a pose and the true pose put the points of `a` that lie on
    surface of `b`: the paper does not say what its RMSE is over.

    Parameters
    ----------
    found, initial, true
        ``b_from_a``.
    points_a, points_b
        (N, 3) and (M, 3) evenly sampled, station coordinates, metres.
    """
    shared = overlap(points_a, points_b, true)
    met = has_neighbour(transform(true, points_a), points_b, MET)
    points = points_a[met] if met.any() else points_a
    result: dict[str, Any] = {
        "overlap": {"from": shared.of_a, "to": shared.of_b},
        "distance_m": float(np.linalg.norm(true[:3, 3])),
        "original_deg": list(deviation_angles(np.eye(4), true)),
    }
    for name, pose in (("initial", initial), ("final", found)):
        result[f"{name}_deg"] = None if pose is None else list(deviation_angles(pose, true))
        result[f"{name}_rmse_m"] = None if pose is None else displacement_rmse(points, pose, true)
    return result


def add_measures(document: dict[str, Any], poses: Poses, samples: Samples) -> None:
    """Put the measures into every link whose two scans have a true pose, as `against_reference`."""
    for link in document["links"]:
        ends = (link["from"], link["to"])
        if not all(name in poses and name in samples for name in ends):
            continue
        a, b = (samples[name] for name in ends)
        true = inverse(poses[ends[1]]) @ poses[ends[0]]
        found, initial = (
            None if link[key] is None else np.array(link[key]) for key in ("transform", "initial_transform")
        )
        link["against_reference"] = measures(found, initial, true, a, b)
