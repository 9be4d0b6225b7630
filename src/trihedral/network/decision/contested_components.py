"""Components of which nobody can tell where they belong: links that agree with each other join them in two ways."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trihedral.geometry.se3 import inverse
from trihedral.model.link import LinkVerdict, PoseEstimate
from trihedral.network.decision.coherent_outliers import CoherentOutliers, coherent_outliers
from trihedral.network.decision.state import ComponentPose, NetworkState, RuleOutcome
from trihedral.network.graph.scanner_frames import between_stations

NOT_OUTVOTED = "links that would have it elsewhere were not outvoted clearly"


def give_up_contested_components(state: NetworkState) -> RuleOutcome:
    """Give up links where others that agree with each other join the scans elsewhere.

    Stations whose pose a single link speaks against that is not outvoted clearly are only in doubt.
    """
    kept, refused = state.loops.kept, [edge for edge, _ in state.loops.refused]
    if not refused:
        return RuleOutcome(state)
    confirmed = [
        not edge.between_priors and state.links[state.link_at[edge.ends]].confirmed_by_loops for edge in kept
    ]
    poses, doubts = state.poses, dict[int, str]()
    for one in coherent_outliers(len(state.stations), kept, refused, poses, confirmed):
        if len(one.refused) > 1:
            state = _given_up(state, one, poses)
            why = NOT_OUTVOTED
        else:
            names = " - ".join(state.stations[s].name for s in one.refused[0].ends)
            links = "1 link" if len(one.kept) == 1 else f"{len(one.kept)} links"
            why = f"held by {links} only, and link {names}, refused, speaks against that"
        component = component_of(one, poses)
        side = one.stations if 2 * len(one.stations) <= len(component) else component - one.stations
        doubts |= dict.fromkeys(side, why)
    return RuleOutcome(state, doubts)


def component_of(one: CoherentOutliers, poses: Mapping[int, ComponentPose]) -> frozenset[int]:
    """Stations of the component in which some would move."""
    number = poses[min(one.stations & poses.keys())].component
    return frozenset(s for s, pose in poses.items() if pose.component == number)


def _given_up(state: NetworkState, one: CoherentOutliers, poses: Mapping[int, ComponentPose]) -> NetworkState:
    """Call the links ambiguous that join some stations in one of two ways."""
    reason, links = _reason(state, one, poses), {}
    for (a, b), index in state.link_at.items():
        link, at_a, at_b = state.links[index], poses.get(a), poses.get(b)
        across = link.accepted and (a in one.stations) != (b in one.stations)
        if not across or at_a is None or at_b is None or at_a.component != at_b.component:
            continue
        pose_a, pose_b = at_a.pose, at_b.pose
        if any(edge.ends == (a, b) for edge in one.kept):
            pose_a, pose_b = (
                one.motion @ pose if s in one.stations else pose for s, pose in ((a, pose_a), (b, pose_b))
            )
        elsewhere = between_stations(inverse(pose_b) @ pose_a, state.stations[a], state.stations[b])
        links[index] = replace(
            link, verdict=LinkVerdict.AMBIGUOUS, reason=reason, alternatives=(PoseEstimate(elsewhere),)
        )
    return replace(state.with_links(links), given_up=state.given_up | frozenset(links))


def _reason(state: NetworkState, one: CoherentOutliers, poses: Mapping[int, ComponentPose]) -> str:
    names = sorted(state.stations[s].name for s in one.stations)
    pose = poses[min(one.stations)].pose
    apart = float(np.linalg.norm((one.motion @ pose - pose)[:3, 3]))
    who = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    links = "1 link puts" if len(one.kept) == 1 else f"{len(one.kept)} links put"
    return (
        f"{links} {who} in one place, {len(one.refused)} others {apart:.2f} m away: which is right "
        "cannot be told"
    )
