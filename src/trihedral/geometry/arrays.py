"""Types of arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Floating = NDArray[np.floating[Any]]
Uint32 = NDArray[np.uint32]
Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]
