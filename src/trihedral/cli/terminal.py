"""What is said to a person: no name of a file or scan can command the terminal or make up a line of its own."""

import json
import sys
from pathlib import Path
from typing import Any

from trihedral.atomic import output_error
from trihedral.errors import printable


def show(*lines: str | Path) -> None:
    """Write lines that were asked for to standard output."""
    _write([printable(str(line)) for line in lines], sys.stdout)


def tell(*lines: str | Path) -> None:
    """Write lines to standard error."""
    _write([printable(str(line)) for line in lines], sys.stderr)


def show_json(value: Any) -> None:
    """Write JSON to standard output: ASCII, which every locale writes alike; odd bytes of names are lone surrogates."""
    _write([json.dumps(value, indent=1)], sys.stdout)


def write_anything(*streams: Any) -> None:
    """Have streams write what their encoding lacks as escapes instead of failing."""
    for stream in streams:
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _write(lines: list[str], stream: Any) -> None:
    try:
        print("\n".join(lines), file=stream, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise output_error("what was asked for", error) from error
