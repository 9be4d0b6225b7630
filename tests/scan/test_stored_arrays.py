"""Files of named arrays, read by several threads at once."""

import gc
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from trihedral.scan.stored_arrays import stored_arrays, write_arrays


def test_many_threads_read_the_same_arrays_while_memory_is_collected(tmp_path):
    arrays = {f"part.{k}": np.arange(k, dtype=np.float64) for k in range(40)}
    write_arrays(tmp_path / "a.npz", arrays)
    inside, most = [0], [0]
    count = threading.Lock()

    def read(_):
        with stored_arrays(tmp_path / "a.npz") as stored:
            with count:
                inside[0] += 1
                most[0] = max(most[0], inside[0])
            found = {name: stored[name] for name in arrays}
            with count:
                inside[0] -= 1
        return all(np.array_equal(found[name], values) for name, values in arrays.items())

    threshold = gc.get_threshold()
    gc.set_threshold(5)
    try:
        with ThreadPoolExecutor(8) as pool:
            assert all(pool.map(read, range(200)))
    finally:
        gc.set_threshold(*threshold)
    assert most[0] == 1, "headers are read one at a time: Python 3.11 fails now and then otherwise"
