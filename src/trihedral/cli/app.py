"""The command and how it ends: every error becomes a sentence and an exit code."""

import contextlib
import io
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NoReturn

import typer

from trihedral.cli import bug, calibrate, colorize, demo, export, info, register, reproduce, simulate, status
from trihedral.cli.shortage import LITTLE_MEMORY, ended_child, shortage_of, too_little_at_all
from trihedral.cli.terminal import show, tell, write_anything
from trihedral.cli.threads import share_heaps, start_none_for_matrices
from trihedral.errors import NothingToRegister, TrihedralError

BUG, BAD, INTERRUPTED = 1, 2, 130

# Typer gives this exception no public name of its own.
UsageError: Any = typer.BadParameter.__base__

app = typer.Typer(
    name="trihedral",
    help="Register terrestrial laser scans without targets, and say how far each pose may be trusted.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_VERBS: tuple[Callable[..., int], ...] = (
    *(register.register, status.status, export.export, info.info, colorize.colorize),
    *(calibrate.calibrate, demo.demo, simulate.simulate, reproduce.reproduce),
)
for verb in _VERBS:
    app.command()(verb)


def _version(asked: bool) -> None:
    if asked:
        from trihedral.version import VERSION

        show(f"trihedral {VERSION}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which version this is.")
    ] = False,
) -> None:
    pass


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command and leave with its exit code."""
    if arguments is None:
        _speak_utf8()
        if ended := LITTLE_MEMORY if too_little_at_all() else ended_child():
            _say(ended)
            _leave(BAD)
    write_anything(sys.stdout, sys.stderr)
    share_heaps()
    start_none_for_matrices()
    try:
        code = _finish(arguments)
    except MemoryError:
        # Even for the words about it.
        _say(LITTLE_MEMORY)
        code = BAD
    _leave(code)


def _finish(arguments: Sequence[str] | None) -> int:
    """Run the command; every error becomes a sentence and an exit code."""
    try:
        return _run(arguments)
    except KeyboardInterrupt:
        # A second Ctrl-C must not cut short what is left to do.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        again = " Run the same command again: it goes on where it was." if bug.folder is not None else ""
        _say(f"Stopped.{again}")
        return INTERRUPTED
    except NothingToRegister as error:
        # Who watches has been told the reasons.
        _say(error.summary)
        return BAD
    except TrihedralError as error:
        _say(str(error))
        return BAD
    except (SystemExit, GeneratorExit):
        raise
    except BaseException as error:
        # A panic of the core is not an `Exception`.
        if shortage := shortage_of(error):
            _say(shortage)
            return BAD
        _say(bug.keep_report(error, sys.argv if arguments is None else arguments))
        return BUG


def _speak_utf8() -> None:
    """Begin again with files and their names in UTF-8, where the locale would read them otherwise.

    The same inputs give the same output in every locale; what is said to a person stays in the terminal's encoding.
    """
    if sys.getfilesystemencoding() != "utf-8":
        os.environ.setdefault("PYTHONIOENCODING", sys.stdout.encoding)
        os.execv(sys.executable, [sys.executable, "-X", "utf8", "-m", "trihedral", *sys.argv[1:]])


def _run(arguments: Sequence[str] | None) -> int:
    try:
        code = int(app(args=arguments, prog_name="trihedral", standalone_mode=False) or 0)
    except UsageError as error:
        said = io.StringIO()
        error.show(said)
        _say(said.getvalue().rstrip())
        return BAD
    except SystemExit as error:
        # Typer makes this of a broken pipe: who reads our output has seen enough.
        if isinstance(error.__context__, BrokenPipeError):
            return 0
        raise
    if code == INTERRUPTED:
        # Typer makes this of Ctrl-C.
        raise KeyboardInterrupt
    return code


def _say(text: str) -> None:
    with contextlib.suppress(OSError, TrihedralError):
        tell(*text.split("\n"))


def _leave(code: int) -> NoReturn:
    """Leave without waiting for threads: what they were at is dropped, and nothing of it is half written."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(code)
