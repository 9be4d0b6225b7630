"""How near refinement comes to what the scans can say, beside GICP that starts at the truth, and what sets the floor.

    python -m benchmarks.accuracy               # both parts
    python -m benchmarks.accuracy --part effects

Pairs: refinement and staged GICP (small_gicp: reach 0.15, 0.07, 0.04 m, over points 2 cm apart) both start at the
truth, and their errors are told over the Cramer-Rao bound (benchmarks/bound.py). Effects: the same scans simulated
again with one effect of the simulator taken away at a time, and with all noise taken away: the effect whose absence
lowers the error most sets the floor. Records go to accuracy_*.jsonl in the work folder, the page to
benchmarks/results/accuracy.md.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.bound import bounds, least
from benchmarks.pairs import SEEDS, overlap_class
from benchmarks.peers import chosen
from benchmarks.table import RESULTS, machine, markdown
from benchmarks.truth import SimulatedSite, apart, numbers, prepared, simulate, site_arguments
from trihedral.final.point_to_plane import refine
from trihedral.geometry.se3 import motion
from trihedral.io import read_headers, read_scan
from trihedral.io.e57 import write_e57
from trihedral.scan.preparation import prepare
from trihedral.scan.prepared import Prepared
from trihedral.simulate import ScannerOptions
from trihedral.simulate.files import whole_grid
from trihedral.simulate.material import INDEX
from trihedral.simulate.mesh import Mesh
from trihedral.simulate.scene import Scene
from trihedral.simulate.scenes import build
from trihedral.simulate.site import Site
from trihedral.simulate.tracer import Tracer

Float64 = NDArray[np.float64]
Record = dict[str, Any]

GICP_REACHES = (0.15, 0.07, 0.04)  # metres
GICP_VOXEL = 0.02  # metres
THREADS = os.cpu_count() or 1


def refined(a: Prepared, b: Prepared, true: Float64) -> Float64:
    """``b_from_a`` between stations, refined from the truth."""
    start = motion(None, -b.scanner_origin) @ true @ motion(None, a.scanner_origin)
    pose: Float64 = (
        motion(None, b.scanner_origin) @ refine(a, b, start).transform @ motion(None, -a.scanner_origin)
    )
    return pose


def gicp_cloud(site: SimulatedSite, name: str) -> Any:
    import small_gicp

    points = np.asarray(read_scan(read_headers(site.file(name))[0]).xyz, dtype=np.float64)
    return small_gicp.preprocess_points(points, GICP_VOXEL, 20, THREADS)


def gicp(a: Any, b: Any, pose: Float64) -> Float64:
    import small_gicp

    for reach in GICP_REACHES:
        done = small_gicp.align(
            b[0], a[0], b[1], pose, "GICP", max_correspondence_distance=reach, num_threads=THREADS,
            max_iterations=50, rotation_epsilon=1e-7, translation_epsilon=1e-6,
        )  # fmt: skip
        pose = done.T_target_source
    return np.asarray(pose)


def pair_records(site: SimulatedSite, count: int, work: Path) -> Iterator[Record]:
    """Ours and GICP from the truth."""
    information = bounds(site, work)
    pairs = chosen(site, count)
    names = sorted({end for a, b, _ in pairs for end in (a, b)})
    scans = {name: prepared(site, name, work) for name in names}
    clouds = {name: gicp_cloud(site, name) for name in names}
    for a, b, overlap in pairs:
        true = site.b_from_a(a, b)
        ours, theirs = (
            apart(true, pose)
            for pose in (refined(scans[a], scans[b], true), gicp(clouds[a], clouds[b], true))
        )
        bound = least(information[f"{a} {b}"], true)
        yield {
            "part": "pairs", "scene": site.scene, "seed": site.seed, "a": a, "b": b, "overlap": overlap,
            "bound": [bound.mm, bound.deg], "ours": [ours.mm, ours.deg], "gicp": [theirs.mm, theirs.deg],
        }  # fmt: skip


@dataclass(frozen=True)
class Effect:
    """One thing that the simulator does, taken away."""

    name: str
    scanner: Callable[[ScannerOptions], ScannerOptions] = lambda options: options
    scene: Callable[[Scene], Scene] = lambda scene: scene


def without(*materials: str) -> Callable[[Scene], Scene]:
    """Take every face of some materials away."""
    gone = [INDEX[name] for name in materials]

    def kept(mesh: Mesh) -> Mesh:
        keep = ~np.isin(mesh.material, gone)
        return Mesh(
            mesh.vertices,
            mesh.faces[keep],
            mesh.uv[keep],
            mesh.material[keep],
            mesh.surface[keep],
            mesh.texture[keep],
        )

    def changed(scene: Scene) -> Scene:
        movers = tuple(replace(mover, mesh=kept(mover.mesh)) for mover in scene.movers)
        return replace(
            scene, mesh=kept(scene.mesh), movers=tuple(mover for mover in movers if len(mover.mesh))
        )

    return changed


EFFECTS = (
    Effect("nothing taken away"),
    Effect("mixed pixels", lambda o: replace(o, mixed_pixels=False)),
    Effect("angular noise", lambda o: replace(o, angular_noise_arcsec=0.0)),
    Effect("noise of weak signals (incidence, distance)", lambda o: replace(o, signal_noise_m=0.0)),
    Effect("coarse sampling (four times the beams)", lambda o: o.with_beams(4 * o.grid[0] * o.grid[1])),
    Effect("vegetation", scene=without("leaf", "bark")),
    Effect("rough ground", scene=without("earth", "gravel", "grass")),
    Effect("things that move", scene=lambda scene: replace(scene, movers=())),
    Effect("glass", scene=without("glass")),
    Effect(
        "all noise",
        lambda o: replace(o, range_noise_m=0.0, signal_noise_m=0.0, angular_noise_arcsec=0.0),
    ),
    Effect(
        "all noise, mixed pixels and things that move",
        lambda o: replace(
            o, range_noise_m=0.0, signal_noise_m=0.0, angular_noise_arcsec=0.0, mixed_pixels=False
        ),
        lambda scene: replace(scene, movers=()),
    ),
)


def effect_records(site: SimulatedSite, count: int) -> Iterator[Record]:
    """So many pairs, simulated again without each effect."""
    scanner = replace(ScannerOptions(**site.truth["scanner"]), color=False)
    pairs = chosen(site, count)
    names = sorted({end for a, b, _ in pairs for end in (a, b)})
    poses = np.array([site.poses[name] for name in names])
    whole = build(site.scene, site.seed)
    for effect in EFFECTS:
        scene = effect.scene(whole)
        changed = Site(scene, effect.scanner(scanner), poses, tuple(names), Tracer(scene.mesh))
        scans = {}
        with tempfile.TemporaryDirectory() as folder:
            for k, name in enumerate(names):
                file = Path(folder) / f"{name}.e57"
                write_e57(file, [whole_grid(changed.scan(k))])
                scans[name] = prepare(read_scan(read_headers(file)[0]))
        for a, b, overlap in pairs:
            true = site.b_from_a(a, b)
            error = apart(true, refined(scans[a], scans[b], true))
            yield {
                "part": "effects", "scene": site.scene, "seed": site.seed, "a": a, "b": b,
                "overlap": overlap, "effect": effect.name, "mm": error.mm, "deg": error.deg,
            }  # fmt: skip


def pairs_table(records: list[Record]) -> str:
    head = [
        "scene", "overlap", "pairs", "bound mm", "ours mm", "GICP mm", "ours / bound", "GICP / bound",
        "ours / bound, deg", "GICP / bound, deg", "ours nearer",
    ]  # fmt: skip
    lines = []
    scenes = sorted({r["scene"] for r in records})
    classes = sorted({overlap_class(r["overlap"]) for r in records})
    for scene in [*scenes, "all"]:
        for name in [*classes, "all"]:
            part = [
                r
                for r in records
                if scene in (r["scene"], "all") and name in (overlap_class(r["overlap"]), "all")
            ]
            if not part:
                continue
            ratios = {
                (who, k): median(r[who][k] / r["bound"][k] for r in part)
                for who in ("ours", "gicp")
                for k in (0, 1)
            }
            nearer = sum(r["ours"][0] <= r["gicp"][0] for r in part)
            lines.append(
                [
                    scene, name, len(part),
                    *(f"{median(r[who][0] for r in part):.3f}" for who in ("bound", "ours", "gicp")),
                    *(f"{ratios[who, k]:.1f}" for k in (0, 1) for who in ("ours", "gicp")),
                    f"{100 * nearer / len(part):.0f} %",
                ]
            )  # fmt: skip
    return markdown(head, lines)


def effects_table(records: list[Record]) -> str:
    lines = []
    for scene in [*sorted({r["scene"] for r in records}), "all"]:
        of_scene = [r for r in records if scene in (r["scene"], "all")]
        base = {(r["a"], r["b"]): r for r in of_scene if r["effect"] == EFFECTS[0].name}
        for effect in EFFECTS:
            part = [r for r in of_scene if r["effect"] == effect.name]
            if part:
                shares = [median(r[k] / base[r["a"], r["b"]][k] for r in part) for k in ("mm", "deg")]
                figures = [f"{median(r['mm'] for r in part):.3f}", f"{median(r['deg'] for r in part):.5f}"]
                lines.append([scene, effect.name, len(part), *figures, *(f"{s:.2f}" for s in shares)])
    head = ["scene", "taken away", "pairs", "mm", "deg", "mm, of that with it", "deg, of that with it"]
    return markdown(head, lines)


def page(records: list[Record], stated: str) -> str:
    of_pairs = [r for r in records if r["part"] == "pairs"]
    of_effects = [r for r in records if r["part"] == "effects"]
    return "\n".join(
        [
            "# Accuracy beside the Cramer-Rao bound\n",
            "Written by `python -m benchmarks.accuracy`. Both programs start at the truth; figures are medians. The "
            "bound is the root mean square error that no unbiased method goes below (benchmarks/bound.py), so a "
            f"perfect one has a median ratio of about 0.9. Machine: {stated}.\n",
            pairs_table(of_pairs),
            "\n## What sets the floor\n",
            "The same stations simulated again without one effect; errors of refinement from the truth, and their "
            "medians over the same pairs with nothing taken away.\n",
            effects_table(of_effects),
        ]
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    site_arguments(parser)
    parser.add_argument("--part", choices=("pairs", "effects"), help="only this; the other from the records")
    parser.add_argument("--scenes", default=",".join(SEEDS), help="separated by commas")
    parser.add_argument("--seeds-each", type=int, default=3, help="sites of each kind of place")
    parser.add_argument("--pairs-each", type=int, default=4, help="pairs of each site")
    parser.add_argument("--page-only", action="store_true", help="read the records, run nothing")
    parser.add_argument("--out", type=Path, default=RESULTS / "accuracy.md")
    options = parser.parse_args()
    stated = machine()
    parts = () if options.page_only else (options.part,) if options.part else ("pairs", "effects")
    for part in parts:
        with (options.work / f"accuracy_{part}.jsonl").open("w") as stream:
            for scene in options.scenes.split(","):
                for seed in numbers(SEEDS[scene])[: options.seeds_each if part == "pairs" else 1]:
                    site = SimulatedSite(scene, seed, simulate(scene, seed, options))
                    if part == "pairs":
                        found = pair_records(site, options.pairs_each, options.work)
                    else:
                        found = effect_records(site, options.pairs_each)
                    for one in found:
                        stream.write(json.dumps(one) + "\n")
                        stream.flush()
                    print(f"{site.folder.name}: {part} done", flush=True)
    records = [
        json.loads(text)
        for part in ("pairs", "effects")
        if (path := options.work / f"accuracy_{part}.jsonl").exists()
        for text in path.read_text().splitlines()
    ]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(page(records, stated))
    print(options.out.read_text())
    return 0


if __name__ == "__main__":
    sys.exit(main())
