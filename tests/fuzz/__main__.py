"""Damages small files of every kind that Python reads, and reads them.

    python -m fuzz --seconds 60 laz npz     # from the folder tests; all kinds without a name

A reader may give something, or raise an error that names the file. Anything else is a fault, and so are more than
10 s, or more memory than `guarded.allowed_memory` says. The damage is Hypothesis's choice; what fails is kept small.
"""

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from fuzz.kinds import KINDS, Kind
from trihedral.errors import InputError, OptionError
from trihedral.guarded import allowed_memory

SECONDS = 10.0
# Examples of one run of Hypothesis, which keeps all of them in mind.
EXAMPLES = 500

# A place in the file by its share, what is done there, and with which bytes.
EDITS = st.lists(
    st.tuples(
        st.floats(0, 1),
        st.sampled_from(["change", "insert", "drop", "cut", "repeat", "number"]),
        st.binary(min_size=1, max_size=12),
    ),
    min_size=1,
    max_size=6,
)
NUMBERS = [b"9" * 20, b"-1", b"1e308", b"nan", b"0", b"\xff" * 4, b"\xff" * 8, b"\0" * 4, b"\x7f\xff\xff\xff"]


def damaged(data: bytes, edits: list[tuple[float, str, bytes]]) -> bytes:
    for share, what, given_bytes in edits:
        at = int(share * len(data))
        if what == "change":
            data = data[:at] + given_bytes + data[at + len(given_bytes) :]
        elif what == "insert":
            data = data[:at] + given_bytes + data[at:]
        elif what == "drop":
            data = data[:at] + data[at + given_bytes[0] + 1 :]
        elif what == "cut":
            data = data[:at]
        elif what == "repeat":
            data = data[:at] + data[at : at + 40] * given_bytes[0] + data[at + 40 :]
        else:
            number = NUMBERS[given_bytes[0] % len(NUMBERS)]
            data = data[:at] + number + data[at + len(number) :]
    return data


def check(read: Callable[[Path], object], path: Path, data: bytes) -> None:
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    started = time.monotonic()
    try:
        read(path)
    except InputError as error:
        assert path.name in str(error) or path.parent.name in str(error), f"does not name the file: {error}"
        # The decoder of LAZ says so of much damage.
        foreseen = "PanicException" in str(error) or "please send it to us" not in str(error)
        assert foreseen, f"an unforeseen exception: {error}"
    except OptionError:
        pass
    assert time.monotonic() - started < SECONDS, "too slow"
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - before
    assert more < allowed_memory(len(data)), f"{more:,} bytes of memory"


def fuzz(kind: Kind, folder: Path, seconds: float) -> int:
    """Number of executions, none of which failed."""
    path = folder / kind.file
    whole = kind.sample(folder)
    check(kind.read, path, kind.sealed(whole))
    done = runs = 0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        runs += 1

        @seed(runs)
        @settings(
            max_examples=EXAMPLES,
            database=None,
            deadline=None,
            phases=[Phase.generate, Phase.shrink],
            suppress_health_check=list(HealthCheck),
        )
        @given(EDITS)
        def one(edits: list[tuple[float, str, bytes]]) -> None:
            nonlocal done
            if time.monotonic() < end:
                done += 1
                check(kind.read, path, kind.sealed(damaged(whole, edits)))

        one()
    return done


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", choices=[*KINDS, []])
    parser.add_argument("--seconds", type=float, default=60.0, help="for each kind")
    given_arguments = parser.parse_args()
    failed = 0
    for name in given_arguments.kinds or KINDS:
        with tempfile.TemporaryDirectory() as folder:
            try:
                done = fuzz(KINDS[name], Path(folder), given_arguments.seconds)
                sys.stdout.write(f"{name}: {done:,} executions, no fault\n")
            except BaseException as error:
                if isinstance(error, KeyboardInterrupt):
                    raise
                failed += 1
                notes = "\n".join(getattr(error, "__notes__", []))
                sys.stdout.write(f"{name}: {type(error).__name__}: {error}\n{notes}\n")
            sys.stdout.flush()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
