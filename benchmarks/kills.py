"""A job that is killed again and again at random moments, and what it comes to.

    python -m benchmarks.kills --scene office --stations 20 --points 100000 --kills 50

One run is left alone. Another is killed (SIGKILL) after a random time, started again in the same folder, killed again,
and so on; after each kill the folder must hold nothing half-written. What the last run ends with must be what the run
that was left alone ended with, timings aside. Exit 1 otherwise.
"""

import argparse
import hashlib
import json
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.table import RESULTS, machine
from benchmarks.truth import COMMAND, simulate, site_arguments


def start(scans: Path, out: Path) -> subprocess.Popen[bytes]:
    command = [str(COMMAND), "register", str(scans), "--out", str(out), "--quiet"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def result(out: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((out / "registration.json").read_text())
    del document["timing"]
    for link in document["links"]:
        del link["seconds"]
    return document


def half_written(out: Path) -> list[str]:
    """What a reader could take for whole and is not."""
    found = []
    job = out / ".trihedral"
    for path in job.glob("prepared/*/*.npz"):
        if path.name.startswith("."):
            continue
        if path.stem.rpartition("-")[2] != hashlib.sha256(path.read_bytes()).hexdigest()[:32]:
            found.append(str(path))
    for path in (out / "registration.json", job / "progress.json"):
        if path.exists():
            try:
                json.loads(path.read_text())
            except ValueError:
                found.append(str(path))
    if (job / "job.sqlite").exists():
        database = sqlite3.connect(job / "job.sqlite")
        if database.execute("PRAGMA quick_check").fetchone()[0] != "ok":
            found.append("job.sqlite")
        for outcome, sha256 in database.execute("SELECT outcome, sha256 FROM pair"):
            if hashlib.sha256(outcome.encode()).hexdigest() != sha256:
                found.append("a pair")
        database.close()
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scene", default="office")
    parser.add_argument("--seed", type=int, default=1, help="of the site and of the moments")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--out", type=Path, default=RESULTS / "kills.md", help="where the outcome goes")
    site_arguments(parser)
    options = parser.parse_args()

    scans = simulate(options.scene, options.seed, options)
    moments = random.Random(options.seed)
    damaged: list[str] = []
    kills = runs = ended = 0
    with tempfile.TemporaryDirectory(dir=options.work) as folder:
        whole, out = Path(folder) / "whole", Path(folder) / "out"
        began = time.perf_counter()
        if start(scans, whole).wait() not in (0, 3, 4):
            raise SystemExit("the run that was left alone failed")
        seconds = time.perf_counter() - began
        expected = result(whole)
        while kills < options.kills:
            process = start(scans, out)
            runs += 1
            try:
                # A program needs some seconds to begin; later moments fall into its work and its end.
                process.wait(moments.uniform(0.5, 3.0 + 4.0 * seconds / options.kills))
                ended += 1
                if result(out) != expected:
                    damaged.append(f"run {runs} ended with another result")
                # What is left to kill is a run that finds all done: begin anew.
                subprocess.run(["rm", "-rf", str(out)], check=True)
                continue
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            kills += process.returncode == -signal.SIGKILL
            damaged += half_written(out) if out.exists() else []
            print(f"kill {kills}: {len(list(out.glob('.trihedral/prepared/*/*-*.npz')))} scans", flush=True)
        code = start(scans, out).wait()
        same = result(out) == expected
        left = [path.name for path in out.rglob("*.part")]
    text = (
        "# Killed at random moments\n\n"
        f"Written by `python -m benchmarks.kills`: {options.stations} stations of {options.points:,} beams "
        f"({options.scene} {options.seed}); a run left alone took {seconds:.0f} s. Machine: {machine()}.\n\n"
        f"{kills} kills in {runs} runs, of which {ended} ended by themselves before their moment came. "
        f"Half-written or different: {len(damaged)}{'' if not damaged else ': ' + '; '.join(damaged)}. "
        f"The last run ended with exit {code}, {'the same result' if same else 'ANOTHER RESULT'}, "
        f"and left {len(left)} temporary files.\n"
    )
    print(text)
    options.out.write_text(text)
    return 0 if same and not damaged and not left else 1


if __name__ == "__main__":
    sys.exit(main())
