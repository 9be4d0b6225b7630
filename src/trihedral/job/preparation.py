"""From paths to prepared scans: headers are read, each content is taken once, scans are prepared and named."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from trihedral.errors import InputError, NothingToRegister, OutputError
from trihedral.job.executor import Executor, ScanTask
from trihedral.job.hashes import FileHashes, digest
from trihedral.job.inputs import (
    SourceFile,
    failure_line,
    failure_of,
    find_files,
    maybe_equal,
    natural,
    unique_names,
)
from trihedral.job.same_scans import same_scans
from trihedral.job.stages import PreparedStation, Stages, StoredScan
from trihedral.job.store import Store
from trihedral.model.registration import Failure
from trihedral.parallel import ordered_map
from trihedral.progress import Progress


@dataclass(frozen=True)
class FoundScans:
    """What the files hold, each content once, and what could not be read."""

    tasks: Sequence[ScanTask]
    failures: Sequence[Failure]


@dataclass(frozen=True)
class PreparedScans:
    """Every scan that can be registered, by name, and all that could not be used so far."""

    stations: Sequence[PreparedStation]
    failures: Sequence[Failure]


def find_scans(
    paths: Sequence[Path | str], stages: Stages, hashes: FileHashes, threads: int, progress: Progress
) -> FoundScans:
    """Find the scans of all files by their headers, each content once."""
    files, missing = find_files(paths, stages.aside)
    failures = [*_say(missing, progress)]
    progress.phase("Reading headers", len(files), "files", len(files), "")

    def read(file: SourceFile) -> list[ScanTask] | Failure:
        try:
            if file.bytes == 0:
                raise InputError(file.path, "the file is empty")
            headers = stages.read_headers(file.path)
            if not headers:
                raise InputError(file.path, "it holds no scans")
        except InputError as error:
            return failure_of(file.path, error)
        return [ScanTask(file, header, alone=len(headers) == 1) for header in headers]

    found = ordered_map(read, files, threads, lambda file, _: progress.advance(file.path.name, 1.0))
    failures += _say([result for result in found if isinstance(result, Failure)], progress)
    tasks = [task for result in found if not isinstance(result, Failure) for task in result]
    _say_notes(tasks, progress)
    dropped = _same_content([*dict.fromkeys(task.file for task in tasks)], hashes, threads, progress)
    failures += _say([*dropped.values()], progress)
    return FoundScans([task for task in tasks if task.file not in dropped], failures)


def _say(failures: Sequence[Failure], progress: Progress) -> Sequence[Failure]:
    for failure in failures:
        progress.note(failure_line(failure))
    return failures


def _say_notes(tasks: Iterable[ScanTask], progress: Progress) -> None:
    """Say what was assumed about the files, each thing once."""
    said: dict[str, list[str]] = {}
    for task in tasks:
        for note in task.header.notes:
            said.setdefault(note, []).append(task.label)
    for note, labels in said.items():
        more = f" and {len(labels) - 3} more" if len(labels) > 3 else ""
        progress.note(f"{', '.join(labels[:3])}{more}: {note}")


def _same_content(
    files: Sequence[SourceFile], hashes: FileHashes, threads: int, progress: Progress
) -> dict[SourceFile, Failure]:
    """Files that hold what another one holds, or cannot be read.

    Most files are hashed later, beside their reading, which costs no time of its own.
    """
    suspects = maybe_equal(files)
    first = [file for file in files if file in suspects or hashes.may_be_stored(file)]
    progress.phase("Comparing contents", len(first), "files", sum(f.bytes for f in first), "bytes")

    def hashed(file: SourceFile) -> str | Failure:
        try:
            return hashes.of(file)
        except InputError as error:
            return failure_of(file.path, error)

    found = ordered_map(hashed, first, threads, lambda file, _: progress.advance(file.path.name, file.bytes))
    original: dict[str, SourceFile] = {}
    dropped = {}
    for file, sha256 in zip(first, found, strict=True):
        if isinstance(sha256, Failure):
            dropped[file] = sha256
        elif (other := original.setdefault(sha256, file)) is not file:
            reason = f"the same content as {other.path}, which is used"
            dropped[file] = Failure(str(file.path), None, reason)
    return dropped


def prepare_scans(
    found: FoundScans,
    stages: Stages,
    store: Store,
    executor: Executor,
    hashes: FileHashes,
    threads: int,
    progress: Progress,
) -> PreparedScans:
    """Prepare the scans that are not stored yet, and name all of them.

    Raises
    ------
    NothingToRegister
        No scan is left; the message names each input and its reason.
    """
    tasks = found.tasks
    progress.phase("Preparing scans", len(tasks), "scans", sum(task.points for task in tasks), "points")

    def done(task: ScanTask) -> None:
        progress.advance(task.label, task.points)

    def stored(task: ScanTask) -> StoredScan | None:
        sha256 = hashes.known(task.file)
        prepared = None if sha256 is None else store.load(stages.key(sha256, task.header.scan_index))
        if sha256 is None or prepared is None:
            return None
        return stages.stored_as(sha256, task.header, prepared)

    before = ordered_map(stored, tasks, threads, lambda task, scan: None if scan is None else done(task))
    missing = [task for task, scan in zip(tasks, before, strict=True) if scan is None]
    made = iter(executor.prepare(missing, hashes, done))
    outcomes = [(task, scan or next(made)) for task, scan in zip(tasks, before, strict=True)]
    failed = [task.failure(scan) for task, scan in outcomes if isinstance(scan, InputError)]
    failures = [*found.failures, *_say(failed, progress)]
    scans = [(task, scan) for task, scan in outcomes if isinstance(scan, StoredScan)]
    for task, scan in scans:
        for note in [note for note in scan.header.notes if note not in task.header.notes]:
            progress.note(f"{task.label}: {note}")
    if not scans:
        raise NothingToRegister([failure_line(failure) for failure in failures])
    copies = same_scans(scans, threads)
    failures += _say([*copies.values()], progress)
    return PreparedScans(_named([scan for k, scan in enumerate(scans) if k not in copies], store), failures)


def _named(scans: Sequence[tuple[ScanTask, StoredScan]], store: Store) -> list[PreparedStation]:
    # Workers know files by other paths.
    headers = [replace(scan.header, source=task.header.source) for task, scan in scans]
    contents = [digest(scan.sha256, str(task.header.scan_index))[:32] for task, scan in scans]
    stations = []
    names = unique_names(headers, contents)
    for name, header, content, (task, scan) in zip(names, headers, contents, scans, strict=True):
        load = partial(_load, task.file.path.name, scan.key, store)
        stations.append(PreparedStation(name, header, scan.points, content, scan.descriptor, scan.key, load))
    return sorted(stations, key=lambda station: natural(station.name))


def _load(file: str, key: str, store: Store) -> Any:
    prepared = store.load(key)
    if prepared is None:
        reason = "its prepared scan was removed or damaged while the job ran"
        raise OutputError(file, reason, advice="Run the same command again")
    return prepared
