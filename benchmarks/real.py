"""Real pairs of scans that people and robots took: ours beside programs from the shelf.

    python -m benchmarks.real                        # scans of ../shared/data; --data FOLDER for another place
    python -m benchmarks.real --only trihedral       # one program, or "truth"; records of the others are kept

Every pair of one place, and some of different places. Right: within 10 cm and 0.5 degrees of the truth (1 degree
where the truth is no better), whatever is believed of it. KISS-Matcher and FPFH with RANSAC, both refined by
small_gicp, get the same points, at several voxel sizes; the one that is right most often counts (`make bench-peers`
installs them; one that is absent is left out). Truth is checked by two estimators that start at it. The page goes to
benchmarks/results/real.md, records to real.json beside it.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.pairs import figures, lost
from benchmarks.peers import COARSE_DEG, COARSE_MM, Program, fpfh_gicp_programs, kiss_programs
from benchmarks.real_places import (
    CAMERAS,
    DATA,
    Pair,
    pairs_of_different_places,
    pairs_of_one_place,
    real_places,
)
from benchmarks.table import RESULTS, WORK, machine, markdown
from benchmarks.truth import Error, apart
from trihedral.errors import TrihedralError
from trihedral.geometry.se3 import motion
from trihedral.io import read_headers, read_scan
from trihedral.model.link import PairResult
from trihedral.pipeline import Options, stages
from trihedral.scan import Scan
from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]
Record = dict[str, Any]

OURS = "trihedral"
# Degrees, where the truth itself is not good to much less than COARSE_DEG.
LOOSER_DEG = {CAMERAS: 1.0}
# Metres, of peers' features; matching FPFH of finer clouds takes ten minutes and more a program.
VOXELS = (0.2, 0.4)
# Metres, of the clouds that the truth is checked with, and how far their refinement reaches.
CHECK_VOXEL, CHECK_REACH = 0.05, 0.15


@cache
def scan_of(path: Path) -> Scan:
    return read_scan(read_headers(path)[0])


def ours(pair: Pair, options: Options, prepared: Callable[[Path], Prepared]) -> Record:
    """What the default method says of a pair."""
    began = time.perf_counter()
    try:
        a, b = prepared(pair.a), prepared(pair.b)
        wall = time.perf_counter()
        link: PairResult = stages(options).register_pair(a, b, 1)
    except TrihedralError as error:
        return {"reported": False, "verdict": "failed", "reason": str(error), "seconds": 0.0}
    found: Record = {
        "reported": link.accepted,
        "verdict": link.verdict.value,
        "reason": link.reason,
        "confidence": link.score,
        "evidence": figures(link),
        "seconds": time.perf_counter() - wall,
        "prepare_seconds": wall - began,
    }
    found |= held(pair, link.transform)
    if pair.b_from_a is not None and not found["right"]:
        centred = motion(None, -b.scanner_origin) @ pair.b_from_a @ motion(None, a.scanner_origin)
        found |= lost(a, b, centred, options.auto)
    return found


def held(pair: Pair, pose: Float64 | None) -> Record:
    """A pose against the truth of a pair, if there is one."""
    found: Record = {"right": False}
    if pose is not None and pair.b_from_a is not None:
        error = apart(pair.b_from_a, pose)
        found = {"mm": error.mm, "deg": error.deg, "right": within_limits(pair.kind, error)}
    return found


def within_limits(kind: str, error: Error) -> bool:
    return error.within(COARSE_MM, LOOSER_DEG.get(kind, COARSE_DEG))


def of_peer(program: Program, pairs: Sequence[Pair]) -> Iterator[Record]:
    """What one program at one setting says of each pair."""
    prepared = cache(lambda path: program.prepare(scan_of(path)))
    for pair in pairs:
        a, b = prepared(pair.a), prepared(pair.b)
        began = time.perf_counter()
        found = program.pair(a, b)
        yield {
            "reported": found.reported, "confidence": found.confidence, "seconds": time.perf_counter() - began,
            **held(pair, found.pose),
        }  # fmt: skip


def of_ours(pairs: Sequence[Pair]) -> Iterator[Record]:
    options = Options()
    prepared: Callable[[Path], Prepared] = cache(lambda path: stages(options).prepare(scan_of(path)))
    return (ours(pair, options, prepared) for pair in pairs)


def checked(pairs: Sequence[Pair]) -> Iterator[Record]:
    """How far two estimators go from the truth when they start at it."""
    import open3d as o3d
    import small_gicp

    registration, vectors = o3d.pipelines.registration, o3d.utility.Vector3dVector

    @cache
    def clouds(path: Path) -> tuple[Any, Any]:
        points = np.asarray(scan_of(path).xyz, dtype=np.float64)
        cloud = o3d.geometry.PointCloud(vectors(points)).voxel_down_sample(CHECK_VOXEL)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
        return small_gicp.preprocess_points(points, CHECK_VOXEL, 20, 2), cloud

    for pair in pairs:
        (a, a_cloud), (b, b_cloud) = clouds(pair.a), clouds(pair.b)
        gicp = small_gicp.align(
            b[0], a[0], b[1], pair.b_from_a, "GICP", max_correspondence_distance=CHECK_REACH, num_threads=2,
            max_iterations=50, rotation_epsilon=1e-6, translation_epsilon=1e-5,
        )  # fmt: skip
        icp = registration.registration_icp(
            a_cloud, b_cloud, CHECK_REACH, pair.b_from_a,
            registration.TransformationEstimationPointToPlane(registration.TukeyLoss(CHECK_REACH)),
            registration.ICPConvergenceCriteria(1e-9, 1e-9, 50),
        )  # fmt: skip
        for estimator, pose in (("GICP", gicp.T_target_source), ("ICP", icp.transformation)):
            error = apart(pair.b_from_a, np.asarray(pose))
            yield {
                "kind": pair.kind,
                "pair": pair.name,
                "estimator": estimator,
                "mm": error.mm,
                "deg": error.deg,
            }


def programs() -> Iterator[tuple[str, str, Callable[[Sequence[Pair]], Iterator[Record]]]]:
    """Every program and setting that is installed; ours first."""
    yield OURS, "default", of_ours
    for make in (kiss_programs, fpfh_gicp_programs):
        for voxel in VOXELS:
            try:
                made = list(make(voxel))
            except ImportError as error:
                print(f"{make.__name__}: not installed ({error})", file=sys.stderr)
                continue
            for program in made:
                yield program.family, program.setting, lambda pairs, one=program: of_peer(one, pairs)


def best_settings(records: list[Record]) -> dict[str, list[Record]]:
    """The records of each program at the setting that is right most often."""
    by_program: dict[str, dict[str, list[Record]]] = {}
    for r in records:
        by_program.setdefault(r["program"], {}).setdefault(r["setting"], []).append(r)
    return {
        program: max(of_setting.values(), key=lambda found: sum(r["right"] for r in found))
        for program, of_setting in by_program.items()
    }


def shares(records: list[Record]) -> str:
    """Programs by data set, over the pairs of one place."""
    rows = []
    for kind in [*dict.fromkeys(r["kind"] for r in records), "all"]:
        # One setting over all sets, as a person would have one.
        for program, of_all in best_settings(records).items():
            found = [r for r in of_all if kind in (r["kind"], "all")]
            right = [r for r in found if r["right"]]
            own = found[0]["reported"] is not None
            rows.append([
                kind, program, found[0]["setting"], str(len(found)), str(len(right)),
                str(sum(r["reported"] for r in right)) if own else "no rule",
                str(sum(bool(r["reported"]) and not r["right"] for r in found)) if own else "no rule",
                f"{median(r['mm'] for r in right):.1f}" if right else "-",
                f"{median(r['deg'] for r in right):.3f}" if right else "-",
                f"{median(r['seconds'] for r in found):.2f}",
            ])  # fmt: skip
    head = (
        "scans", "program", "setting", "pairs", "best pose right", "right and believed", "wrong and believed",
        "median mm", "median deg", "pair s",
    )  # fmt: skip
    return markdown(head, rows)


def strangers(records: list[Record], best: dict[str, str]) -> str:
    """Pairs of different places that programs believe."""
    rows = []
    for kind in dict.fromkeys(r["kind"] for r in records):
        for program, setting in best.items():
            found = [
                r for r in records if (r["kind"], r["program"], r["setting"]) == (kind, program, setting)
            ]
            if found:
                own = found[0]["reported"] is not None
                believed = str(sum(bool(r["reported"]) for r in found)) if own else "no rule"
                rows.append([kind, program, str(len(found)), believed])
    return markdown(("scans", "program", "pairs of different places", "believed"), rows)


def every_pair(records: list[Record]) -> str:
    """Each pair of one place: ours, with where the truth was lost, beside the peers."""
    best = best_settings(records)
    rows = []
    for one in best[OURS]:
        others = [
            error_text(next(r for r in found if r["pair"] == one["pair"]))
            for program, found in best.items()
            if program != OURS
        ]
        rows.append([one["pair"], f"{one['distance_m']:.1f}", *described(one), *others])
    names = [program for program in best if program != OURS]
    return markdown(("pair", "m apart", "ours", "verdict", "lost", "reason", *names), rows)


def error_text(r: Record) -> str:
    if "mm" not in r:
        return "no pose"
    return f"{'right' if r['right'] else 'WRONG'}, {Error(r['mm'], r['deg'])}"


def described(r: Record) -> list[str]:
    """Our pose, what is believed of it, where the truth was lost and why it is not believed."""
    lost_at = "" if r["right"] else r.get("lost", "")
    if lost_at:
        rank = r["hypothesis_rank"]
        lost_at += f" (hypothesis {'-' if rank is None else rank} of {r['hypotheses']})"
    return [error_text(r), r["verdict"], lost_at, r["reason"] or ""]


def truth_check(checks: list[Record]) -> str:
    rows = [
        [
            kind, estimator, str(len(found)),
            f"{median(r['mm'] for r in found):.1f}", f"{max(r['mm'] for r in found):.1f}",
            f"{median(r['deg'] for r in found):.3f}", f"{max(r['deg'] for r in found):.3f}",
        ]
        for kind in dict.fromkeys(r["kind"] for r in checks)
        for estimator in ("GICP", "ICP")
        if (found := [r for r in checks if (r["kind"], r["estimator"]) == (kind, estimator)])
    ]  # fmt: skip
    head = ("scans", "estimator", "pairs", "median mm", "largest mm", "median deg", "largest deg")
    return markdown(head, rows)


def page(document: dict[str, Any]) -> str:
    records = document["records"]
    same = [r for r in records if r["same_place"]]
    best = {program: found[0]["setting"] for program, found in best_settings(same).items()}
    return "\n".join([
        "# Real pairs of scans\n",
        "Written by `python -m benchmarks.real`. Right: within "
        f"{COARSE_MM / 1000:g} m and {COARSE_DEG:g} degrees of the truth "
        f"({', '.join(f'{kind}: {deg:g} degrees' for kind, deg in LOOSER_DEG.items())}). "
        "Believed: ours accepts the link; "
        "KISS-Matcher has five inliers or more and GICP converged; FPFH with RANSAC has no rule. Peers are shown at "
        "the voxel size that is right most often over all pairs, which no user could know. "
        f"Machine: {document['machine']}.\n",
        shares(same),
        "\n## Pairs of different places\n",
        strangers([r for r in records if not r["same_place"]], best),
        "\n## Every pair of one place\n",
        every_pair(same),
        "\n## The truth, checked\n",
        f"How far small_gicp's GICP and Open3D's point-to-plane ICP go from the truth when they start at it "
        f"({CHECK_VOXEL:g} m voxels, {CHECK_REACH:g} m reach).\n",
        truth_check(document["truth"]) if document["truth"] else "not installed\n",
    ])  # fmt: skip


def head_of(pair: Pair) -> Record:
    true = pair.b_from_a
    return {
        "kind": pair.kind, "pair": pair.name, "same_place": true is not None,
        "distance_m": None if true is None else float(np.linalg.norm(true[:3, 3])),
    }  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder with the data sets")
    parser.add_argument("--different", type=int, default=32, help="pairs of different places")
    parser.add_argument(
        "--only", default="", help="only programs and settings with this in their names, or truth"
    )
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--page-only", action="store_true", help="read the records, run nothing")
    parser.add_argument("--out", type=Path, default=RESULTS / "real.md", help="where the page goes")
    options = parser.parse_args()
    kept = options.out.with_suffix(".json")
    document: dict[str, Any] = {"machine": "unknown", "records": [], "truth": []}
    if kept.exists():
        document |= json.loads(kept.read_text())
    if not options.page_only:
        document["machine"] = machine()
        places = real_places(options.data, options.work)
        if not places:
            raise SystemExit(f"no real scans at {options.data}: say --data FOLDER")
        same = list(pairs_of_one_place(places))
        pairs = [*same, *pairs_of_different_places(places, options.different)]
        for family, setting, run in programs():
            if options.only not in f"{family}, {setting}":
                continue
            others = [r for r in document["records"] if (r["program"], r["setting"]) != (family, setting)]
            head = {"program": family, "setting": setting}
            found = [head | head_of(pair) | one for pair, one in zip(pairs, run(pairs), strict=True)]
            document["records"] = [*others, *found]
            options.out.parent.mkdir(parents=True, exist_ok=True)
            kept.write_text(json.dumps(document, indent=1) + "\n")
            right = sum(r["right"] for r in found)
            print(f"{family}, {setting}: right {right} of {len(same)}", flush=True)
        if options.only in "truth":
            try:
                document["truth"] = list(checked(same))
            except ImportError as error:
                print(f"truth is not checked: not installed ({error})", file=sys.stderr)
        kept.write_text(json.dumps(document, indent=1) + "\n")
    for r in document["records"]:
        r["right"] = "mm" in r and within_limits(r["kind"], Error(r["mm"], r["deg"]))
    options.out.write_text(page(document))
    print(options.out.read_text())
    wrong = [r for r in document["records"] if r["program"] == OURS and r["reported"] and not r["right"]]
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
