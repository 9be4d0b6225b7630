"""Jobs with one damaged file among four good scans: the four must be placed, the bad file named, exit 3.

    python -m benchmarks.damaged --jobs 1000

The good scans are those of a simulated site. The fifth is written in each format in turn and damaged: cut short, its
head overwritten, bytes in the middle changed where the format has checksums, a word among the numbers where it is text.
All jobs share an output folder, so that only the bad file is read anew. Exit 1 if any job ends otherwise.
"""

import argparse
import io
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np

import trihedral
from benchmarks.table import RESULTS, machine, markdown
from benchmarks.truth import simulate, site_arguments
from trihedral.fusion.rig import LineScanner, Profiles
from trihedral.io import read_headers, read_scan
from trihedral.io.rig import write_rig

UNIT = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"


def las(points: np.ndarray, suffix: str, form: int) -> bytes:
    header = laspy.LasHeader(point_format=form, version="1.4" if form > 5 else "1.2")
    header.scales = [0.0005] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    stream = io.BytesIO()
    data.write(stream, do_compress=suffix == "laz")
    return stream.getvalue()


def text(points: np.ndarray, head: str = "", more: str = "") -> bytes:
    return (head + "".join(f"{x:.4f} {y:.4f} {z:.4f}{more}\n" for x, y, z in points)).encode()


def profiles(folder: Path) -> bytes:
    turns, beams = np.radians(np.arange(0.0, 360.0, 2.0)), np.radians(np.linspace(-80, 80, 81))
    ranges = np.random.default_rng(3).uniform(1, 9, (len(turns), len(beams))).astype(np.float32)
    scanner = LineScanner("line", 0.1, 1.3, np.eye(4))
    write_rig(folder / "bad.toml", "bad", [Profiles(scanner, turns, beams, ranges, None)])
    return (folder / "bad-line.npz").read_bytes()


def samples(source: Path) -> dict[str, bytes]:
    """One scan in every format, by suffix."""
    points = read_scan(read_headers(source)[0]).xyz[:20_000].astype(np.float64)
    count = len(points) // 100 * 100
    points = points[:count]
    fields = "property float x\nproperty float y\nproperty float z\n"
    ply = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{fields}end_header\n"
    pcd = f"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {count}\nHEIGHT 1\n"
    pcd += f"POINTS {count}\nDATA binary\n"
    raw = points.astype("<f4").tobytes()
    return {
        "e57": source.read_bytes(),
        "las": las(points, "las", 3),
        "laz": las(points, "laz", 3),
        "layered.laz": las(points, "laz", 7),
        "ply": ply.encode() + raw,
        "pcd": pcd.encode() + raw,
        "pts": text(points, f"{count}\n"),
        "ptx": text(points, f"{count // 100}\n100\n{UNIT}", " 0.5"),
        "xyz": text(points),
    }


def cut(data: bytes, rng: random.Random) -> bytes:
    # Not by so little that nothing is lost.
    return data[: rng.randrange(1, len(data) * 9 // 10)]


def headless(data: bytes, rng: random.Random) -> bytes:
    return rng.randbytes(64) + data[64:]


def flipped(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def worded(data: bytes, rng: random.Random) -> bytes:
    rows = data.splitlines(keepends=True)
    rows[rng.randrange(20, len(rows))] = b"1.25 #REF! 3.5\n"
    return b"".join(rows)


def damages(kind: str) -> list[Callable[[bytes, random.Random], bytes]]:
    return {
        "e57": [cut, headless, flipped],
        "xyz": [headless, worded],
        "pts": [cut, worded],
        "ptx": [cut, worded],
    }.get(kind, [cut, headless])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=1000)
    site_arguments(parser)
    parser.set_defaults(points=60_000)
    arguments = parser.parse_args()
    said = machine()
    site = simulate("office", 1, arguments)
    *good, fifth = sorted(site.glob("*.e57"))
    whole = samples(fifth)
    kinds, ended, wrong = [*whole, "npz"], Counter[str](), []
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        whole["npz"] = profiles(work)
        for job in range(arguments.jobs):
            kind = kinds[job % len(kinds)]
            rng = random.Random(job)
            damage = rng.choice(damages(kind))
            bad = work / ("bad.toml" if kind == "npz" else f"bad.{kind}")
            part = work / "bad-line.npz" if kind == "npz" else bad
            part.write_bytes(damage(whole[kind], rng))
            result = trihedral.register([*good, bad], work / "out")
            placed = {name for name, station in result.stations.items() if station.pose is not None}
            named = [Path(failure.path) for failure in result.failures]
            right = result.exit_code == 3 and placed == {path.stem for path in good} and named == [bad]
            ended[kind] += right
            if not right:
                wrong.append(
                    f"job {job}: {kind} {damage.__name__}: exit {result.exit_code}, {sorted(placed)}, {named}"
                )
            part.unlink()
    seconds = time.monotonic() - began
    table = markdown(["format", "jobs that ended as they must"], [[kind, ended[kind]] for kind in kinds])
    page = "\n\n".join(
        [
            "# One damaged file among four good ones",
            said,
            f"`python -m benchmarks.damaged --jobs {arguments.jobs}`",
            f"{sum(ended.values())} of {arguments.jobs} jobs: four scans placed, the bad file named, exit 3; "
            f"{seconds:.0f} s.",
            table,
        ]
    )
    (RESULTS / "damaged.md").write_text(page)
    print("\n".join([page, *wrong]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
