"""The same stations as people's exports have them: what is tied of what is tied with the grid, and how well.

    python -m benchmarks.exports --quick      # two places
    python -m benchmarks.exports              # eight places of seven kinds

Each place is simulated once, with all variants (`trihedral simulate --export`), and kept in benchmarks/work/exports/;
each variant is registered by the command in an empty folder and held against its own truth. What the same program has
done already is not done again. Exit 1 if a wrong station or link is accepted anywhere. The table goes to
benchmarks/results/exports.md, records to exports.json beside it.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.pairs import plain
from benchmarks.sites import compare, register
from benchmarks.table import RESULTS, WORK, machine, markdown
from benchmarks.truth import COMMAND, apart
from trihedral.pipeline import Options, stages

Float64 = NDArray[np.float64]
Record = dict[str, Any]

# What beams do at edges: a pulse tells surfaces apart that are 0.3 m from each other; a phase is mixed of far ones.
PULSE: tuple[str, ...] = ()
PHASE = ("--pulse-length", "5", "--beam-mrad", "0.5")
# scene:seed, with how it is scanned.
PLACES = {
    "office:1": PULSE,
    "facade:1": PULSE,
    "building:1": PHASE,
    "site:1": PULSE,
    "warehouse:11": PHASE,
    "estate:1": PHASE,
    "floors:11": PHASE,
    "office:21": PHASE,
}
QUICK = ("office:1", "facade:1")
GRID = "grid"


@dataclass(frozen=True)
class Export:
    """A variant, what it is held against, and the share of what is tied there that must be tied here."""

    name: str
    kinds: str  # as `--export` takes them; nothing for the scans as measured
    against: str = GRID
    asked: float = 95.0


EXPORTS = (
    Export(GRID, "", asked=0.0),
    Export("no grid", "nogrid"),
    Export("thinned to 1 cm", "thinned=0.01"),
    Export("thinned to 2 cm", "thinned=0.02"),
    Export("thinned to 3 cm", "thinned=0.03", asked=90.0),
    Export("thinned to 5 cm", "thinned=0.05", asked=90.0),
    Export("a random fifth", "random=0.2", asked=90.0),
    Export("half circle, grid", "window=180", asked=0.0),
    Export("half circle, no grid", "window=180,nogrid", against="half circle, grid"),
    Export("hanging, no grid", "hanging,nogrid"),
    Export("lying, no grid", "lying,nogrid"),
    Export("LAZ", "nogrid,laz"),
    Export("XYZ", "nogrid,xyz"),
)
BY_NAME = {export.name: export for export in EXPORTS}
MOST_MM = 0.2  # more than with the grid, that poses may be off


def simulated(place: str, options: argparse.Namespace) -> Path:
    """Make a place with all variants, or take the one that an earlier run made with the same options."""
    scene, _, seed = place.partition(":")
    wanted = [export.kinds for export in EXPORTS if export.kinds]
    how = PLACES.get(place, PULSE)
    which = hashlib.sha256(" ".join([*wanted, *how]).encode()).hexdigest()[:8]
    name = f"{scene}-{seed}-{options.stations}x{options.points}-{which}"
    folder: Path = options.work / "exports" / name
    if not folder.exists():
        unfinished = folder.with_name(f"{name}.part")
        unfinished.parent.mkdir(parents=True, exist_ok=True)
        arguments = [
            "--seed",
            seed,
            "--stations",
            options.stations,
            "--points",
            options.points,
            "--quiet",
            *how,
        ]
        arguments += [part for kinds in wanted for part in ("--export", kinds)]
        command = [str(part) for part in (COMMAND, "simulate", scene, *arguments, "--out", unfinished)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        unfinished.rename(folder)
    return folder


def run(place: str, export: Export, scans: Path, options: argparse.Namespace) -> Record:
    """Register one variant of a place, and hold it against its truth."""
    folder = scans / export.kinds.replace("=", "-").replace(",", "_") if export.kinds else scans
    truth = json.loads((folder / "truth.json").read_text())
    with tempfile.TemporaryDirectory(dir=options.work) as out:
        job = register(folder, Path(out) / "out", 2 // options.processes)
    outcome = compare(place, truth, job)
    stations = job.document["stations"]
    sizes = {c: sum(s["component"] == c for s in stations) for c in {s["component"] for s in stations}}
    links = [
        {
            "ends": [link["from"], link["to"]], "accepted": link["accepted"], "reason": link["reason"],
            "overlap": overlap, "mm": error and error.mm, "deg": error and error.deg,
            "wrong": error is None or error.wrong,
        }
        for link, error, overlap in outcome.links
    ]  # fmt: skip
    return {
        "place": place,
        "export": export.name,
        "stations": len(truth["stations"]),
        "points": sum(s["points"] for s in truth["stations"]),
        # A station alone in its part is tied to nothing.
        "tied": {
            s["name"]: {"part": s["component"], "pose": s["pose"]}
            for s in stations
            if s["pose"] is not None and sizes[s["component"]] > 1
        },
        "true": {s["name"]: s["project_from_station"] for s in truth["stations"]},
        "wrong_stations": outcome.wrong,
        "links": links,
        "reasons": [s["reason"] for s in stations if s["reason"]],
        "seconds": sum(job.wall.values()),
        "peak_mb": job.peak_mb,
    }


def errors(record: Record, names: Sequence[str]) -> dict[str, float]:
    """Millimetres that tied stations are off, from the first of `names` in their part."""
    found: dict[str, float] = {}
    first: dict[int, str] = {}
    for name in names:
        at = record["tied"][name]
        anchor = first.setdefault(at["part"], name)
        if anchor != name:
            true, pose = (
                np.linalg.inv(np.array(of[anchor])) @ np.array(of[name])
                for of in (record["true"], {k: v["pose"] for k, v in record["tied"].items()})
            )
            found[name] = apart(true, pose).mm
    return found


def extra(record: Record, reference: Record) -> list[float]:
    """Millimetres by which each station that both tie is farther off than in the reference; frames may differ."""
    both = sorted(record["tied"].keys() & reference["tied"].keys())
    here, there = errors(record, both), errors(reference, both)
    return [here[name] - there[name] for name in both if name in here and name in there]


HEAD = (
    "export", "of what", "tied", "asked", "poses off more, median mm", "largest mm", "largest error mm",
    "pairs right", "of these believed", "wrong stations", "wrong links accepted", "s a place",
)  # fmt: skip


def row(export: Export, records: Sequence[Record], references: Sequence[Record]) -> list[str]:
    """One line: a variant over some places, against the same places of its reference."""
    kept = wanted = 0
    more: list[float] = []
    largest: list[float] = []
    for record, reference in zip(records, references, strict=True):
        wanted += len(reference["tied"])
        kept += len(record["tied"].keys() & reference["tied"].keys())
        more += extra(record, reference)
        largest += errors(record, sorted(record["tied"])).values()
    links = [link for record in records for link in record["links"]]
    right = [link for link in links if not link["wrong"]]
    return [
        export.name,
        export.against,
        f"{kept} of {wanted} ({100 * kept / wanted:.0f} %)" if wanted else "-",
        f"{export.asked:.0f} %" if export.asked else "-",
        f"{median(more):.2f}" if more else "-",
        f"{max(more):.2f}" if more else "-",
        f"{max(largest):.2f}" if largest else "-",
        str(len(right)),
        str(sum(link["accepted"] for link in right)),
        str(sum(record["wrong_stations"] for record in records)),
        str(sum(link["accepted"] and link["wrong"] for link in links)),
        f"{median(record['seconds'] for record in records):.0f}",
    ]


def table(records: Sequence[Record], places: Sequence[str]) -> str:
    """Every variant over the places that have it and its reference."""
    rows = []
    for export in EXPORTS:
        found = [(one(records, p, export.name), one(records, p, export.against)) for p in places]
        whole = [(r, reference) for r, reference in found if r is not None and reference is not None]
        if whole:
            rows.append(row(export, *zip(*whole, strict=True)))
    return markdown(HEAD, rows)


def one(records: Sequence[Record], place: str, name: str) -> Record | None:
    return next((r for r in records if (r["place"], r["export"]) == (place, name)), None)


def by_place(records: Sequence[Record], places: Sequence[str]) -> str:
    """Stations tied, of each place."""
    rows = []
    for export in EXPORTS:
        cells = [one(records, place, export.name) for place in places]
        rows.append(
            [export.name, *("-" if r is None else f"{len(r['tied'])} of {r['stations']}" for r in cells)]
        )
    return markdown(("export", *places), rows)


def missed(records: Sequence[Record]) -> str:
    """Why right pairs are not believed, counted."""
    counts: dict[tuple[str, str], int] = {}
    for record in records:
        for link in record["links"]:
            if not link["wrong"] and not link["accepted"]:
                key = (record["export"], plain(link["reason"]))
                counts[key] = counts.get(key, 0) + 1
    order = list(BY_NAME)
    rows = [
        [*key, str(n)] for key, n in sorted(counts.items(), key=lambda kv: (order.index(kv[0][0]), -kv[1]))
    ]
    return markdown(("export", "right, but not believed", "pairs"), rows) if rows else "None.\n"


def wrong(records: Sequence[Record]) -> list[str]:
    """Each wrong link that is accepted, for a person who looks into it."""
    return [
        f"- {r['place']}, {r['export']}: {' - '.join(link['ends'])}, overlap {link['overlap']:.2f}, "
        f"{link['mm'] or 0:.1f} mm {link['deg'] or 0:.3f} deg"
        for r in records
        for link in r["links"]
        if link["accepted"] and link["wrong"]
    ]


def page(document: dict[str, Any], places: Sequence[str]) -> str:
    records = [r for r in document["records"] if r["place"] in places]
    mixed = ", ".join(place for place in places if PLACES.get(place))
    return "\n".join([
        "# The same stations as people's exports have them\n",
        f"Written by `python -m benchmarks.exports`: {len(places)} places, {document['stations']} stations each, "
        f"{document['points']:,} beams a scan, registered by the command and held against their truth. Echoes are "
        f"mixed over 5 m in {mixed or 'none'}, over 0.3 m elsewhere. Tied: stations in a part "
        "of two or more, of those that the reference ties. Poses off more: millimetres by which a station "
        f"is farther off than in the reference, from the same station; asked is {MOST_MM:g} mm. Right and wrong: "
        f"within 10 mm and 0.05 degrees or not. Machine: {document['machine']}.\n",
        table(records, places),
        "\n## Stations tied, by place\n",
        by_place(records, places),
        "\n## Wrong links that are accepted\n",
        "\n".join(wrong(records)) or "None.",
        "\n## Right pairs that are not believed\n",
        missed(records),
    ])  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help=f"only {' and '.join(QUICK)}")
    parser.add_argument("--places", help="scene:seed, separated by commas")
    parser.add_argument(
        "--only", default="", help="only variants whose names have this in them, and references"
    )
    parser.add_argument("--stations", type=int, default=5)
    parser.add_argument("--points", type=int, default=1_000_000, help="beams a scan; 1,000,000: 0.23 degrees")
    parser.add_argument(
        "--processes", type=int, choices=(1, 2), default=2, help="variants registered at a time"
    )
    parser.add_argument("--work", type=Path, default=WORK, help="where simulated places are kept")
    parser.add_argument("--page-only", action="store_true", help="read the records, run nothing")
    parser.add_argument("--out", type=Path, default=RESULTS / "exports.md", help="where the table goes")
    options = parser.parse_args()
    places = options.places.split(",") if options.places else list(QUICK if options.quick else PLACES)
    kept = options.out.with_suffix(".json")
    made = {
        "program": hashlib.sha256(stages(Options()).pair_version.encode() + stages(Options()).program.encode())
        .hexdigest()[:16],
        "stations": options.stations,
        "points": options.points,
    }  # fmt: skip
    document: dict[str, Any] = {**made, "machine": machine(), "records": []}
    if kept.exists():
        before = json.loads(kept.read_text())
        if options.page_only or all(before[key] == value for key, value in made.items()):
            document = before
    if not options.page_only:
        chosen = [export for export in EXPORTS if options.only in export.name]
        chosen = [e for e in EXPORTS if e in chosen or e.name in {c.against for c in chosen}]
        kept.parent.mkdir(parents=True, exist_ok=True)
        for place in places:
            scans = simulated(place, options)
            waiting = [export for export in chosen if one(document["records"], place, export.name) is None]
            with ThreadPoolExecutor(options.processes) as pool:
                for record in pool.map(lambda e, p=place, s=scans: run(p, e, s, options), waiting):
                    document["records"].append(record)
                    kept.write_text(json.dumps(document) + "\n")
                    options.out.write_text(page(document, places))
                    tied = f"{len(record['tied'])} of {record['stations']} tied"
                    print(f"{place}, {record['export']}: {tied}, {record['seconds']:.0f} s", flush=True)
    options.out.write_text(page(document, places))
    print(options.out.read_text())
    bad = [r for r in document["records"] if r["wrong_stations"]]
    return 1 if bad or wrong(document["records"]) else 0


if __name__ == "__main__":
    sys.exit(main())
