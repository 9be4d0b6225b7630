"""Heaps of the C library and threads for matrices, counted by the libraries themselves."""

import ctypes
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from trihedral.parallel import processors

PROGRAM = """
import ctypes, sys, threading
if sys.argv[2] == "shared":
    from trihedral.cli.threads import share_heaps
    share_heaps()
libc = ctypes.CDLL(None)
libc.malloc.restype = libc.fopen.restype = ctypes.c_void_p
libc.malloc.argtypes = [ctypes.c_size_t]
at_once = threading.Barrier(4)

def ask():
    at_once.wait()
    for _ in range(100):
        libc.malloc(2000)
    at_once.wait()

threads = [threading.Thread(target=ask) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
file = ctypes.c_void_p(libc.fopen(sys.argv[1].encode(), b"w"))
libc.malloc_info(0, file)
libc.fclose(file)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_info"), reason="the C library is not glibc")
def test_threads_share_heaps(tmp_path: Path) -> None:
    heaps = {}
    for how in ("shared", "own"):
        told = tmp_path / how
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("MALLOC_", "GLIBC_"))}
        subprocess.run([sys.executable, "-c", PROGRAM, str(told), how], check=True, env=environment)
        heaps[how] = len(re.findall("<heap nr", told.read_text()))
    assert heaps["shared"] <= max(1, processors() // 4)
    assert heaps["own"] >= 4


@pytest.mark.parametrize(("asked", "threads"), [(None, 1), ("2", min(2, processors()))])
def test_matrices_have_threads_only_if_asked_for(asked: str | None, threads: int) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if asked is not None:
        environment["OPENBLAS_NUM_THREADS"] = asked
    program = (
        "from trihedral.cli.threads import start_none_for_matrices as start; start(); import scipy.linalg;"
        "from threadpoolctl import threadpool_info;"
        "print([one['num_threads'] for one in threadpool_info() if one['internal_api'] == 'openblas'])"
    )
    told = subprocess.run([sys.executable, "-c", program], check=True, env=environment, capture_output=True)
    counts = json.loads(told.stdout)
    if not counts:
        pytest.skip("NumPy and SciPy have another library than OpenBLAS")
    assert set(counts) == {threads}
