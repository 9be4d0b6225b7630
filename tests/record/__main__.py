"""The record: what jobs gave, to the bit, so that a change that is to change nothing can show that it does not.

    python -m tests.record --check      # run every job and say where it differs from record.json; exit 1 if it does
    python -m tests.record              # run every job and write record.json anew

It is a statement about moves, types and names, not about quality. A change that improves results makes it stale on
purpose: write it anew with one command, in a commit that says why. Kept are hashes of the input files; verdicts;
hashes of the bits of poses, covariances and other figures; poses themselves; hashes of words and evidence, which are
compared with `--all` only, since names change. Of the paper's method, figures to the three digits of its tables.

Bits depend on the processor and on the libraries too; `machine` in the record says on which they were made. On
others, verdicts are compared, and poses to 0.1 mm and 0.001 degrees, where the scans are the same.

`test_record.py` runs the jobs that take seconds; the building of ten, the pairs chosen by previews and the paper's
Table 5 run here only. From the root of the project, with the package installed; real data lie in ../shared as for the
tests.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tests.record.comparison import changes, departures
from tests.record.jobs import JOBS
from tests.record.machine import machine
from tests.record.outcome import run

RECORD = Path(__file__).with_name("record.json")
SHARED = Path(__file__).resolve().parents[2] / ".." / "shared"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.record", description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="compare, and write nothing")
    parser.add_argument("--all", action="store_true", help="compare words and evidence too")
    parser.add_argument("--jobs", default=",".join(JOBS), help="with commas between")
    parser.add_argument("--threads", type=int, help="as of `trihedral register`")
    parser.add_argument("--shared", type=Path, default=SHARED, help="where real data lie")
    asked = parser.parse_args()
    if asked.threads:
        os.environ["RAYON_NUM_THREADS"] = str(asked.threads)
    record = json.loads(RECORD.read_text()) if RECORD.exists() else {"machine": machine(), "jobs": {}}
    same = record["machine"] == machine()
    jobs = asked.jobs.split(",")
    if not asked.check and not same and set(jobs) != set(JOBS):
        parser.error("the record is of another machine: write all of it anew")
    if asked.check and not same:
        print("Another machine than the record's: verdicts and poses are compared, not bits.")
    failed = False
    for name in jobs:
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as work:
            now = run(name, Path(work), asked.shared, asked.threads)
        found: list[str] = []
        if asked.check:
            recorded = record["jobs"][name]
            found = changes(recorded, now, aside=asked.all) if same else departures(recorded, now)
        else:
            record["jobs"][name] = now
        print(f"{name}: {time.perf_counter() - began:.0f} s, {len(found)} differences", flush=True)
        print("".join(f"  {line}\n" for line in found), end="")
        failed |= bool(found)
    if not asked.check:
        record = {"machine": machine(), "jobs": {name: record["jobs"][name] for name in JOBS}}
        RECORD.write_text(_laid_out(record) + "\n")
    return failed


def _laid_out(value: Any, depth: int = 0) -> str:
    """Write JSON with one line a file, a station, a link: a change shows as the lines it concerns."""
    if depth == 4 or not isinstance(value, dict) or not value:
        return json.dumps(value)
    indent = " " * (depth + 1)
    lines = [f"{indent}{json.dumps(key)}: {_laid_out(item, depth + 1)}" for key, item in value.items()]
    return "{\n" + ",\n".join(lines) + "\n" + " " * depth + "}"


if __name__ == "__main__":
    sys.exit(main())
