"""What the bits of a result may depend on beside the program and its input."""

import importlib.metadata
import platform
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.linalg  # noqa: F401  (loads SciPy's own OpenBLAS, to be asked for its kernels)
from threadpoolctl import threadpool_info

# Whose arithmetic takes part: matrices, pictures, rays of the simulator.
PACKAGES = ("numpy", "scipy", "opencv-python-headless", "pillow", "embreex", "trimesh")


def machine() -> dict[str, Any]:
    """Give versions and kinds of processor, as JSON has them; nothing that names this very machine."""
    blas = {
        f"{library['version']} {library['architecture']}"
        for library in threadpool_info()
        if library["prefix"] == "libscipy_openblas"
    }
    return {
        "system": f"{platform.system()} {platform.machine()} {' '.join(platform.libc_ver())}",
        "processor": _processor(),
        "simd": np.show_config(mode="dicts")["SIMD Extensions"]["found"],
        "openblas": sorted(blas),
        "opencv": cv2.getCPUFeaturesLine(),
        "python": ".".join(platform.python_version_tuple()[:2]),
        "packages": {name: importlib.metadata.version(name) for name in PACKAGES},
    }


def _processor() -> str:
    """Who made it: approximate reciprocals, which rays are cast with, are each maker's own."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    return next((line.split(":")[1].strip() for line in lines if line.startswith("vendor_id")), "unknown")
