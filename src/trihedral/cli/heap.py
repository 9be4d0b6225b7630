"""Memory that is given back, and not kept by one heap for every thread."""

import ctypes

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
