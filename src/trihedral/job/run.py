"""Files in, result out: runs the stages over every scan and pair, whatever the stages are.

The result depends on what the files hold and on their names, not on their order or the number of threads.
"""

import hashlib
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from trihedral.errors import InputError, NothingToRegister, OptionError, OutputError
from trihedral.job.dask_executor import Cluster, PreparedThere, Steps, whole_program
from trihedral.job.inputs import SourceFile, failure_of, find_files, maybe_equal, natural, unique_names
from trihedral.job.stages import PreparedStation, Stages
from trihedral.model.link import Link, PairResult
from trihedral.model.pairs import PairHistory, PairPreview, PairRequest
from trihedral.model.registration import Failure, PreviewRecord, Registration
from trihedral.network.visiting_order import visiting_order
from trihedral.parallel import MemoryBudget, half_of_memory, ordered_map, processors
from trihedral.progress import Progress, Silent, relayed
from trihedral.scan import ScanHeader

T = TypeVar("T")

# What a raw point costs while it is read and prepared: its coordinates as stored in the file and as we store
# them, colour, grid indices, and the sort keys of the sampling.
_BYTES_PER_POINT = 64
# Shorter than any line of any format: bounds the points of a file that does not state their number.
_BYTES_PER_STORED_POINT = 6


class Store(Protocol):
    """What outlives a step; `job.Job` is the one on disk. Calls come from any thread."""

    def known_sha256(self, file: SourceFile) -> str | None:
        """Hash of a file that has not changed since it was last read."""

    def remember_sha256(self, file: SourceFile, sha256: str) -> None:
        """Keep a file's hash."""

    def may_know(self, size: int) -> bool:
        """Whether scans of a file of that many bytes may be stored."""

    def load(self, key: str) -> Any | None:
        """Give a prepared scan, or None if there is none that can be trusted."""

    def save(self, key: str, prepared: Any) -> None:
        """Keep a prepared scan."""

    def result(self, key: str) -> PairResult | None:
        """Give the outcome of a pair, or None."""

    def save_result(self, key: str, result: PairResult) -> None:
        """Keep the outcome of a pair."""

    def preview(self, key: str) -> PairPreview | None:
        """Give what a preview of a pair found, or None."""

    def save_preview(self, key: str, preview: PairPreview) -> None:
        """Keep what a preview found."""

    @property
    def shared(self) -> Path | None:
        """Folder of the prepared scans, where other processes may read and add to them."""


class MemoryStore:
    """Keeps prepared scans while the job runs and nothing after it."""

    def __init__(self) -> None:
        self._prepared: dict[str, Any] = {}

    def known_sha256(self, file: SourceFile) -> str | None:
        """Know no file."""
        return None

    def remember_sha256(self, file: SourceFile, sha256: str) -> None:
        """Keep nothing."""

    def may_know(self, size: int) -> bool:
        """Know no file."""
        return False

    def load(self, key: str) -> Any | None:
        """Give what this run prepared."""
        return self._prepared.get(key)

    def save(self, key: str, prepared: Any) -> None:
        """Keep it for this run."""
        self._prepared[key] = prepared

    def result(self, key: str) -> PairResult | None:
        """Know no pair."""
        return None

    def save_result(self, key: str, result: PairResult) -> None:
        """Keep nothing."""

    def preview(self, key: str) -> PairPreview | None:
        """Know no pair."""
        return None

    def save_preview(self, key: str, preview: PairPreview) -> None:
        """Keep nothing."""

    @property
    def shared(self) -> Path | None:
        """Share nothing."""
        return None


@dataclass(frozen=True)
class HashedFile:
    """A file that the job has read."""

    path: str  # as the user gave it
    sha256: str  # of its bytes, hexadecimal
    bytes: int


@dataclass(frozen=True)
class Outcome:
    """The result, the files it was made from, and the prepared scans."""

    registration: Registration
    inputs: tuple[HashedFile, ...]
    stations: tuple[PreparedStation, ...]


