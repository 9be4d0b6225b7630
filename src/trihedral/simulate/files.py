"""A simulated site as files: one E57 a scan, and `truth.json`."""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trihedral.atomic import output_error, write_new
from trihedral.errors import OutputError
from trihedral.geometry.arrays import Float64
from trihedral.io.e57 import E57Scan, write_e57
from trihedral.simulate.covisible import reaches, still_points
from trihedral.simulate.patterns import REGULAR
from trihedral.simulate.scanner import SimulatedScan
from trihedral.simulate.site import Site

TRUTH = "truth.json"
_MARK = ".trihedral-simulate"  # names what a run writes, so that the next may replace it and nothing else


def prepare_folder(folder: Path, names: list[str]) -> None:
    """Make the folder, or clear it of what an earlier run of the simulator wrote.

    Raises
    ------
    OutputError
        It holds something else, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        mark = folder / _MARK
        if mark.exists():
            _clear(folder)
            # Exports of an earlier run.
            for inner in [
                path for path in folder.iterdir() if (path / _MARK).is_file() and not path.is_symlink()
            ]:
                _clear(inner)
                if not any(inner.iterdir()):
                    inner.rmdir()
        elif any(folder.iterdir()):
            raise OutputError(
                folder, "the folder is not empty", advice="Choose another one, or empty it yourself"
            )
        write_new(mark, "".join(f"{name}\n" for name in names).encode())
    except FileExistsError as error:
        raise OutputError(
            folder, "a file of that name is in the way", advice="Choose another folder"
        ) from error
    except OSError as error:
        raise output_error(folder, error) from error


def _clear(folder: Path) -> None:
    """Remove what the folder's mark names, and the mark."""
    for name in (folder / _MARK).read_text("utf-8").splitlines():
        path = folder / Path(name).name
        if path.is_file() and not path.is_symlink():
            path.unlink()
    (folder / _MARK).unlink()


def write_site(site: Site, folder: Path | str) -> Iterator[SimulatedScan]:
    """Write a site's scans one by one and yield each once its file is there; then, after the last, `truth.json`.

    The folder is new or empty, or one that an earlier run wrote, whose files are replaced.

    Raises
    ------
    OutputError
        The folder holds something else, or cannot be written.
    """
    folder = Path(folder)
    prepare_folder(folder, [*(f"{name}.e57" for name in site.names), TRUTH])
    stations, samples = [], []
    for k in range(len(site)):
        one = site.scan(k)
        path = folder / f"{one.name}.e57"
        with writing(path):
            write_e57(path, [whole_grid(one)])
        stations.append(station_entry(path, len(one), one.project_from_station))
        samples.append(still_points(one))
        yield one
    write_truth(folder, made_by(site), stations, pair_overlaps(site, samples))


def made_by(site: Site) -> dict[str, object]:
    """Say how a site's scans came about."""
    scanner = asdict(site.scanner)
    # What most scanners do is not said.
    if site.scanner.returns == 1:
        del scanner["returns"]
    made = {"scene": site.scene.name, "seed": site.scene.seed, "scanner": scanner}
    return made if site.pattern == REGULAR else {**made, "pattern": site.pattern}


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system says of a file into an `OutputError`."""
    try:
        yield
    except OSError as error:
        raise output_error(path, error) from error


def station_entry(path: Path, points: int, project_from_station: Float64) -> dict[str, object]:
    """Give what `truth.json` says of a scan."""
    return {
        "file": path.name,
        "name": path.stem,
        "scan_index": 0,
        "points": points,
        "project_from_station": project_from_station.tolist(),
    }


def pair_entry(names: tuple[str, str], shares: tuple[float, float], **more: float) -> dict[str, object]:
    """Give what `truth.json` says of a pair: shares of what one saw that the other sees too, and the smaller."""
    smaller = {
        "overlap": round(min(shares), 4),
        "overlap_a": round(shares[0], 4),
        "overlap_b": round(shares[1], 4),
    }
    return {"a": names[0], "b": names[1], **more, **smaller}


def write_truth(
    folder: Path,
    made: dict[str, object],
    stations: list[dict[str, object]],
    pairs: list[dict[str, object]],
) -> None:
    """Write `truth.json`; `made` is how the scans came about."""
    truth = {"schema": "trihedral.truth/1", **made, "stations": stations, "pairs": pairs}
    write_new(folder / TRUTH, (json.dumps(truth, indent=1) + "\n").encode())


def whole_grid(one: SimulatedScan) -> E57Scan:
    """Lay a scan out as instruments store it: every beam, column by column, with its return or without.

    Weaker returns of beams follow at the end.
    """
    rows, columns = one.grid
    at = one.column.astype(np.int64) * rows + one.row
    beam = np.concatenate([np.arange(rows * columns), at[one.echo > 0]])
    at[one.echo > 0] = np.arange(rows * columns, len(beam))
    xyz = np.zeros((len(beam), 3), np.float32)
    intensity = np.zeros(len(beam), np.float32)
    invalid = np.ones(len(beam), bool)
    xyz[at], intensity[at], invalid[at] = one.xyz, one.intensity, False
    color = None
    if one.color is not None:
        color = np.zeros((len(beam), 3), np.uint8)
        color[at] = one.color
    return E57Scan(
        one.name,
        xyz,
        intensity=intensity,
        color=color,
        row=(beam % rows).astype(np.int32),
        column=(beam // rows).astype(np.int32),
        invalid=invalid,
    )


def pair_overlaps(
    site: Site,
    samples: list[Float64],
    keeps: Sequence[Callable[[Float64], NDArray[np.bool_]]] | None = None,
) -> list[dict[str, object]]:
    """Give for each pair the share of what one saw that the other sees too, both ways and the smaller.

    `keeps` tells for each scan which points (N, 3), project frame, a crop left.
    """
    low, most = math.radians(site.scanner.elevation_min_deg), site.scanner.max_range_m

    def share(own: int, other: int) -> float:
        points, head = samples[own], site.poses[other][:3, 3]
        if keeps is not None:
            points = points[keeps[own](points)]
        if not len(points):
            return 0.0
        seen = reaches(site.still, head, points, most, low)
        if site.pattern != REGULAR:
            seen &= site.beams(other).covers((points - head) @ site.poses[other][:3, :3])
        return float((seen if keeps is None else seen & keeps[other](points)).mean())

    pairs = combinations(range(len(site)), 2)
    return [pair_entry((site.names[a], site.names[b]), (share(a, b), share(b, a))) for a, b in pairs]
