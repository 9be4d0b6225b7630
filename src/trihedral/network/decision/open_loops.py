"""Loops that do not close: which links agree, and those that are rejected because they spoil loops."""

from dataclasses import replace

import numpy as np

from trihedral.geometry.se3 import inverse, translation
from trihedral.model.link import LinkVerdict
from trihedral.network.decision.loop_closure import LoopClosure, consistent
from trihedral.network.decision.state import NetworkState, RuleOutcome
from trihedral.network.graph.edge import Edge


def close_loops(state: NetworkState) -> NetworkState:
    """Find which of the accepted links agree with each other.

    Links that were refused with wrong ones, but agree with the poses that the rest gives, are taken back.
    """
    limits = state.options.closure
    agreed = consistent(_accepted_edges(state) + _fixed_edges(state), limits)
    closed = replace(state, loops=agreed)
    back = [
        edge for edge, _ in agreed.refused if closed.closes(closed.offset(edge.a, edge.b, edge.transform))
    ]
    if not back:
        return closed
    again = consistent([*agreed.kept, *back], limits)
    wrong = [(edge, loop) for edge, loop in agreed.refused if not any(edge is b for b in back)]
    return replace(state, loops=LoopClosure(again.kept, wrong + again.refused, again.closures))


def reject_open_loops(state: NetworkState) -> RuleOutcome:
    """Refuse the links that loops speak against."""
    links = {}
    for edge, closure in state.loops.refused:
        index = state.link_at[edge.ends]
        walk = " - ".join(state.stations[s].name for s in closure.stations)
        error = f"{1e3 * closure.translation:.0f} mm and {np.degrees(closure.rotation):.2f} deg"
        forced = "it was forced, but " if state.links[index].decision == "forced" else ""
        reason = f"{forced}the loop {walk} misses its start by {error}"
        links[index] = replace(state.links[index], verdict=LinkVerdict.REFUSED, reason=reason)
    return RuleOutcome(state.with_links(links) if links else state)


def _accepted_edges(state: NetworkState) -> list[Edge]:
    scale, more = state.systematic.scale, state.systematic.covariance
    edges = []
    for (a, b), index in state.link_at.items():
        link = state.links[index]
        if link.accepted and link.transform is not None and link.covariance is not None:
            if a in state.fixed and b in state.fixed:
                continue
            locked = link.decision == "locked"
            covariance = link.covariance if locked else scale * link.covariance + more
            transform = state.between_scanners(link, link.transform)
            edges.append(Edge(a, b, transform, covariance, link.score, locked=locked))
    return edges


def _fixed_edges(state: NetworkState) -> list[Edge]:
    """Edges that stand for the poses that are given, so that loops close over them."""
    if len(state.fixed) < 2:
        return []
    first, *others = sorted(state.fixed)
    scanner = {
        s: pose @ translation(state.stations[s].header.scanner_origin) for s, pose in state.fixed.items()
    }
    covariance = np.diag([1e-12] * 3 + [1e-8] * 3)
    here = inverse(scanner[first])
    return [
        Edge(s, first, here @ scanner[s], covariance, 1.0, locked=True, between_priors=True) for s in others
    ]