def run(
    paths: Sequence[Path | str],
    stages: Stages,
    store: Store | None = None,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
    cluster: Cluster | None = None,
) -> Outcome:
    """Find the pose of every scan in the files and folders at `paths`.

    Parameters
    ----------
    paths
        Files and folders; folders are searched for scan files.
    stages
        What to do.
    store
        Where prepared scans and outcomes of pairs are looked up and kept; by default in memory.
    threads
        Scans or pairs worked on at once; by default as many as there are processors.
    progress
        Is told what happens.
    cluster
        Prepares scans and registers pairs in place of this process.

    Raises
    ------
    NothingToRegister
        No scan is left; the message names each input and its reason.
    OutputError
        The store cannot be written.
    """
    if threads is not None and threads < 1:
        raise OptionError(f"The number of threads must be at least 1, not {threads}.")
    if cluster is not None and (store is None or store.shared is None):
        raise OptionError("A cluster needs an output folder, through which its workers share prepared scans.")
    store = store or MemoryStore()
    # Scans and pairs share the processors; threads within their small products of matrices would only get in the way.
    with threadpool_limits(1, "blas"):
        return _Run(stages, store, threads or processors(), progress or Silent(), cluster).run(paths)


def failure_line(failure: Failure) -> str:
    """Say a failure in one line."""
    scan = "" if failure.scan_index is None else f", scan {failure.scan_index + 1}"
    return f"{failure.path}{scan}: {failure.reason}"


@dataclass(frozen=True)
class _Task:
    """One scan to be prepared."""

    file: SourceFile
    header: ScanHeader
    alone: bool  # in its file

    def failure(self, error: InputError) -> Failure:
        """Say why it cannot be used; where the file holds no other scan, that is said of the file."""
        return failure_of(self.file.path, error, self.header, alone=self.alone)

    @property
    def points(self) -> int:
        """As declared, or the most that the file could hold."""
        most = self.file.bytes // _BYTES_PER_STORED_POINT
        return most if self.header.points is None else self.header.points


@dataclass(frozen=True)
class _Ready:
    """One scan that is prepared and stored."""

    task: _Task
    content: str
    key: str
    points: int
    descriptor: Any


