"""Hashes and smooth noise that are the same on every machine: integers, sums and products only."""

import numpy as np
from numpy.typing import NDArray

from trihedral.geometry.arrays import Float32, Uint32

# Odd constants near multiples of the golden ratio and of square roots spread consecutive inputs over 32 bits.
_STEP_X = np.uint32(0x9E3779B1)
_STEP_Y = np.uint32(0xB5297A4D)
_MIX_1 = np.uint32(0x7FEB352D)
_MIX_2 = np.uint32(0x846CA68B)


def hash32(values: Uint32, seed: Uint32 | np.uint32) -> Uint32:
    """Scramble 32-bit values (xor-shift and multiply rounds; constants found by C. Wellons' prospector)."""
    with np.errstate(over="ignore"):
        h = values * _STEP_X
        h ^= seed
        h ^= h >> np.uint32(16)
        h *= _MIX_1
        h ^= h >> np.uint32(15)
        h *= _MIX_2
        h ^= h >> np.uint32(16)
    return h


def unit(hashed: Uint32) -> Float32:
    """Numbers in [0, 1) from hashes: the upper 24 bits, which float32 holds exactly."""
    return (hashed >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)


def cell_noise(i: NDArray[np.int32], j: NDArray[np.int32], seed: Uint32 | np.uint32) -> Float32:
    """Give a number in [0, 1) for each cell (i, j) of each texture."""
    return unit(hash32(i.view(np.uint32) * _STEP_Y + j.view(np.uint32), seed))


def value_noise(u: Float32, v: Float32, wavelength: float, seed: Uint32) -> Float32:
    """Smooth noise in [-1, 1] over texture coordinates in metres, with features about `wavelength` across."""
    scale = np.float32(1.0 / wavelength)
    x, y = u * scale, v * scale
    i, j = np.floor(x), np.floor(y)
    x -= i
    y -= j
    x *= x * (np.float32(3.0) - np.float32(2.0) * x)
    y *= y * (np.float32(3.0) - np.float32(2.0) * y)
    a = i.astype(np.int32).view(np.uint32) * _STEP_Y
    b = j.astype(np.int32).view(np.uint32)
    a_next, b_next = a + _STEP_Y, b + np.uint32(1)
    low = unit(hash32(a + b, seed))
    low += x * (unit(hash32(a_next + b, seed)) - low)
    high = unit(hash32(a + b_next, seed))
    high += x * (unit(hash32(a_next + b_next, seed)) - high)
    low += y * (high - low)
    low *= np.float32(2.0)
    low -= np.float32(1.0)
    return low
