"""What carries the scanner, and moves with it: a robot, a vehicle, a rig."""

import numpy as np
from numpy.typing import NDArray

# Metres; what is seen farther away is of the place.
FARTHEST = 1.5
# Metres; nothing nearer is looked at.
NEAREST = 0.02
# Ranges are counted in steps of this ratio.
STEP = 1.1
# Steps without points between what carries the scanner and the place (a fifth of the range).
GAP = 2
# Of the points a step has at most, on either side, as many may stray into the gap.
STRAY = 0.05
# Shares of the points that what carries the scanner has at the least, and at the most.
LEAST_SHARE, MOST_SHARE = 0.001, 0.25


def carrier_range(ranges: NDArray[np.floating]) -> float:
    """Range (m) within which the points (N,) are of what carries the scanner; 0 where there is no such thing.

    It is near, and beyond it nothing is for a while: the place begins farther off. A desk that the scanner stands on,
    or a wall beside it, goes on into the place.
    """
    edges = NEAREST * STEP ** np.arange(np.ceil(np.log(FARTHEST / NEAREST) / np.log(STEP)) + GAP + 1)
    counts = np.histogram(ranges, edges)[0]
    most_before = np.maximum.accumulate(counts)
    beyond = np.histogram(ranges, edges[-1] * STEP ** np.arange(60))[0].max(initial=0)
    most_after = np.maximum(np.maximum.accumulate(counts[::-1])[::-1], beyond)
    for step in range(1, len(counts) - GAP + 1):
        gap = counts[step : step + GAP]
        share = counts[:step].sum() / len(ranges)
        least = min(most_before[step - 1], most_after[min(step + GAP, len(counts) - 1)])
        if LEAST_SHARE <= share <= MOST_SHARE and gap.max() <= STRAY * least:
            return float(edges[step])
    return 0.0