class _Run:
    def __init__(
        self, stages: Stages, store: Store, threads: int, progress: Progress, cluster: Cluster | None
    ) -> None:
        self.stages = stages
        self.store = store
        self.threads = threads
        self.progress = progress
        self.failures: list[Failure] = []
        self.timing: dict[str, float] = {}
        self.pairs: dict[str, Any] = {}
        self.rounds: list[dict[str, int]] = []
        self.previews: tuple[PreviewRecord, ...] = ()
        self.hashes = _Hashes(store, threads)
        self.cluster = cluster
        self.steps = None if cluster is None else self._steps()

    def run(self, paths: Sequence[Path | str]) -> Outcome:
        began = time.perf_counter()
        try:
            tasks = self._timed("headers", lambda: self._read_headers(paths))
            ready = self._timed("prepare", lambda: self._prepare(tasks))
            if not ready:
                raise NothingToRegister([failure_line(failure) for failure in self.failures])
            stations = self._name(ready)
            links = self._timed("pairs", lambda: self._link(stations))
            registration = self._timed("network", lambda: self._solve(stations, links))
        finally:
            self.hashes.close()
        self.timing["total"] = time.perf_counter() - began
        registration = replace(
            registration,
            failures=(*registration.failures, *self.failures),
            options=self.stages.options,
            seed=_seed(*sorted(s.content for s in stations)),
            timing={**registration.timing, **self.timing},
            pairs={**self.pairs, "rounds": self.rounds},
            previews=self.previews,
        )
        return Outcome(registration, self.hashes.inputs(), tuple(stations))

    def _timed(self, phase: str, step: Callable[[], Any]) -> Any:
        began = time.perf_counter()
        result = step()
        self.timing[phase] = time.perf_counter() - began
        return result

    def _fail(self, failure: Failure) -> None:
        self.failures.append(failure)
        self.progress.note(failure_line(failure))

    def _read_headers(self, paths: Sequence[Path | str]) -> list[_Task]:
        """Find the scans of all files, each content once."""
        files, missing = find_files(paths, self.stages.aside)
        for failure in missing:
            self._fail(failure)
        self.progress.phase("Reading headers", len(files), "files", len(files), "")
        results = ordered_map(
            self._headers_of, files, self.threads, lambda file, _: self.progress.advance(file.path.name, 1.0)
        )
        tasks: list[_Task] = []
        for result in results:
            if isinstance(result, Failure):
                self._fail(result)
            else:
                tasks += result
        self._say_notes([task.header for task in tasks])
        return self._each_content_once(tasks)

    def _say_notes(self, headers: Sequence[ScanHeader]) -> None:
        """Say what was assumed about the files, each thing once."""
        said: dict[str, list[str]] = {}
        for header in headers:
            for note in header.notes:
                said.setdefault(note, []).append(_label(header))
        for note, labels in said.items():
            more = f" and {len(labels) - 3} more" if len(labels) > 3 else ""
            self.progress.note(f"{', '.join(labels[:3])}{more}: {note}")

    def _headers_of(self, file: SourceFile) -> list[_Task] | Failure:
        try:
            if file.bytes == 0:
                raise InputError(file.path, "the file is empty")
            headers = self.stages.read_headers(file.path)
            if not headers:
                raise InputError(file.path, "it holds no scans")
        except InputError as error:
            return failure_of(file.path, error)
        return [_Task(file, header, alone=len(headers) == 1) for header in headers]

    def _each_content_once(self, tasks: list[_Task]) -> list[_Task]:
        """Drop files that hold what another one holds.

        The others are hashed beside their reading, which costs no time of its own.
        """
        files = list(dict.fromkeys(task.file for task in tasks))
        suspects = maybe_equal(files)
        first = [
            file
            for file in files
            if file in suspects
            or self.store.may_know(file.bytes)
            or self.store.known_sha256(file) is not None
        ]
        self.progress.phase("Comparing contents", len(first), "files", sum(f.bytes for f in first), "bytes")
        found = ordered_map(
            self._hash_of,
            first,
            self.threads,
            lambda file, _: self.progress.advance(file.path.name, file.bytes),
        )
        original: dict[str, SourceFile] = {}
        dropped = set()
        for file, sha256 in zip(first, found, strict=True):
            if isinstance(sha256, Failure):
                self._fail(sha256)
                dropped.add(file)
            elif (other := original.setdefault(sha256, file)) is not file:
                self._fail(Failure(str(file.path), None, f"the same content as {other.path}, which is used"))
                dropped.add(file)
        return [task for task in tasks if task.file not in dropped]

    def _hash_of(self, file: SourceFile) -> str | Failure:
        try:
            return self.hashes.of(file)
        except InputError as error:
            return failure_of(file.path, error)

    def _prepare(self, tasks: Sequence[_Task]) -> list[_Ready]:
        budget = MemoryBudget(half_of_memory())

        def prepare(task: _Task) -> _Ready | Failure:
            try:
                if (ready := self._prepared_before(task)) is not None:
                    return ready
                with budget.reserved(task.points * _BYTES_PER_POINT):
                    return self._prepare_one(task)
            except InputError as error:
                return task.failure(error)

        self.progress.phase("Preparing scans", len(tasks), "scans", sum(t.points for t in tasks), "points")

        def done(task: _Task, _: object) -> None:
            self.progress.advance(_label(task.header), task.points)

        if self.cluster is not None:
            results = self._prepare_there(tasks, done)
        else:
            results = ordered_map(prepare, tasks, self.threads, done)
        for result in results:
            if isinstance(result, Failure):
                self._fail(result)
        return [result for result in results if isinstance(result, _Ready)]

    def _steps(self) -> Steps:
        """What the workers of a cluster are sent."""
        stages, how = self.stages, (self.stages.program, self.stages.prepare_options)
        if self.store.shared is None:
            raise AssertionError("checked by `run`")
        return Steps(
            folder=self.store.shared,
            program=whole_program(),
            read_scan=stages.read_scan,
            prepare=stages.prepare,
            load=stages.load,
            describe=stages.describe,
            register_pair=stages.register_pair,
            preview=stages.preview,
            key=lambda sha256, index: _key(sha256, index, *how),
        )

    def _prepare_there(
        self, tasks: Sequence[_Task], done: Callable[[_Task, object], None]
    ) -> list[_Ready | Failure]:
        """Prepare on the cluster what is not there yet."""
        if self.cluster is None or self.steps is None:
            raise AssertionError("there is no cluster")
        ready: list[_Ready | Failure | None] = []
        for task in tasks:
            try:
                ready.append(self._prepared_before(task))
            except InputError as error:
                ready.append(task.failure(error))
            if ready[-1] is not None:
                done(task, None)
        missing = [index for index, one in enumerate(ready) if one is None]
        sent = [
            (replace(tasks[i].file, path=tasks[i].file.path.resolve()), _resolved(tasks[i].header))
            for i in missing
        ]

        def arrived(place: int, found: PreparedThere | InputError) -> None:
            index = missing[place]
            task = tasks[index]
            if isinstance(found, InputError):
                error = InputError(task.file.path, found.reason, place=found.place, advice=found.advice)
                ready[index] = task.failure(error)
            else:
                self.hashes.put(task.file, found.sha256)
                ready[index] = _Ready(
                    task, self._content(task, found.sha256), found.key, found.points, found.descriptor
                )
            done(task, None)

        self.cluster.map(self.steps.prepare_scan, sent, arrived)
        return [one for one in ready if one is not None]

    def _prepared_before(self, task: _Task) -> _Ready | None:
        sha256 = self.hashes.known(task.file)
        if sha256 is None:
            return None
        key = self._key(task, sha256)
        prepared = self.store.load(key)
        return None if prepared is None else self._ready(task, sha256, prepared)

    def _prepare_one(self, task: _Task) -> _Ready:
        self.hashes.start(task.file)
        scan = self.stages.read_scan(task.header)
        if len(scan) == 0:
            raise InputError(task.file.path, "the scan has no valid points")
        prepared = self.stages.prepare(scan)
        del scan
        sha256 = self.hashes.of(task.file)
        self.store.save(self._key(task, sha256), prepared)
        return self._ready(task, sha256, prepared)

    def _ready(self, task: _Task, sha256: str, prepared: Any) -> _Ready:
        content, key = self._content(task, sha256), self._key(task, sha256)
        return _Ready(task, content, key, prepared.scanned_points, self.stages.describe(prepared))

    @staticmethod
    def _content(task: _Task, sha256: str) -> str:
        return _digest(sha256, str(task.header.scan_index))[:32]

    def _key(self, task: _Task, sha256: str) -> str:
        return _key(sha256, task.header.scan_index, self.stages.program, self.stages.prepare_options)

    def _name(self, ready: Sequence[_Ready]) -> list[PreparedStation]:
        names = unique_names([r.task.header for r in ready], [r.content for r in ready])
        stations = [
            PreparedStation(name, r.task.header, r.points, r.content, r.descriptor, r.key, self._loader(r))
            for name, r in zip(names, ready, strict=True)
        ]
        return sorted(stations, key=lambda s: natural(s.name))

    def _loader(self, ready: _Ready) -> Callable[[], Any]:
        def load() -> Any:
            prepared = self.store.load(ready.key)
            if prepared is None:
                raise OutputError(
                    ready.task.file.path.name,
                    "its prepared scan was removed or damaged while the job ran",
                    advice="Run the same command again",
                )
            return prepared

        return load

    def _link(self, stations: Sequence[PreparedStation]) -> list[Link]:
        by_name = {station.name: station for station in stations}
        links: dict[tuple[str, str], Link] = {}
        previews: dict[tuple[str, str], PairPreview] = {}
        asked_for: dict[tuple[str, str], tuple[str, int]] = {}
        while True:
            found = self._in_order(links, by_name)
            began = time.perf_counter()
            asked = self.stages.candidate_pairs(stations, PairHistory(found, previews))
            wanted: dict[tuple[str, str], PairRequest] = {}
            for want in asked:
                pair = self._directed(by_name[want.a], by_name[want.b])
                if pair not in links and not (want.preview_only and pair in previews):
                    wanted.setdefault(pair, want)
            self.timing["choosing pairs"] = (
                self.timing.get("choosing pairs", 0.0) + time.perf_counter() - began
            )
            if not wanted:
                self._explain(stations, PairHistory(found, previews), asked_for)
                return found
            links_wanted = [pair for pair in wanted if not wanted[pair].preview_only]
            previews_wanted = [pair for pair in wanted if wanted[pair].preview_only]
            asked_for |= {pair: (wanted[pair].because, len(self.rounds) + 1) for pair in previews_wanted}
            previews.update(
                self._each(
                    "Previewing pairs",
                    previews_wanted,
                    by_name,
                    self._known_preview,
                    self._preview,
                    self._keep_preview,
                )
            )
            outcomes = self._each(
                "Registering pairs", links_wanted, by_name, self._known_link, self._register, self._keep_link
            )
            for (a, b), link in outcomes.items():
                links[a, b] = Link.named(link, a, b, wanted[a, b].because)
            self.rounds.append(
                {
                    "looked_at": len(previews_wanted),
                    "registered": len(links_wanted),
                    "accepted": sum(links[pair].accepted for pair in links_wanted),
                }
            )

    def _explain(
        self,
        stations: Sequence[PreparedStation],
        history: PairHistory,
        asked_for: Mapping[tuple[str, str], tuple[str, int]],
    ) -> None:
        """Note what was decided of each pair: why it was previewed and in which round, why it was not registered."""
        passed_over = self.stages.passed_over(stations, history)
        registered = {(link.from_station, link.to_station) for link in history.links}
        self.previews = tuple(
            PreviewRecord(
                *pair,
                *asked_for[pair],
                preview,
                pair in registered,
                passed_over.previewed.get(pair),
            )
            for pair, preview in history.previews.items()
        )
        self.pairs = {
            "possible": len(stations) * (len(stations) - 1) // 2,
            "looked_at": len(history.previews),
            "registered": len(history.links),
            "passed_over": sum(not record.registered for record in self.previews),
            "never_looked_at": [
                {"pairs": count, "because": rule} for rule, count in passed_over.never.items()
            ],
        }

    def _each(
        self,
        phase: str,
        pairs: list[tuple[str, str]],
        by_name: Mapping[str, PreparedStation],
        known: Callable[[PreparedStation, PreparedStation], T | None],
        step: Callable[[PreparedStation, PreparedStation], T],
        keep: Callable[[PreparedStation, PreparedStation, T], None],
    ) -> dict[tuple[str, str], T]:
        """Do a step for each pair that it was not done for before, here or on the cluster."""
        if not pairs:
            return {}
        pairs.sort(key=lambda p: (by_name[p[0]].content, by_name[p[1]].content))
        pairs = [pairs[index] for index in visiting_order(pairs)]
        ends = [(by_name[a], by_name[b]) for a, b in pairs]
        self.progress.phase(phase, len(pairs), "pairs", len(pairs), "")

        def done(pair: tuple[PreparedStation, PreparedStation], _: object = None) -> None:
            self.progress.advance(f"{pair[0].name} - {pair[1].name}", 1.0)

        def here(pair: tuple[PreparedStation, PreparedStation]) -> T:
            found = known(*pair)
            if found is None:
                found = step(*pair)
                keep(*pair, found)
            return found

        if self.cluster is None:
            return dict(zip(pairs, ordered_map(here, ends, self.threads, done), strict=True))
        found = [known(*pair) for pair in ends]
        for pair, one in zip(ends, found, strict=True):
            if one is not None:
                done(pair)
        missing = [index for index, one in enumerate(found) if one is None]

        def arrived(place: int, outcome: T) -> None:
            index = missing[place]
            found[index] = outcome
            keep(*ends[index], outcome)
            done(ends[index])

        self._there(step, [ends[i] for i in missing], arrived)
        return {pair: one for pair, one in zip(pairs, found, strict=True) if one is not None}

    def _there(
        self,
        step: Callable[..., Any],
        pairs: Sequence[tuple[PreparedStation, PreparedStation]],
        arrived: Callable[[int, Any], None],
    ) -> None:
        if self.cluster is None or self.steps is None:
            raise AssertionError("there is no cluster")
        if step == self._preview:
            self.cluster.map(self.steps.preview_pair, [(a.key, b.key) for a, b in pairs], arrived)
        else:
            asked = [(a.key, b.key, _seed(a.content, b.content)) for a, b in pairs]
            self.cluster.map(self.steps.register, asked, arrived)

    @staticmethod
    def _in_order(
        links: Mapping[tuple[str, str], Link], by_name: Mapping[str, PreparedStation]
    ) -> list[Link]:
        return [links[p] for p in sorted(links, key=lambda p: (by_name[p[0]].content, by_name[p[1]].content))]

    @staticmethod
    def _directed(a: PreparedStation, b: PreparedStation) -> tuple[str, str]:
        return (a.name, b.name) if a.content < b.content else (b.name, a.name)

    def _link_key(self, a: PreparedStation, b: PreparedStation) -> str:
        return _digest(a.key, b.key, self.stages.pair_version)

    def _known_link(self, a: PreparedStation, b: PreparedStation) -> PairResult | None:
        return self.store.result(self._link_key(a, b))

    def _register(self, a: PreparedStation, b: PreparedStation) -> PairResult:
        return self.stages.register_pair(a.load(), b.load(), _seed(a.content, b.content))

    def _keep_link(self, a: PreparedStation, b: PreparedStation, result: PairResult) -> None:
        self.store.save_result(self._link_key(a, b), result)

    def _preview_key(self, a: PreparedStation, b: PreparedStation) -> str:
        return _digest("look", a.key, b.key, self.stages.pair_version)

    def _known_preview(self, a: PreparedStation, b: PreparedStation) -> PairPreview | None:
        return self.store.preview(self._preview_key(a, b))

    def _preview(self, a: PreparedStation, b: PreparedStation) -> PairPreview:
        if self.stages.preview is None:
            raise AssertionError("a preview was asked for, and there is none")
        return self.stages.preview(a.load(), b.load())

    def _keep_preview(self, a: PreparedStation, b: PreparedStation, preview: PairPreview) -> None:
        self.store.save_preview(self._preview_key(a, b), preview)

    def _solve(self, stations: Sequence[PreparedStation], links: Sequence[Link]) -> Registration:
        return relayed(
            lambda progress: self.stages.solve(stations, links, progress, self.threads), self.progress
        )


