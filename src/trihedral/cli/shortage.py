"""Too little memory and full disks, in whatever shape they come: one line for a person.

Memory that the core or a library asks for in vain ends the process at once. The command therefore runs in a child, and
the process that was started says how that ended.
"""

import contextlib
import ctypes
import errno
import os
import re
import resource
import signal
import sys

from trihedral.atomic import output_error

_ADVICE = "Use fewer --threads, or close other programs."
LITTLE_MEMORY = f"There is not enough memory. {_ADVICE}"

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
# What loaders, threads, the core, SQLite and OpenCV say of it.
_SAID = re.compile(
    r"failed to map segment|cannot allocate|can't start new thread|ThreadPoolBuildError|failed to spawn thread|"
    r"out of memory|insufficient memory|unable to allocate|Resource temporarily unavailable",
    re.IGNORECASE,
)
# Signals that end a process which asks for memory in vain.
_ENDED = (signal.SIGABRT, signal.SIGBUS, signal.SIGKILL)
# Signals that end a run, and that of the child's end.
_PASSED_ON = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD)
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)
# Bytes.
_LEAST_ADDRESS_SPACE = 640 << 20


def shortage_of(error: BaseException) -> str | None:
    """Say what is short if that is what an error comes from; None otherwise."""
    seen: set[int] = set()
    cause: BaseException | None = error
    while cause is not None and id(cause) not in seen:
        seen.add(id(cause))
        if isinstance(cause, MemoryError) or _SAID.search(str(cause)):
            return LITTLE_MEMORY
        if isinstance(cause, OSError) and cause.errno == errno.ENOMEM:
            return LITTLE_MEMORY
        if isinstance(cause, OSError) and cause.errno in _NO_ROOM:
            return str(output_error(cause.filename or "a file", cause))
        cause = cause.__cause__ or cause.__context__
    return None


def too_little_at_all() -> bool:
    """Whether the process may not have the address space that the libraries need to be loaded.

    OpenBLAS asks again without end for what it does not get.
    """
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    return allowed != resource.RLIM_INFINITY and allowed < _LEAST_ADDRESS_SPACE


def ended_child() -> str | None:
    """Go on in a child, with None; here, wait for it and leave as it did, or say what want of memory ended it.

    What libraries write to standard error by themselves is kept back, and passed on unless memory was short.
    """
    if not hasattr(os, "memfd_create"):
        return None
    sys.stdout.flush()
    noise = os.memfd_create("stderr")
    # Where it is ignored, the end of a child is not told.
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_BLOCK, _PASSED_ON)
    child = os.fork()
    if child == 0:
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _PASSED_ON)
        kept = os.dup(2)
        os.dup2(noise, 2)
        sys.stderr = os.fdopen(
            kept, "w", buffering=1, encoding=sys.stderr.encoding, errors="backslashreplace"
        )
        return None
    status = _wait(child)
    ended = os.WTERMSIG(status) if os.WIFSIGNALED(status) else None
    if ended == signal.SIGSEGV:
        return f"A library failed ({signal.Signals(ended).name}), most likely for want of memory. {_ADVICE}"
    if ended in _ENDED:
        return LITTLE_MEMORY
    with contextlib.suppress(OSError):
        os.write(2, os.pread(noise, 1 << 20, 0))
    if ended is not None:
        signal.signal(ended, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _PASSED_ON)
        os.kill(os.getpid(), ended)
    os._exit(os.WEXITSTATUS(status))


def _wait(child: int) -> int:
    """Give the status with which a child ends; signals that processes send are passed on to it.

    Those of the terminal reach it by themselves.
    """
    while True:
        found = signal.sigwaitinfo(_PASSED_ON)
        if found.si_signo == signal.SIGCHLD:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                return status
        elif found.si_code <= 0:
            os.kill(child, found.si_signo)
