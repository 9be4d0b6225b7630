"""From prepared scans to links: pairs are asked for in rounds, previewed or registered, until nothing new comes."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from trihedral.job.executor import Executor, PairStep, PairTask
from trihedral.job.hashes import digest
from trihedral.job.stages import PreparedStation, Stages
from trihedral.job.store import Store
from trihedral.model.link import Link, PairResult
from trihedral.model.pairs import PairHistory, PairPreview, PairRequest
from trihedral.model.registration import PreviewRecord
from trihedral.network.visiting_order import visiting_order
from trihedral.progress import Progress

T = TypeVar("T")
Ends = tuple[str, str]


@dataclass(frozen=True)
class RoundCounts:
    """How many pairs were worked on before it was asked for more."""

    previewed: int
    registered: int
    accepted: int


@dataclass(frozen=True)
class LinkedPairs:
    """What came of all pairs."""

    links: Sequence[Link]
    previews: tuple[PreviewRecord, ...]
    rounds: Sequence[RoundCounts]
    possible: int
    never: Mapping[str, int]  # pairs neither previewed nor registered, by the rule that left them out
    choosing_s: float  # spent on choosing pairs

    def counts(self) -> dict[str, object]:
        """The counts of pairs, with the keys of registration.json."""
        return {
            "possible": self.possible,
            "looked_at": len(self.previews),
            "registered": len(self.links),
            "passed_over": sum(not record.registered for record in self.previews),
            "never_looked_at": [{"pairs": count, "because": rule} for rule, count in self.never.items()],
            "rounds": [
                {"looked_at": r.previewed, "registered": r.registered, "accepted": r.accepted}
                for r in self.rounds
            ],
        }


def link_stations(
    stations: Sequence[PreparedStation], stages: Stages, store: Store, executor: Executor, progress: Progress
) -> LinkedPairs:
    """Preview and register the pairs that are asked for, until nothing new is."""
    by_name = {station.name: station for station in stations}
    links: dict[Ends, Link] = {}
    previews: dict[Ends, PairPreview] = {}
    asked_for: dict[Ends, tuple[str, int]] = {}  # why a preview was, and in which round
    rounds: list[RoundCounts] = []
    choosing_s = 0.0

    def outcomes(step: PairStep[T], pairs: Iterable[Ends]) -> dict[Ends, T]:
        return _outcomes(step, [PairTask(by_name[a], by_name[b]) for a, b in pairs], executor, progress)

    while True:
        in_order = sorted(links, key=lambda ends: [by_name[name].content for name in ends])
        history = PairHistory([links[ends] for ends in in_order], previews)
        began = time.perf_counter()
        new: dict[Ends, PairRequest] = {}
        for request in stages.candidate_pairs(stations, history):
            # The content of scans says which of them comes first.
            a, b = sorted((request.a, request.b), key=lambda name: by_name[name].content)
            if (a, b) not in links and not (request.preview_only and (a, b) in previews):
                new.setdefault((a, b), request)
        choosing_s += time.perf_counter() - began
        if not new:
            break
        to_preview = [ends for ends, request in new.items() if request.preview_only]
        to_register = [ends for ends, request in new.items() if not request.preview_only]
        asked_for |= {ends: (new[ends].because, len(rounds) + 1) for ends in to_preview}
        previews |= outcomes(_preview_step(stages, store), to_preview)
        results = outcomes(_register_step(stages, store), to_register)
        found = {ends: Link.named(result, *ends, new[ends].because) for ends, result in results.items()}
        links |= found
        rounds.append(RoundCounts(len(to_preview), len(found), sum(link.accepted for link in found.values())))
    passed_over = stages.passed_over(stations, history)
    return LinkedPairs(
        history.links,
        tuple(
            PreviewRecord(*ends, *asked_for[ends], preview, ends in links, passed_over.previewed.get(ends))
            for ends, preview in previews.items()
        ),
        rounds,
        len(stations) * (len(stations) - 1) // 2,
        passed_over.never,
        choosing_s,
    )


def _preview_step(stages: Stages, store: Store) -> PairStep[PairPreview]:
    preview = stages.preview  # on its own it can be sent to other processes
    return PairStep(
        "Previewing pairs",
        lambda a, b, seed: preview(a, b),
        lambda task: digest("preview", task.a.key, task.b.key, stages.pair_version),
        store.preview,
        store.save_preview,
    )


def _register_step(stages: Stages, store: Store) -> PairStep[PairResult]:
    return PairStep(
        "Registering pairs",
        stages.register_pair,
        lambda task: digest(task.a.key, task.b.key, stages.pair_version),
        store.result,
        store.save_result,
    )


def _outcomes(
    step: PairStep[T], tasks: Sequence[PairTask], executor: Executor, progress: Progress
) -> dict[Ends, T]:
    """Do a step with each pair that it was not done with before, in an order in which few scans are loaded."""
    if not tasks:
        return {}
    tasks = sorted(tasks, key=lambda task: (task.a.content, task.b.content))
    tasks = [tasks[index] for index in visiting_order([task.ends for task in tasks])]
    progress.phase(step.phase, len(tasks), "pairs", len(tasks), "")

    def done(task: PairTask) -> None:
        progress.advance(f"{task.a.name} - {task.b.name}", 1.0)

    missing = []
    found: dict[Ends, T] = {}
    for task in tasks:
        outcome = step.stored(step.key(task))
        if outcome is None:
            missing.append(task)
        else:
            found[task.ends] = outcome
            done(task)
    made = executor.each_pair(step, missing, done)
    found |= {task.ends: outcome for task, outcome in zip(missing, made, strict=True)}
    return {task.ends: found[task.ends] for task in tasks}
