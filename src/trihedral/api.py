"""What `import trihedral` offers: the whole job as one call."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.job.dask_executor import DaskExecutor
from trihedral.job.local_executor import LocalExecutor
from trihedral.job.progress_file import ProgressFile
from trihedral.job.sqlite_store import SqliteStore
from trihedral.job.stages import PreparedStation, Stages
from trihedral.job.store import MemoryStore
from trihedral.model.link import Link
from trihedral.model.registration import Failure, Loop, Registration
from trihedral.model.station import StationResult
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.constraints.file import find_constraints, read_constraints
from trihedral.parallel import processors
from trihedral.pipeline import Options, run, stages
from trihedral.progress import Progress, Silent
from trihedral.report import Document, Input, to_document, write_poses, write_result
from trihedral.report.against import add_measures, read_poses
from trihedral.report.page import write_report
from trihedral.report.paper_figures import StationAppearance
from trihedral.verdict.profile import DEFAULT_PROFILE, Profile, profile_named

# What a job writes, the result itself last.
_RESULTS = ("report.html", "poses.csv", "registration.json")


@dataclass(frozen=True)
class Result:
    """A finished job."""

    registration: Registration
    document: Document  # what registration.json holds
    #: Of each station, (N, 3) evenly sampled, its coordinates.
    surfaces: Mapping[str, NDArray[np.floating[Any]]]

    @property
    def stations(self) -> Mapping[str, StationResult]:
        """Every scan by its name; `pose` is project_from_station, 4x4, or None where it is not placed."""
        return MappingProxyType({station.name: station for station in self.registration.stations})

    @property
    def links(self) -> tuple[Link, ...]:
        """Every pair of scans that was tried."""
        return self.registration.links

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Closed walks of links, and how far each misses its start."""
        return self.registration.loops

    @property
    def failures(self) -> tuple[Failure, ...]:
        """What could not be read, with the reason."""
        return self.registration.failures

    @property
    def exit_code(self) -> int:
        """0: all placed and within tolerance; 3: scans are missing; 4: the tolerance is not met."""
        return int(self.document["verdict"]["exit"])

    @property
    def verdict(self) -> str:
        """One line that says what may be believed."""
        return str(self.document["verdict"]["text"])


class Surfaces(Mapping[str, NDArray[np.floating[Any]]]):
    """Evenly sampled points of each station by name, (N, 3), its coordinates, metres; read when asked for."""

    def __init__(self, stations: Iterable[PreparedStation], steps: Stages) -> None:
        self._stations = {station.name: station for station in stations}
        self._steps = steps

    def __getitem__(self, name: str) -> NDArray[np.floating[Any]]:
        return self._steps.surface(self._stations[name].load())

    def __iter__(self) -> Iterator[str]:
        return iter(self._stations)

    def __len__(self) -> int:
        return len(self._stations)

    def appearance(self) -> StationAppearance:
        """Colours and pictures of each station by name; read when asked for."""
        steps, of = self._steps, self._stations
        return StationAppearance(
            lambda name: steps.colors(of[name].load()), lambda name: steps.pictures(of[name].load())
        )


# Longer than a page: each parameter has its sentence.
def register(
    paths: Sequence[Path | str] | Path | str,
    out: Path | str | None = None,
    *,
    options: Options | None = None,
    constraints: Path | str | None = None,
    profile: Profile | str = DEFAULT_PROFILE,
    reference: Path | str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    steps: Stages | None = None,
    dask: str | None = None,
) -> Result:
    """Find the pose of every scan in some files and say how far each may be trusted.

    Parameters
    ----------
    paths
        Files and folders of scans, in any order.
    out
        Folder for registration.json, poses.csv, report.html and what the next run goes on from; by default
        nothing is written.
    options
        The method's; `Options(read=ReadOptions(units="mm"))`.
    constraints
        The file that says what is known beside the scans (docs/constraints.md); by default trihedral.toml or
        constraints.toml in the folders given or beside the files, if the options hold no constraints of their own.
    profile
        The tolerance that decides between exit codes 0 and 4, or its name.
    reference
        True poses to measure every link against: a truth.json or another registration.json.
    threads
        Scans or pairs worked on at once; by default as many as there are processors.
    progress
        Is told what happens.
    steps
        Other stages than `pipeline.stages(options)`.
    dask
        Address of a Dask scheduler whose workers prepare scans and register pairs; they must find the scans and `out`
        under the same paths.

    Raises
    ------
    TrihedralError
        No scan or no reference could be read, `out` cannot be written (`OutputError`), an option makes no sense
        (`OptionError`).
    """
    paths = [paths] if isinstance(paths, str | Path) else list(paths)
    profile = profile_named(profile) if isinstance(profile, str) else profile
    steps = steps or stages(_constrained(options or Options(), paths, constraints))
    threads = processors() if threads is None else threads
    if threads < 1:
        raise OptionError(f"The number of threads must be at least 1, not {threads}.")
    progress = progress or Silent()
    poses = None if reference is None else read_poses(reference)
    with nullcontext() if out is None else SqliteStore(out, steps.load, steps.program) as folder:
        file = None if folder is None else ProgressFile(progress, folder.folder)
        progress = file or progress
        if folder is not None:
            folder.outputs.check(_RESULTS)
        store = folder or MemoryStore()
        local = LocalExecutor(steps, store, threads)
        with nullcontext(local) if dask is None else DaskExecutor(dask, steps.of_scan, store) as executor:
            outcome = run(paths, steps, store, executor, threads, progress)
        inputs = [Input(file.path, file.sha256, file.bytes) for file in outcome.inputs]
        document = to_document(outcome.registration, inputs, profile)
        surfaces = Surfaces(outcome.stations, steps)
        if poses is not None:
            add_measures(document, poses, surfaces)
        if folder is not None:
            progress.phase("Writing the result", 1, "", 1.0, "")
            report, poses_file, result = _RESULTS
            with folder.outputs.replacing(report) as part:
                write_report(part, document, surfaces, surfaces.appearance())
            with folder.outputs.replacing(poses_file) as part:
                write_poses(document, part)
            with folder.outputs.replacing(result) as part:
                write_result(document, part)
            progress.advance(str(folder.out), 1.0)
        if file is not None:
            file.end()
    return Result(outcome.registration, document, surfaces)


def _constrained(options: Options, paths: Sequence[Path | str], constraints: Path | str | None) -> Options:
    """Add what a constraints file says."""
    if constraints is None and options.constraints == Constraints() and options.method == "auto":
        constraints = find_constraints(paths)
    return options if constraints is None else replace(options, constraints=read_constraints(constraints))
