"""What share of their walls pairs of scans have in common if poses are right."""

import numpy as np

from trihedral.geometry.arrays import Bool, Float64
from trihedral.geometry.se3 import inverse
from trihedral.initial.plan.descriptor import WALL_BAND, expected_overlap
from trihedral.network.candidates.state import Pair, SearchState, ordered

# Metres: plans do not reach farther.
_FARTHEST = 50.0


def expected_shares(state: SearchState) -> dict[Pair, float]:
    """Of pairs that are not registered, where the network is weak, under the poses so far."""
    poses, options = state.poses(), state.options
    places = poses[:, :3, 3]
    near = np.linalg.norm(places[:, None] - places[None], axis=2) <= _FARTHEST
    few = state.degree < options.links
    together = state.component[:, None] == state.component
    worth = near & together & (few[:, None] | few | _held_by_one(state))
    shares = {}
    for a, b in np.argwhere(np.triu(worth, 1)).tolist():
        if (a, b) in state.links:
            continue
        share = expected_overlap(state.descriptor(a), state.descriptor(b), inverse(poses[b]) @ poses[a])
        if share >= min(options.least_expected, options.least_across):
            shares[a, b] = share
    return shares


def shares_under(
    state: SearchState, first: int, second: int, between: Float64, poses: Float64
) -> dict[Pair, float]:
    """Of the nearest pairs between two components, if `between` is the pose of two of their scanners."""
    # The frame of the component that the second is in, from that of the other.
    moved = poses[second] @ between @ inverse(poses[first])
    of_first, of_second = (
        np.flatnonzero(state.component == state.component[end]).tolist() for end in (first, second)
    )
    there = (moved @ poses[of_first])[:, None, :3, 3] - poses[of_second][:, :3, 3]
    # Plans show what is level with the scanner.
    up = np.array([poses[j][:3, :3] @ state.descriptor(j).plan_from_scanner[2] for j in of_second])
    level = np.abs(np.einsum("ijk,jk->ij", there, up)) <= WALL_BAND
    apart = np.linalg.norm(there, axis=2)
    beside = sorted(np.argwhere(level & (apart <= _FARTHEST)).tolist(), key=lambda ends: float(apart[*ends]))
    shares = {}
    for i, j in ((of_first[k], of_second[m]) for k, m in beside[: state.options.tested_of]):
        j_from_i = inverse(poses[j]) @ moved @ poses[i]
        shares[ordered(i, j)] = expected_overlap(state.descriptor(i), state.descriptor(j), j_from_i)
    return shares


def _held_by_one(state: SearchState) -> Bool:
    """(N, N) whether a single link holds the groups together that two stations are in."""
    held = np.zeros(state.similarity.shape, dtype=np.bool_)
    for side in state.sides:
        inside = np.zeros(len(held), dtype=np.bool_)
        inside[list(side)] = True
        held |= inside[:, None] != inside
    return held
