"""Drift of a long network without loops and with them, held against what the covariances say.

    python -m benchmarks.drift estate-100.json --truth benchmarks/work/sites/estate-1-100x1000000-2mm-tilt0/truth.json

Takes the result of a job on simulated scans (`python -m benchmarks.projects --keep`). Of its largest part, the
accepted links are adjusted twice: only those of the shortest spanning tree, so that nothing closes, and all of them.
Stations are held against the truth, from the station that defines the frame; loops are those of the result.
"""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from benchmarks.networks import header, neutral_evidence
from benchmarks.table import markdown
from trihedral.geometry.se3 import inverse
from trihedral.model.link import Link, LinkVerdict, PoseEstimate
from trihedral.model.station import Station
from trihedral.network.options import NetworkOptions
from trihedral.network.solve import solve

Float64 = NDArray[np.float64]

# Links of simulated scans err by what they say; real ones by the systematic share that is assumed.
HONEST = NetworkOptions(systematic_translation=1e-9, systematic_rotation=1e-9)
FAR = 50.0  # metres from the anchor, beyond which a station counts for the drift


def accepted(document: dict[str, Any]) -> list[Link]:
    """Links of the largest part with their covariances."""
    part = {s["name"] for s in document["stations"] if s["component"] == 0}
    return [
        Link(
            from_station=link["from"],
            to_station=link["to"],
            verdict=LinkVerdict.ACCEPTED,
            estimate=PoseEstimate(np.array(link["transform"]), np.array(link["covariance"])),
            evidence=neutral_evidence(link["evidence"].get("score", 0.0)),
        )
        for link in document["links"]
        if link["accepted"] and link["from"] in part
    ]


def tree(links: list[Link], places: dict[str, Float64]) -> list[Link]:
    """Those of the spanning tree that is shortest in metres."""
    names = sorted({name for link in links for name in (link.from_station, link.to_station)})
    number = {name: k for k, name in enumerate(names)}
    ends = np.array([(number[k.from_station], number[k.to_station]) for k in links]).T
    lengths = [float(np.linalg.norm(places[k.from_station] - places[k.to_station])) for k in links]
    chosen = minimum_spanning_tree(coo_array((lengths, ends), shape=(len(names), len(names))).tocsr()).tocoo()
    kept = set(zip(chosen.row.tolist(), chosen.col.tolist(), strict=True))
    return [link for link, pair in zip(links, ends.T.tolist(), strict=True) if tuple(pair) in kept]


def row(name: str, links: list[Link], true: dict[str, Float64], options: NetworkOptions) -> list[str]:
    """One adjustment: errors of the far stations, and of the loops, over what is expected of them."""
    names = sorted({name for link in links for name in (link.from_station, link.to_station)})
    result = solve([Station(n, header(n), 1, n) for n in names], links, options)
    base = next(s.name for s in result.stations if s.pose is not None and not any(s.sigma_translation_m))
    ratios, largest, farthest = [], 0.0, 0.0
    for station in result.stations:
        if station.pose is None:
            continue
        truly = (inverse(true[base]) @ true[station.name])[:3, 3]
        distance = float(np.linalg.norm(truly))
        error = station.pose[:3, 3] - truly
        largest = max(largest, 1e3 * float(np.linalg.norm(error)))
        farthest = max(farthest, distance)
        if distance > FAR:
            ratios.append(error / np.array(station.sigma_translation_m))
    loops = [loop.translation_m / loop.expected_translation_m for loop in result.loops]

    def root_mean_square(values: Any) -> str:
        return f"{math.sqrt(np.mean(np.square(values))):.2f}" if len(values) else "-"

    return [
        name,
        str(len(names)),
        str(len(links)),
        f"{farthest:.0f}",
        f"{largest:.1f}",
        str(len(ratios)),
        root_mean_square(ratios),
        str(len(loops)),
        f"{1e3 * max(loop.translation_m for loop in result.loops):.1f}" if loops else "-",
        root_mean_square(loops),
    ]


HEAD = (
    "adjusted", "stations", "links", "farthest m", "largest mm", "beyond 50 m", "error over sigma", "loops",
    "largest closure mm", "closure over expected",
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("result", type=Path, help="registration.json of a job on simulated scans")
    parser.add_argument("--truth", type=Path, required=True, help="truth.json of the scans")
    options = parser.parse_args()
    truth = json.loads(options.truth.read_text())
    true = {Path(s["file"]).stem: np.array(s["project_from_station"]) for s in truth["stations"]}
    links = accepted(json.loads(options.result.read_text()))
    open_ones = tree(links, {name: pose[:3, 3] for name, pose in true.items()})
    rows = []
    for what, how in (("as links say", HONEST), ("with what is assumed of real ones", NetworkOptions())):
        rows += [row(f"no loops, {what}", open_ones, true, how), row(f"all links, {what}", links, true, how)]
    print(markdown(HEAD, rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
