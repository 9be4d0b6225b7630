"""What is set for the threads of the process before there are any."""

import ctypes
import os

from trihedral.parallel import processors

_M_ARENA_MAX = -8  # of glibc's mallopt(3)
# On two processors one heap is as fast as one a thread; larger ones get more, lest many wait for one (not measured).
_PROCESSORS_A_HEAP = 4


def share_heaps() -> None:
    """Have threads share heaps, where the C library gives each its own.

    What one thread frees, others cannot use then: of a building's ten scans 745 MB were held at the peak, with one heap
    472 MB, in the same time on two processors.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # no glibc
        return
    mallopt(_M_ARENA_MAX, max(1, processors() // _PROCESSORS_A_HEAP))


def start_none_for_matrices() -> None:
    """Keep the OpenBLAS of NumPy and SciPy from threads of its own; before these are imported.

    Scans and pairs share the processors. Threads that wait for products of matrices turn in circles meanwhile: in a
    job of two scans for a tenth of the processor time. Who sets ``OPENBLAS_NUM_THREADS`` is heeded.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def limit_threads(threads: int | None) -> None:
    """Hold the core to as many threads; it reads this when it first runs."""
    if threads is not None:
        os.environ["RAYON_NUM_THREADS"] = str(threads)
