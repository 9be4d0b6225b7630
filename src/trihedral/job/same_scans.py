"""Scans that are one, though their files differ: another format, order, frame, rounding, or a part of the points."""

from collections.abc import Sequence
from itertools import combinations

from trihedral.job.executor import ScanTask
from trihedral.job.stages import StoredScan
from trihedral.model.registration import Failure
from trihedral.parallel import ordered_map
from trihedral.scan.beacons import same_scan

# A copy with at least this share of the other's points has lost none that matter.
_AS_MANY = 0.95


def same_scans(scans: Sequence[tuple[ScanTask, StoredScan]], threads: int) -> dict[int, Failure]:
    """Find scans that hold the points of another one, by their places in the list, with the better one's name.

    A copy is no second observation: what agrees with the one agrees with the other, right or wrong.
    """
    pairs = list(combinations(range(len(scans)), 2))

    def same(pair: tuple[int, int]) -> bool:
        a, b = (scans[k][1].beacons for k in pair)
        return a is not None and b is not None and same_scan(a, b)

    found = [
        p for p, yes in zip(pairs, ordered_map(same, pairs, threads, lambda *_: None), strict=True) if yes
    ]
    better = sorted(range(len(scans)), key=lambda k: _worth(*scans[k], max(s.points for _, s in scans)))
    dropped: dict[int, Failure] = {}
    for k in reversed(better):
        if k in dropped:
            continue
        for pair in found:
            if k in pair:
                other = sum(pair) - k
                if other not in dropped:
                    dropped[other] = _failure(scans[other][0], scans[k][0])
    return dropped


def _worth(task: ScanTask, scan: StoredScan, most: int) -> tuple[object, ...]:
    """Sorting key by which the better of two copies comes last."""
    header = scan.header
    holds = (header.grid is not None, header.photos > 0, header.has_color, header.has_intensity)
    return round(scan.points / most / (1.0 - _AS_MANY)), *holds, scan.points, scan.sha256, header.scan_index


def _failure(copy: ScanTask, used: ScanTask) -> Failure:
    index = None if copy.alone else copy.header.scan_index
    return Failure(
        str(copy.file.path),
        index,
        f"the same scan as {used.label}, whose points it holds too; that one is used",
    )
