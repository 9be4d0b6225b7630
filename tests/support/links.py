"""What is said of pairs: evidence and links of which a test states only what it is about."""

from dataclasses import replace
from typing import Any

import numpy as np
from benchmarks.networks import neutral_evidence

from trihedral.model.link import Link, LinkEvidence, LinkVerdict, PoseEstimate


def evidence(score: float = 0.5, **other: Any) -> LinkEvidence:
    """Of a pose that nothing speaks against; of its appearance nothing is known, and no ceiling is above it."""
    return replace(neutral_evidence(score), **other)


def link(
    a: str,
    b: str,
    pose: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
    verdict: LinkVerdict = LinkVerdict.ACCEPTED,
    **other: Any,
) -> Link:
    """From `a` to `b`, accepted unless another verdict is given."""
    values: dict[str, Any] = {
        "reason": None if verdict is LinkVerdict.ACCEPTED else "in doubt",
        "method": "refinement",
        "estimate": None if pose is None else PoseEstimate(pose, covariance),
        "evidence": evidence(),
    }
    return Link(
        from_station=a,
        to_station=b,
        verdict=verdict,
        **(values | other),
    )


def with_pose(one: Link, pose: np.ndarray) -> Link:
    """The same link with another pose, known as well."""
    return replace(one, estimate=PoseEstimate(pose, one.covariance))


def with_covariance(one: Link, covariance: np.ndarray) -> Link:
    """The same link, its pose known so well."""
    if one.transform is None:
        raise AssertionError("a link without a pose has no covariance")
    return replace(one, estimate=PoseEstimate(one.transform, covariance))
