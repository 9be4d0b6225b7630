"""What a job hands back: the result, and what it was made from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from trihedral.job.hashes import HashedFile, seed_of
from trihedral.job.pairing import LinkedPairs
from trihedral.job.preparation import PreparedScans
from trihedral.job.stages import PreparedStation
from trihedral.model.registration import Registration


@dataclass(frozen=True)
class Outcome:
    """The result, the files it was made from, and the prepared scans."""

    registration: Registration
    inputs: Sequence[HashedFile]
    stations: Sequence[PreparedStation]


def outcome(
    registration: Registration,
    scans: PreparedScans,
    pairs: LinkedPairs,
    inputs: Sequence[HashedFile],
    options: Mapping[str, object],
    seconds: Mapping[str, float],
) -> Outcome:
    """Add to what solving the network gave what came of the steps before it."""
    timing = {**seconds, "choosing pairs": pairs.choosing_s, "total": sum(seconds.values())}
    complete = replace(
        registration,
        failures=(*registration.failures, *scans.failures),
        options=options,
        seed=seed_of(*sorted(station.content for station in scans.stations)),
        timing={**registration.timing, **timing},
        pairs=pairs.counts(),
        previews=pairs.previews,
    )
    return Outcome(complete, inputs, scans.stations)
