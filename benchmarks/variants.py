"""What the default method loses when scans get worse, and when parts of it are taken away.

    python -m benchmarks.variants
    python -m benchmarks.variants --only lean      # one of them; the records of the others are kept
    python -m benchmarks.variants --only plan      # a part of the method taken away

Pairs are those of benchmarks.pairs, of one site of each kind of place. Sites are simulated anew with the same seed:
places and stations are the same, the scans are not. Records go to variants.jsonl in the work folder, the page to
benchmarks/results/variants.md.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.pairs import CLASSES, HEAD, Record, row, site_records
from benchmarks.table import RESULTS, machine, markdown
from benchmarks.truth import BARE, COLORLESS, SimulatedSite, simulate, site_arguments
from trihedral.pair.auto import AutoOptions
from trihedral.pipeline import Options
from trihedral.verdict.verification import Round, VerificationOptions

SITES = {"site": 1, "facade": 1, "office": 1, "warehouse": 11, "floors": 11}


@dataclass(frozen=True)
class Variant:
    """How scans and method differ from those of benchmarks.pairs."""

    scans: dict[str, Any] = field(default_factory=dict)  # arguments of the simulation
    options: Options = field(default_factory=Options)
    without: tuple[str, ...] = ()  # what is taken from the scans


# The first hypothesis, refined from where it is and compared with no other.
UNVERIFIED = VerificationOptions(
    hypotheses=1,
    rounds=(
        Round(
            1,
            offset=0.5,
            margin=0.5,
            compared=100,
            leniencies=(1,),
            prices=(),
            correspondence_distances=(0.6, 0.4, 0.25, 0.15, 0.07),
            refined=2000,
        ),
    ),
)
PLAIN = "as benchmarks.pairs has them"
WORSE = {
    PLAIN: Variant(),
    "without colour": Variant(without=COLORLESS),
    "without colour and intensity": Variant(without=BARE),
    "another light at each scan": Variant({"light_changes": True}),
    "leaning up to 20 degrees": Variant({"tilt": 20.0}),
    "range noise 6 mm": Variant({"noise_mm": 6.0}),
    "a quarter of the beams": Variant({"points": 250_000}),
}
LESS = {
    "plan, its first pose unverified": Variant(options=Options(auto=AutoOptions(verification=UNVERIFIED))),
}
VARIANTS = WORSE | LESS


def rows(names: Iterable[str], records: list[Record]) -> list[list[str]]:
    """Two lines a variant: from 25 % overlap up, and below."""
    found = []
    for name in names:
        of_variant = [r for r in records if r["variant"] == name]
        wide = [r for r in of_variant if r["overlap"] >= CLASSES[1][0]]
        thin = [r for r in of_variant if r["overlap"] < CLASSES[1][0]]
        found += [row(name, "from 25 %", wide), row("", "10-25 %", thin)]
    return found


def page(records: list[Record], stated: str) -> str:
    seconds = median(r["wall"] for r in records)
    return (
        "# The same pairs, scanned worse\n\n"
        "Written by `python -m benchmarks.variants`: pairs of one site of each kind of place (site 1, facade 1, "
        "office 1, warehouse 11, floors 11), 1,000,000 beams a scan (0.23 degrees), range noise 2 mm, level, unless "
        "it says otherwise. Columns are those of the page of pairs. "
        f"A pair took {seconds:.2f} s (median, wall, one process among others). Machine: {stated}.\n\n"
        + markdown(("variant", *HEAD[1:]), rows(WORSE, records))
        + "\n## Parts of the method taken away\n\n"
        "The same scans as in the first line above, whose hypotheses are the plan's, verified.\n\n"
        + markdown(("what is left", *HEAD[1:]), rows(LESS, records))
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    site_arguments(parser)
    parser.add_argument("--only", default="", help="only variants whose names have this in them")
    parser.add_argument("--page-only", action="store_true", help="read the records, run nothing")
    parser.add_argument("--out", type=Path, default=RESULTS / "variants.md", help="where the page goes")
    options = parser.parse_args()
    kept = options.work / "variants.jsonl"
    stated = machine()
    chosen = [] if options.page_only else [name for name in VARIANTS if options.only in name]
    before = [json.loads(text) for text in kept.read_text().splitlines()] if kept.exists() else []
    records = [one for one in before if one["variant"] not in chosen]
    for name in chosen:
        variant = VARIANTS[name]
        how = argparse.Namespace(**(vars(options) | variant.scans))
        for scene, seed in SITES.items():
            site = SimulatedSite(scene, seed, simulate(scene, seed, how))
            found = site_records(site, options.work, variant.options, variant.without)
            records += [{"variant": name} | one for one in found]
            kept.write_text("".join(json.dumps(one) + "\n" for one in records))
            print(f"{name}: {scene} {seed} done", flush=True)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(page(records, stated))
    print(options.out.read_text())
    return 1 if any(r["verdict"] == "accepted" and not r["right"] for r in records) else 0


if __name__ == "__main__":
    sys.exit(main())
