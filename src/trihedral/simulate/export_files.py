"""A simulated site as people's programs export it: one folder a variant, with a `truth.json` of its own.

A variant is a list of kinds and at most one format, in the order in which they are done: `nogrid`, `thinned=0.03`,
`random=0.2,hanging,laz`.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from trihedral.errors import OptionError
from trihedral.geometry.arrays import Float64
from trihedral.simulate.covisible import still_points
from trihedral.simulate.export_formats import FORMATS
from trihedral.simulate.exports import CROPS, MERGED, NUMBERED, PLAIN, FileScan, as_measured, merged
from trihedral.simulate.files import (
    TRUTH,
    made_by,
    pair_overlaps,
    prepare_folder,
    station_entry,
    write_site,
    write_truth,
    writing,
)
from trihedral.simulate.scanner import SimulatedScan
from trihedral.simulate.site import Site
from trihedral.simulate.trajectory import trajectory

TRAJECTORY = "trajectory"
# Of a way, metres, where it is not said.
LONGEST_WAY = 10.0


@dataclass(frozen=True)
class Variant:
    """One way of exporting a site's scans."""

    #: As it was asked for.
    text: str
    #: Names of kinds, with a number where the kind has one.
    steps: tuple[tuple[str, float | None], ...] = ()
    #: A key of `FORMATS`.
    format: str = "e57"
    #: Whether all scans go into one file.
    merged: bool = False
    #: Metres that the scanner moves while it measures; None where it stands.
    way: float | None = None

    @property
    def folder(self) -> str:
        """Name of its folder."""
        return self.text.replace("=", "-").replace(",", "_")

    def of(self, scan: FileScan) -> FileScan:
        """Do all steps, one after another."""
        for name, number in self.steps:
            scan = PLAIN[name](scan) if number is None else NUMBERED[name][0](scan, number)
        return scan


def parse_variant(text: str) -> Variant:
    """Read kinds and a format, separated by commas.

    Raises
    ------
    OptionError
        A kind is unknown, or its number is missing or makes no sense.
    """
    steps: list[tuple[str, float | None]] = []
    kept, joined, way = None, False, None
    for part in text.split(","):
        name, equals, number = part.partition("=")
        if name in PLAIN and not equals:
            steps.append((name, None))
        elif name in NUMBERED:
            steps.append((name, _number(part, number, *NUMBERED[name][1:])))
        elif name in FORMATS and not equals and kept is None:
            kept = name
        elif name == MERGED and not equals:
            joined = True
        elif name == TRAJECTORY:
            way = _number(part, number, 0.5, 1000.0) if equals else LONGEST_WAY
        else:
            raise OptionError(f"There is no export {part!r}: choose from {', '.join(kinds())}.")
    return Variant(text, tuple(steps), kept or "e57", joined, way)


def kinds() -> list[str]:
    """Name all kinds and formats."""
    numbered = [f"{name}=NUMBER" for name in NUMBERED]
    return [*PLAIN, *numbered, MERGED, f"{TRAJECTORY}[=METRES]", *FORMATS]


def _number(part: str, text: str, least: float, most: float) -> float:
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if not least <= number <= most:
        raise OptionError(
            f"Export {part!r}: its number lies between {least:g} and {most:g}; it is not {text!r}."
        )
    return number


def write_exports(site: Site, folder: Path | str, variants: Sequence[Variant]) -> Iterator[SimulatedScan]:
    """Write a site as `write_site` does, and each variant into a folder of its own in it.

    Raises
    ------
    OutputError
        The folder holds something else, or cannot be written.
    """
    folder = Path(folder)
    written = [_Export(site, variant, folder / variant.folder) for variant in variants]
    samples: list[Float64] = []
    for k, one in enumerate(write_site(site, folder)):
        samples.append(still_points(one))
        for export in written:
            export.add(k, one)
        yield one
    pairs = json.loads((folder / TRUTH).read_text("utf-8"))["pairs"]
    for export in written:
        export.finish(samples, pairs)


@dataclass
class _Export:
    """A variant that is being written."""

    site: Site
    variant: Variant
    folder: Path
    #: As files, without their points.
    scans: list[FileScan] = field(default_factory=list)
    stations: list[dict[str, object]] = field(default_factory=list)
    #: Scans that wait to be merged.
    waiting: list[FileScan] = field(default_factory=list)

    def add(self, k: int, one: SimulatedScan) -> None:
        """Take station `k`."""
        if k == 0:
            names = [MERGED] if self.variant.merged else self.site.names
            prepare_folder(self.folder, [*(f"{name}.{self.variant.format}" for name in names), TRUTH])
        way = self.variant.way
        scan = as_measured(one, (self.site.scene.seed, k)) if way is None else trajectory(self.site, k, way)
        scan = self.variant.of(scan)
        if self.variant.merged:
            self.waiting.append(scan)
        else:
            self.write(scan.name, scan)

    def write(self, name: str, scan: FileScan) -> None:
        """Write one file, and keep what the truth says of it."""
        path = self.folder / f"{name}.{self.variant.format}"
        with writing(path):
            FORMATS[self.variant.format](path, scan)
        entry = station_entry(path, len(scan), scan.project_from_file)
        self.stations.append({**entry, "scanners": scan.scanners.tolist()})
        self.scans.append(scan.of(slice(0)))

    def finish(self, samples: list[Float64], pairs: list[dict[str, object]]) -> None:
        """Write what waits, and the truth; `pairs` is what that of the whole scans says."""
        if self.variant.merged:
            self.write(MERGED, merged(self.waiting))
            self.waiting, pairs = [], []
        elif any(name in CROPS for name, _ in self.variant.steps):
            pairs = pair_overlaps(self.site, samples, [scan.keeps for scan in self.scans])
        made = {**made_by(self.site), "export": self.variant.text}
        write_truth(self.folder, made, self.stations, pairs)
