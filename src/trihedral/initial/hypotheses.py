"""Several distinct poses for a pair of scans, from every source that the two offer."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from trihedral.errors import OptionError
from trihedral.fusion.surroundings import SurroundingsOptions
from trihedral.geometry.distinct import distinct
from trihedral.initial.corners import CornerOptions, corner_poses
from trihedral.initial.plan import PlanOptions, plan_poses
from trihedral.initial.rectified import RectifiedOptions, rectified_poses
from trihedral.initial.shape import ShapeOptions, shape_poses
from trihedral.initial.viewed import ViewedOptions, viewed_poses
from trihedral.scan.prepared import Prepared

Float64 = NDArray[np.float64]

Source = Literal["plan", "views", "rectified", "corners", "shape"]
SOURCES: tuple[Source, ...] = get_args(Source)
# Poses this near to each other (m, rad) are one.
SAME_TRANSLATION = 0.1
SAME_ROTATION = np.radians(1.0)


@dataclass(frozen=True)
class HypothesisOptions:
    """Where poses come from; a scan that lacks what a source needs has none from it."""

    # The plan alone: the others found no pair more on simulated sites (docs/method.md).
    sources: tuple[Source, ...] = ("plan",)
    surroundings: SurroundingsOptions = field(
        default_factory=SurroundingsOptions
    )  # that features are found in
    plan: PlanOptions = field(default_factory=PlanOptions)
    views: ViewedOptions = field(default_factory=ViewedOptions)
    rectified: RectifiedOptions = field(default_factory=RectifiedOptions)
    corners: CornerOptions = field(default_factory=CornerOptions)
    shape: ShapeOptions = field(default_factory=ShapeOptions)

    def __post_init__(self) -> None:
        unknown = [source for source in self.sources if source not in SOURCES]
        if unknown or not self.sources or len(set(self.sources)) < len(self.sources):
            raise OptionError(
                f"sources of hypotheses are some of {', '.join(SOURCES)}, each once, not {', '.join(self.sources)!r}"
            )


@dataclass(frozen=True)
class Hypothesis:
    """A pose that may be right: ``b_from_a`` in scanner-centred coordinates.

    Scores rank the poses of one source; those of different sources are not comparable.
    """

    pose: Float64
    score: float
    source: Source


def hypotheses(a: Prepared, b: Prepared, options: HypothesisOptions | None = None) -> list[Hypothesis]:
    """Distinct poses of `a` on `b`: the few that features propose first, then those of the plan, each best first."""
    options = options or HypothesisOptions()
    if not len(a.station) or not len(b.station):
        return []
    proposals: dict[Source, Callable[[], list[tuple[Float64, float]]]] = {
        "views": lambda: viewed_poses(a, b, options.views),
        "rectified": lambda: rectified_poses(a, b, options.rectified),
        "corners": lambda: corner_poses(a, b, options.corners),
        "shape": lambda: shape_poses(a, b, options.shape),
        # Hundreds of poses: they come last, so that a limit on all of them cuts off only theirs.
        "plan": lambda: plan_poses(a, b, options.plan),
    }
    found = [
        Hypothesis(pose, score, source)
        for source, poses in proposals.items()
        if source in options.sources
        for pose, score in poses()
    ]
    poses = np.array([h.pose for h in found]).reshape(-1, 4, 4)
    kept = distinct(poses, range(len(poses)), translation=SAME_TRANSLATION, rotation=SAME_ROTATION)
    return [found[index] for index in kept]