class _Hashes:
    """Hashes of files, each file read once for it, beside other work."""

    def __init__(self, store: Store, threads: int) -> None:
        self._store = store
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="trihedral-hash")
        self._futures: dict[SourceFile, Future[str]] = {}
        self._lock = threading.Lock()

    def start(self, file: SourceFile) -> Future[str]:
        with self._lock:
            if file not in self._futures:
                self._futures[file] = self._pool.submit(self._hash, file)
            return self._futures[file]

    def of(self, file: SourceFile) -> str:
        return self.start(file).result()

    def put(self, file: SourceFile, sha256: str) -> None:
        """Take a hash that was made elsewhere."""
        future: Future[str] = Future()
        future.set_result(sha256)
        with self._lock:
            self._futures.setdefault(file, future)
        self._store.remember_sha256(file, sha256)

    def known(self, file: SourceFile) -> str | None:
        """Give the hash if it is there without reading the file."""
        with self._lock:
            future = self._futures.get(file)
        return future.result() if future is not None and future.done() else self._store.known_sha256(file)

    def inputs(self) -> tuple[HashedFile, ...]:
        """Every file that was hashed, by path."""
        files = [
            HashedFile(str(file.path), future.result(), file.bytes)
            for file, future in self._futures.items()
            if future.exception() is None
        ]
        return tuple(sorted(files, key=lambda file: natural(file.path)))

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _hash(self, file: SourceFile) -> str:
        sha256 = self._store.known_sha256(file)
        if sha256 is None:
            sha256 = file.sha256()
            self._store.remember_sha256(file, sha256)
        return sha256


def _label(header: ScanHeader) -> str:
    return header.source.name if header.name == header.source.stem else f"{header.source.name}: {header.name}"


def _resolved(header: ScanHeader) -> ScanHeader:
    """The header with a path that other processes find too."""
    return replace(header, source=header.source.resolve())


def _key(sha256: str, scan_index: int, program: str, options: str) -> str:
    """Name of a prepared scan."""
    return _digest(sha256, str(scan_index), program, options)[:32]


def _digest(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def _seed(*parts: str) -> int:
    """Make a number that any JSON reader keeps exactly."""
    return int(_digest(*parts)[:12], 16)
