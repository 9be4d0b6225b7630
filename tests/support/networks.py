"""Small networks of known poses, and what rules of the network see of them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from support.links import evidence, link
from trihedral.geometry.se3 import distance, inverse, motion
from trihedral.model.link import Link, LinkVerdict
from trihedral.model.station import Station
from trihedral.network.constraints.constraints import Constraints
from trihedral.network.decision.open_loops import close_loops
from trihedral.network.decision.state import NetworkState
from trihedral.network.options import NetworkOptions
from trihedral.scan import ScanHeader

SIGMA_T, SIGMA_R = 0.002, 1e-4


def network(count, pairs, seed=0, wrong=(), verdicts=None, origin=(0.0, 0.0, 0.0)):
    """Members in a ring of known poses and links with noise; those in `wrong` are off by 3 m."""
    rng = np.random.default_rng(seed)
    poses = [
        motion(
            Rotation.from_euler(
                "zyx", [rng.uniform(-3, 3), 0.02 * rng.normal(), 0.02 * rng.normal()]
            ).as_matrix(),
            np.array([15 * np.cos(k), 15 * np.sin(k), 0.3 * k]),
        )
        for k in range(count)
    ]
    origin = np.array(origin)
    members = [
        Station(
            f"s{k}",
            ScanHeader(
                Path(f"s{k}.e57"), 0, f"s{k}", "e57", 1, None, False, False, 0, None, origin, True, "m", True
            ),
            1000,
            f"{k:02d}",
        )
        for k in range(count)
    ]
    covariance = np.diag([SIGMA_R**2] * 3 + [SIGMA_T**2] * 3)
    links = []
    for a, b in pairs:
        small = motion(
            Rotation.from_rotvec(SIGMA_R * rng.normal(size=3)).as_matrix(), SIGMA_T * rng.normal(size=3)
        )
        between = small @ inverse(poses[b]) @ poses[a]
        if (a, b) in wrong:
            between = motion(None, np.array([3.0, 0.0, 0.0])) @ between
        verdict = (verdicts or {}).get((a, b), LinkVerdict.ACCEPTED)
        links.append(
            link(
                f"s{a}",
                f"s{b}",
                motion(None, origin) @ between @ motion(None, -origin),
                covariance,
                verdict,
                evidence=evidence(0.5 + 0.01 * len(links)),
            )
        )
    return poses, members, links


def errors(result, poses, origin=(0.0, 0.0, 0.0)):
    """Translation errors (m) against the truth in the frame of the first placed station."""
    shift = motion(None, -np.array(origin))
    placed = [(k, s) for k, s in enumerate(result.stations) if s.pose is not None]
    first, anchor = placed[0]
    found = []
    for k, station in placed:
        estimated = shift @ inverse(anchor.pose) @ station.pose @ inverse(shift)
        found.append(distance(inverse(poses[first]) @ poses[k], estimated)[0])
    return found


def closed(members: Sequence[Station], links: Sequence[Link]) -> NetworkState:
    """What a rule sees first: loops of the accepted links are closed."""
    return close_loops(NetworkState.initial(members, links, NetworkOptions(), Constraints()))


FULL = [(a, b) for a in range(5) for b in range(a + 1, 5)]
